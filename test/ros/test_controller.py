"""The controller as a process of its own; the test acts as the robot, or a real robot runs."""

import signal
from functools import partial
from pathlib import Path

import pytest
from asking import set_parameter
from observation import check_end, stop, write
from std_msgs.msg import Float64

from vibro_ros.bag.reader import read_bag
from vibro_ros.ros.controller import controller

FIRST_NODE = Path(__file__).resolve().parents[2] / "examples" / "first_node.py"
COMMANDS = ("motor_speed", "upper_gap", "inclined_gap")


class CommandListener:
    """A subscriber to the commands, as a robot has, that keeps their values."""

    def __init__(self, bench):
        self.bench = bench
        self.heard: dict[str, list[float]] = {name: [] for name in COMMANDS}
        self._subscriptions = [
            bench.node.create_subscription(Float64, name, partial(self._hear, name), 100) for name in COMMANDS
        ]

    def _hear(self, name: str, message: Float64) -> None:
        self.heard[name].append(message.data)

    def spin_until_ended(self, controller) -> None:
        self.bench.spin_until(lambda: controller.ended, "controller done")

    def leave(self) -> None:
        for subscription in self._subscriptions:
            self.bench.node.destroy_subscription(subscription)


def test_the_controller_plays_a_script_to_the_end(start, bench, tmp_path):
    listener = CommandListener(bench)
    script = write(tmp_path, """
entries:
  - {for: 0.2, motor_speed: {from: 0.0, to: 10.0}, upper_gap: 0.001, note: faster}
  - repeat: 2
    entries:
      - {for: 0.1, motor_speed: 20.0}
      - {for: 0.1, motor_speed: 0.0}
  - {for: 0.1, motor_speed: 0.0}
""")
    controller = start("controller", "--ros-args", "-p", "rate:=20.0", "-p", f"script:={script}")
    listener.spin_until_ended(controller)
    assert controller.end() == 0, controller.text
    ramp = listener.heard["motor_speed"][:-5]
    assert ramp == pytest.approx([0.0, 2.5, 5.0, 7.5], abs=1e-12)
    assert listener.heard["motor_speed"][-5:] == [20.0, 0.0, 20.0, 0.0, 0.0]  # every entry sends what it gives
    assert listener.heard["upper_gap"] == [0.001]
    assert listener.heard["inclined_gap"] == []
    entries = [line.split("]: ")[1] for line in controller.lines if "]: entry" in line]
    assert entries == [
        "entry 1, 0.2 s: motor_speed 0 -> 10 rad/s, upper_gap 0.001 m (faster)",
        *["entry 2.1, 0.1 s: motor_speed 20 rad/s", "entry 2.2, 0.1 s: motor_speed 0 rad/s"] * 2,
        "entry 3, 0.1 s: motor_speed 0 rad/s",
    ]
    assert controller.lines[-1].endswith("script done; /motor_speed is at 0 rad/s, so that the motor stops")
    assert "/bench does not say its limits" in controller.text


def test_two_robots_on_the_command_topics_end_the_script(start, tmp_path):
    """The controller stops as soon as it discovers both, whether it has started to play or not."""
    script = write(tmp_path, "entries: [{for: 1000.0, motor_speed: 10.0}]\n")
    robot = ("robot", "--ros-args", "-p", "record.enabled:=false", "-r")
    start(*robot, "__ns:=/")
    playing = start("controller", script)
    playing.wait_for("entry 1")
    start(*robot, "__node:=twin")
    late = start("controller", script)
    for program in (playing, late):
        assert program.end() == 1
        assert program.lines[-1].startswith("controller: 2 robots hear /motor_speed: /")
        assert "Traceback" not in program.text
    assert "aborted: /motor_speed 0 rad/s" in playing.text


@pytest.mark.parametrize("words, reason", [
    (["script.yaml"], "controller: script.yaml: entry 2: motor_speed: nan is not finite; give a number in rad/s"),
    (["nope.yaml"], "controller: nope.yaml: neither a shipped script nor a file; shipped scripts are crawl, goals, "
     "pulses"),
    ([], "controller: no script is given; give the path of a file, or a shipped one: shipped scripts are crawl, goals, "
     "pulses"),
    (["crwal"], "controller: crwal: neither a shipped script nor a file; did you mean crawl? shipped scripts are "
     "crawl, goals, pulses"),
    (["crawl", "--ros-args", "-p", "wiat:=1.0"], "controller: wiat: unknown parameter; did you mean wait?"),
    (["forwards.yaml"], "controller: forwards.yaml: entry 1: hold_speed: 0.05 m/s is out of reach of a robot that goes "
     "backwards; give one between -0.06 and 0 m/s, and not 0, or set `reach` for another robot"),
    (["forwards.yaml", "--ros-args", "-p", "reach:=0.0"], "controller: reach: 0 is out of range; give a mean speed "
     "other than 0 m/s, negative if the robot goes backwards"),
])
def test_bad_input_is_refused_in_one_line(refusal, tmp_path, words, reason):
    write(tmp_path, "entries: [{for: 1.0, motor_speed: 10.0}, {for: 1.0, motor_speed: .nan}]\n")
    (tmp_path / "forwards.yaml").write_text("entries: [{hold_speed: 0.05, for: 10.0}]\n")
    assert refusal(controller.main, *words) == reason


