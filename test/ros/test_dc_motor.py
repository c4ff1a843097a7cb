"""A robot with a dc motor: heard as users hear it, commanded by volts, recorded, and computed again to the last bit."""

from random_run import record_run
from std_msgs.msg import Float64

from vibro_ros.bag.reader import read_bag
from vibro_ros.recordings import replay, report


def test_volts_turn_the_crank_and_the_replay_is_identical(start, bench, tmp_path, capsys):
    """Refused commands are in the bag, too: a speed, and more volts than the supply has."""
    heard = {name: [] for name in ("motor_current", "electrical_power")}
    for name, of_topic in heard.items():
        bench.node.create_subscription(Float64, name, of_topic.append, 10)
    volts, speed = (bench.node.create_publisher(Float64, name, 10) for name in ("motor_voltage", "motor_speed"))

    def drive(bench):
        bench.spin_until(lambda: volts.get_subscription_count() and speed.get_subscription_count(), "a robot")
        for publisher, value in ((volts, 18.0), (speed, 10.0), (volts, 1e3), (volts, float("nan"))):
            publisher.publish(Float64(data=value))
        before = len(heard["motor_current"])
        bench.spin_until(lambda: len(heard["motor_current"]) > before + 60 and any(
            one.data > 20.0 for one in heard["electrical_power"]), "a motor that draws power")

    bag = record_run(start, bench, tmp_path, "scene:=machine", "motor.control:=voltage",
                     "motor.winding_inductance:=2.81e-4", seconds=0.3, then=drive)
    assert replay.main([str(bag)]) == 0
    assert capsys.readouterr().out.startswith("identical: ")
    recorded = read_bag(bag)
    assert recorded["motor_current"]["value"].max() > 1.0
    assert len(recorded["motor_current"]["value"]) == len(recorded["joint_states"]["time"])
    assert recorded["joint_states"]["crank.velocity"].max() > 10.0
    assert report.main([str(bag)]) == 0
    assert "supply" in capsys.readouterr().out
