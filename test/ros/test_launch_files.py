"""The launch files of examples/, run by `launch` itself where it is installed, and the page that shows them.

`launch` is not on PyPI. With ROS 2 from apt it is there; beside the wheels the sources of ros2/launch and
ros2/launch_ros serve, on PYTHONPATH with their dependencies.
"""

import importlib.util
import os
import re
import signal
from pathlib import Path

import guide
import pytest
from nav_msgs.msg import Odometry

from vibro_ros.process.executables import EXECUTABLES

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
FILES = sorted((EXAMPLES / "launch").glob("*.launch.py"))
LAUNCH = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription as Include
arguments = [word.split(":=", 1) for word in sys.argv[2:]]
service = LaunchService(argv=sys.argv[2:])
service.include_launch_description(LaunchDescription([Include(sys.argv[1], launch_arguments=arguments)]))
sys.exit(service.run())
"""
"""What `ros2 launch FILE name:=value` does, whose package ros2cli is not needed for it."""
with_launch = pytest.mark.skipif(not importlib.util.find_spec("launch_ros"), reason="launch_ros is not on PyPI")


@pytest.fixture
def launch(start, tmp_path):
    def start_file(name: str, *arguments: str, wrapper=()):
        file = str(EXAMPLES / "launch" / f"{name}.launch.py")
        return start("-c", LAUNCH, file, *arguments, wrapper=["setsid", *wrapper])  # a group, as a shell makes
    return start_file


def ends_well(launched) -> None:
    """After Ctrl-C, which a terminal sends to the whole group, no process is reported to have died."""
    os.killpg(launched.pid, signal.SIGINT)
    assert launched.end() == 0, launched.text
    assert "process has died" not in launched.text and "[ERROR]" not in launched.text, launched.text


@with_launch
def test_a_robot_takes_namespace_file_and_prefix(launch, bench, tmp_path):
    (tmp_path / "slow.yaml").write_text("/**:\n  ros__parameters:\n    rate.publish: 50.0\n    scene: rigid\n")
    robot = launch("robot", "namespace:=r1", f"params_file:={tmp_path / 'slow.yaml'}", "frame_prefix:=r1/",
                   "record_directory:=bags/here")
    assert "scene rigid" in robot.wait_for("[r1.vibro_robot]: scene")
    frames: list[str] = []
    bench.node.create_subscription(Odometry, "/r1/odom", lambda message: frames.append(message.header.frame_id), 10)
    bench.spin_until(lambda: bool(frames), "odometry")
    assert frames[0] == "r1/odom" and "ready: 50 Hz" in robot.wait_for("ready")
    ends_well(robot)
    assert list((tmp_path / "bags" / "here").glob("vibro_robot_r1_*"))


@with_launch
def test_a_robot_takes_another_programs_time(launch):
    robot = launch("robot", "use_sim_time:=true", "scene:=damped")
    robot.wait_for("use_sim_time: waiting for the first time on /clock")
    ends_well(robot)


@with_launch
def test_two_robots_and_their_controllers_end_without_a_warning(launch):
    robots = launch("two_robots")
    for name in ("r1", "r2"):
        robots.wait_for(f"[{name}.vibro_controller]: entry 1")
    ends_well(robots)
    assert robots.text.count("vibro_controller]: aborted: ") == 2


@with_launch
@pytest.mark.parametrize("to_stdout", ["0", "1"])
def test_lock_step_begins_with_the_script_and_ends_with_it(launch, tmp_path, to_stdout):
    script = tmp_path / "short.yaml"
    script.write_text("entries:\n  - {for: 0.5, motor_speed: 50.0}\n  - {for: 0.5, motor_speed: 0.0}\n")
    launched = launch("lock_step", f"script:={script}", "namespace:=r1",
                      wrapper=["env", f"RCUTILS_LOGGING_USE_STDOUT={to_stdout}"])
    assert launched.end() == 0, launched.text
    assert "1.000 s simulated" in launched.text and "has died" not in launched.text


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_executables_and_files_that_a_launch_file_names_exist(file):
    text = file.read_text()
    for package, executable in re.findall(r'package="(\w+)", executable="(\w+)"', text):
        assert package != "vibro_ros" or EXECUTABLES[executable].installed
    paths = re.findall(r", (\"(?:launch|config)\"[^]]+)\]", text)
    for folder, *rest in (re.findall(r'"([^"]+)"', path) for path in paths):
        assert (EXAMPLES if folder == "launch" else EXAMPLES.parent).joinpath(folder, *rest).is_file()


def test_the_page_shows_the_first_node_and_every_launch_file():
    page = guide.PAGES["begin.md"]
    assert f"```py\n{(EXAMPLES / 'first_node.py').read_text()}```\n" in page
    assert {name for name in guide.first_column("file", "starts")} == {file.name for file in FILES}