def test_the_first_node_and_goals_are_reached_with_a_real_robot(start, tmp_path):
    robot = start("robot")
    first = start(str(FIRST_NODE), "--ros-args", "-p", "distance:=0.1")
    check_end(first)
    assert 0.1 <= -float(first.text.partition("stopped after ")[2].partition(" m")[0]) < 0.2, first.text
    controller = start("controller", write(tmp_path, """
entries:
  - {for: 0.2, motor_speed: 50.0}
  - entries:
      - {hold_speed: -0.05, within: 0.02, for: 4.0}
      - {for: 0.2, motor_speed: 0.0}
  - {go_to: -0.5, timeout: 60.0}
  - {for: 0.1, upper_gap: 0.0}
"""))
    assert controller.end() == 0, controller.text
    stop(robot)
    assert "]: entry 2.1: held: mean speed -0.0" in controller.text
    assert "]: entry 3: reached after " in controller.text
    assert "]: entry 4, 0.1 s: upper_gap 0 m" in controller.text
    (bag,) = (read_bag(folder) for folder in tmp_path.glob("vibro_robot_*"))
    assert abs(bag["odom"]["position"][-1, 0] + 0.5) < 0.006  # [m]
    assert bag["motor_speed"]["value"][-1] == 0.0


def test_the_log_says_at_which_speed_a_script_leaves_the_motor(start, bench, tmp_path):
    """The ends are the end of the file, a goal without odometry, an operator who aborts, and a robot that disappears.
    """
    listener = CommandListener(bench)
    speeds = listener.heard["motor_speed"]
    controller = start("controller", write(tmp_path, "entries: [{for: 0.1, motor_speed: 9.0}]\n"))
    listener.spin_until_ended(controller)
    assert controller.end() == 0 and speeds == [9.0]
    assert "[WARN]" in controller.lines[-1] and controller.lines[-1].endswith(
        "script done, and the motor goes on: /motor_speed stays at 9 rad/s until another command comes; stop it by "
        "the page of `view`, or by a script that ends with motor_speed: 0.0")

    speeds.clear()
    controller = start("controller", write(
        tmp_path, "entries: [{for: 0.1, motor_speed: 9.0}, {hold_speed: -0.05, for: 1000.0}]\n"))
    listener.spin_until_ended(controller)
    assert controller.end() == 1
    assert controller.lines[-1].startswith("controller: entry 2: no odometry for 2.")
    assert controller.lines[-1].endswith(" s; is there a robot that publishes odom?")
    bench.spin_until(lambda: len(speeds) == 2, "the stop")
    assert speeds == [9.0, 0.0]

    endless = write(tmp_path, "entries: [{for: 1000.0, motor_speed: 10.0, upper_gap: 0.001}]\n")
    for words, code in (((), 128 + signal.SIGINT), (("--launched",), 0)):  # `launch` takes any code but 0 for a death
        for heard in listener.heard.values():
            heard.clear()
        controller = start("controller", endless, *words)
        bench.spin_until(lambda: speeds, "first command")
        controller.send(signal.SIGINT)
        listener.spin_until_ended(controller)
        assert controller.end() == code
        bench.spin_until(lambda: len(speeds) == 2, "the stop")
        assert listener.heard == {"motor_speed": [10.0, 0.0], "upper_gap": [0.001], "inclined_gap": []}
        assert controller.lines[-1].endswith("aborted: /motor_speed 0 rad/s") and "Traceback" not in controller.text

    controller = start("controller", endless)
    bench.spin_until(lambda: len(speeds) == 3, "first command")
    listener.leave()
    listener.spin_until_ended(controller)
    assert controller.end() == 1
    assert controller.lines[-1] == ("controller: the robot is gone: nobody listens to /motor_speed, /upper_gap any "
                                    "more")


def test_commands_beyond_the_robots_limits_are_refused_before_the_start_or_end_the_script(start, bench, tmp_path):
    """The limits are those of the robot at each moment; with a timeout the robot receives the motor's command again and
    again.
    """
    robot = start("robot", "--ros-args", "-p", "motor.max_speed:=60.0", "-p", "command.timeout:=0.5")
    controller = start("controller", write(tmp_path, """
entries:
  - {for: 0.5, motor_speed: 50.0}
  - {for: 0.5, upper_gap: 0.07}
"""))
    assert controller.end() == 2
    assert controller.lines[-1] == (
        "controller: script.yaml: entry 2: /upper_gap: 0.07 is out of range; give a number from -0.06 to 0.06 m (the "
        "limit is the rod's length); /vibro_robot refuses it")
    goes_on = start("controller", write(tmp_path, "entries: [{for: 1.5, motor_speed: 30.0}]\n"))
    assert goes_on.end() == 0
    assert goes_on.lines[-1].endswith("script done; /motor_speed is at 30 rad/s, and command.timeout of /vibro_robot "
                                      "stops the motor in 0.5 s")
    robot.wait_for("command.timeout: no command of the motor on /motor_speed or /joint_commands for 0.5 s")
    controller = start("controller", write(tmp_path, "entries: [{for: 2, motor_speed: 20}, {for: 1, motor_speed: 55}]"))
    controller.wait_for("entry 1, ")
    set_parameter(bench, "motor.max_speed", 40.0)
    assert controller.end() == 1
    assert controller.lines[-1] == (
        "controller: /motor_speed: 55 is out of range; give a number from -40 to 40 rad/s (the limit is "
        "motor.max_speed); /vibro_robot refuses it")
    assert controller.lines[-2].endswith("aborted: /motor_speed 0 rad/s")
    stop(robot)
    assert " 0 commands refused" in robot.lines[-1] and robot.text.count("command.timeout: ") == 1
    (bag,) = (read_bag(folder) for folder in tmp_path.glob("vibro_robot_*"))
    assert list(bag["motor_speed"]["value"]).count(30.0) == 10
