"""Reset, pause, step and parameters of a running robot: their effect on stamps, state and bag."""

import signal
from pathlib import Path

from nav_msgs.msg import Odometry
from observation import PERIOD, Operator, bags, stop_with_whole_bag, value_of
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from vibro_ros.bag.reader import read_bag
from vibro_ros.bag.stream import BagStream
from vibro_ros.recordings.comparison import compare


def done(answer) -> str:
    assert answer.success, answer.message
    return answer.message


def number(name: str, value: float) -> ParameterMessage:
    return Parameter(name, value=value).to_parameter_msg()


def stamps_and_places(operator: Operator) -> list[tuple[int, float]]:
    """Stamp [ns] and body position [m] of every received odometry message."""
    heard = [deserialize_message(data, Odometry) for data in operator.heard["odom"]]
    return [(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec, message.pose.pose.position.x)
            for message in heard]


def operations_in(folder: Path) -> list[str]:
    return list(read_bag(folder)["operations"]["text"])


def assert_replays(folder: Path, samples: int, commands: int = 0) -> None:
    with BagStream(folder) as stream:
        comparison = compare(stream)
    assert comparison.difference is None, str(comparison.difference)
    assert comparison.compared["/odom"] >= samples and not comparison.missing
    assert comparison.commands >= commands


def test_a_run_through_every_operation_has_no_stamp_twice_and_replays_to_the_last_bit(start, bench, call, tmp_path):
    robot = start("robot", "--ros-args", "-p", "motor.speed:=100.0")
    operator = Operator(bench)
    operator.wait_for_robot()
    assert "not paused" in call(Trigger, "step").message
    operator.spin_for_samples(40)
    answer = done(call(SetBool, "pause", data=True))
    assert answer.startswith("paused at")
    done(call(SetBool, "pause", data=True))
    angle = 100.0 * float(answer.split()[2])  # [rad] of the crank then: it has turned at 100 rad/s from the start
    bench.spin_until(lambda: abs(operator.joint("crank")[0] - angle) < 1e-3, "the joints of the last sample")
    last = deserialize_message(operator.heard["joint_states"][-1], JointState).header.stamp
    bench.spin_until(lambda: operator.odom().header.stamp == last, "the odometry of the last sample")
    samples_before = len(operator.heard["odom"])
    operator.command(motor_speed=120.0)  # of the same instant as the pause
    for _ in range(3):
        done(call(Trigger, "step"))
    bench.spin_until(lambda: len(operator.heard["odom"]) == samples_before + 3, "three samples")
    bench.spin_until(lambda: operator.joint("crank")[1] > 100.0, "the command in effect")
    done(call(Trigger, "reset"))  # which shows the start, and takes a period
    bench.spin_until(lambda: len(operator.heard["odom"]) == samples_before + 4, "the start")
    bench.spin_until(lambda: operator.joint("crank")[:2] == (0.0, 100.0), "the start's crank")
    assert stamps_and_places(operator)[-1][1] == 0.0
    results = call(SetParameters, "set_parameters", parameters=[number("ground.friction", 0.1)]).results
    assert results[0].successful, results[0].reason
    assert done(call(SetBool, "pause", data=False)) == "running"
    operator.spin_for_samples(40)
    operator.command(motor_speed=80.0, upper_gap=0.0005)
    operator.spin_for_samples(20)
    result = call(SetParametersAtomically, "set_parameters_atomically", parameters=[
        number("ground.friction", 0.15), number("motor.acceleration", 500.0),
        number("rate.real_time_factor", 2.0)]).result
    assert result.successful, result.reason
    operator.spin_for_samples(40)
    done(call(Trigger, "reset"))
    operator.spin_for_samples(40)
    folder = tmp_path / stop_with_whole_bag(robot)

    stamps, places = zip(*stamps_and_places(operator), strict=True)
    assert {after - stamp for stamp, after in zip(stamps, stamps[1:], strict=False)} == {PERIOD}
    assert places.count(0.0) >= 2  # the starts
    assert operations_in(folder) == [
        "pause", "step 1", "step 1", "step 1", "reset", 'set {"ground.friction": 0.1}', "resume",
        'set {"ground.friction": 0.15, "motor.acceleration": 500.0, "rate.real_time_factor": 2.0}', "reset"]
    assert_replays(folder, 180)


def test_a_set_that_breaks_a_limit_changes_nothing_and_a_bag_begun_after_changes_replays_from_its_checkpoint(
        start, bench, call, listener, record, tmp_path):
    robot = start("robot", "--ros-args", "-p", "motor.speed:=100.0", "-p", "record.enabled:=false")
    operator = Operator(bench)
    operator.wait_for_robot()
    names = ["ground.friction", "motor.max_speed", "mass.body"]
    values_before = call(GetParameters, "get_parameters", names=names).values
    for wanted, words in (
            ([number("ground.friction", 0.1), number("motor.max_speed", -1.0)], "-1 is out of range"),
            ([number("ground.friction", 0.1), number("motor.max_speed", 50.0)], "the limit is motor.max_speed"),
            ([number("ground.friction", 0.1), number("mass.body", 2.0)], "read-only while the node runs"),
            ([number("ground.friction", 1e3)], "Painlevé's paradox")):
        answers = call(SetParameters, "set_parameters", parameters=wanted).results
        assert not any(answer.successful for answer in answers)
        assert all(words in answer.reason for answer in answers)
    assert call(GetParameters, "get_parameters", names=names).values == values_before
    answers = call(SetParameters, "set_parameters", parameters=[
        number("ground.friction", 0.1), number("mass.body", 1.0)]).results
    assert [answer.successful for answer in answers] == [True, True]  # 1 kg is what the body has
    listener.wait_for_status("simulation", lambda status: value_of(status, "refused requests") == 4.0)
    operator.spin_for_samples(20)
    done(call(Trigger, "reset"))
    operator.spin_for_samples(30)
    assert record(True)[0]
    operator.spin_for_samples(30)
    done(call(Trigger, "reset"))
    operator.spin_for_samples(30)
    stop_with_whole_bag(robot)
    (folder,) = bags(tmp_path)
    assert operations_in(folder) == ["reset"]  # the checkpoint has the friction that was set before
    assert_replays(folder, 50)


def test_clock_says_the_time_of_each_sample_and_what_follows_a_reset_has_the_bits_of_what_follows_another(
        start, bench, call, tmp_path):
    robot = start("robot", "--ros-args", "-p", "clock.publish:=true", "-p", "use_sim_time:=true", "-p",
                  "rate.publish:=50.0", "-p", "motor.speed:=100.0", "-p", "rate.real_time_factor:=0.5")
    heard: list[tuple[str, int]] = []

    def hear(name: str, stamp) -> None:
        heard.append((name, stamp.sec * 10**9 + stamp.nanosec))

    bench.node.create_subscription(Odometry, "odom", lambda message: hear("odom", message.header.stamp), 100)
    bench.node.create_subscription(Clock, "/clock", lambda message: hear("clock", message.clock), 100)
    bench.spin_until(lambda: {name for name, _ in heard} == {"odom", "clock"}, "both topics")
    heard.clear()
    bench.spin_until(lambda: len(heard) > 60, "30 samples")
    for name in ("odom", "clock"):
        stamps = [stamp for topic, stamp in heard if topic == name]
        assert {after - stamp for stamp, after in zip(stamps, stamps[1:], strict=False)} == {20_000_000}
    assert max(stamp for _, stamp in heard) < 60 * 10**9  # robot time, not the wall clock's
    odometry: list[Odometry] = []
    done(call(SetBool, "pause", data=True))
    bench.node.create_subscription(Odometry, "odom", odometry.append, QoSProfile(depth=1000))
    bench.spin_until(lambda: bench.node.count_subscribers("odom") == 2, "the second subscription")
    for _ in range(2):
        done(call(Trigger, "reset"))
        for _ in range(25):
            done(call(Trigger, "step"))
    bench.spin_until(lambda: len(odometry) >= 52, "26 samples of each")
    first, second = odometry[-52:-26], odometry[-26:]
    assert [message.pose for message in first] == [message.pose for message in second]
    assert [message.twist for message in first] == [message.twist for message in second]
    folder = tmp_path / stop_with_whole_bag(robot)
    with BagStream(folder) as stream:
        assert stream.start == 0
    assert_replays(folder, 30)


def test_the_motor_stops_when_commands_stay_away_and_replay_knows_when(start, bench, listener, tmp_path):
    robot = start("robot", "--ros-args", "-p", "command.timeout:=0.1")
    operator = Operator(bench)
    operator.wait_for_robot()
    for speed in (50.0, 60.0, 70.0):  # commands in time keep it running
        operator.command(motor_speed=speed)
        operator.spin_for_samples(5)
    robot.wait_for("command.timeout: no command of the motor on /motor_speed or /joint_commands for 0.1 s")
    bench.spin_until(lambda: operator.joint("crank")[1] == 0.0, "the motor's stop")
    listener.wait_for_status("simulation", lambda status: value_of(status, "stops by command.timeout") >= 1.0)
    operator.command(motor_speed=30.0)
    bench.spin_until(lambda: operator.joint("crank")[1] > 0.0, "the motor running again")
    bench.spin_until(lambda: operator.joint("crank")[1] == 0.0, "the motor's next stop")
    folder = tmp_path / stop_with_whole_bag(robot)
    assert set(operations_in(folder)) == {"timeout"}
    assert_replays(folder, 40)


def test_operations_are_answered_at_the_lowest_rate_too_and_signals_heard(start, call):
    robot = start("robot", "--ros-args", "-p", "rate.publish:=0.1", "-p", "motor.speed:=50.0")
    robot.wait_for("ready")
    assert "the sample at 10 s of robot time" in done(call(Trigger, "reset"))  # long before that sample
    done(call(SetBool, "pause", data=True))
    assert "to 10 s" in done(call(Trigger, "step"))
    stop_with_whole_bag(robot, signal.SIGTERM)
