"""Start and end of robot and controller: closed terminals, pipes without a reader, the first stamp."""

import fcntl
import os
import pty
import re
import signal
import subprocess
import sys
import termios
import threading
import time
from contextlib import closing
from functools import partial
from pathlib import Path

import pytest
from nav_msgs.msg import Odometry
from observation import stop
from rclpy.node import Node
from std_msgs.msg import Float64

from vibro_ros.bag.reader import read_bag
from vibro_ros.configuration.scene_file import NODE_NAME
from vibro_ros.process.entry_point import StopRequest
from vibro_ros.ros.controller import player
from vibro_ros.ros.node import process

HEAVY = {
    "PIL", "em", "lark", "matplotlib", "scipy", "tornado", "tqdm", "vibro_lab",
    "vibro_ros.recordings.report", "vibro_ros.view"}
"""Modules that neither a robot nor a simulation needs, each of which costs tens of milliseconds or megabytes."""
OF_NO_SIMULATION = HEAVY | {"lz4", "mcap", "rclpy", "rosbags", "vibro_ros.bag", "xml", "zstandard"}
PROMPT = 10.0  # [s] deadline of what takes 0.1 s on an idle machine
LATE = 0.03  # [s] of the promptest of the first messages; opening a bag alone took 0.07 s when stamps lagged by it


@pytest.mark.quiet
def test_stamps_are_those_of_the_wall_clock(start, bench):
    late: list[float] = []
    bench.node.create_subscription(Odometry, "odom", lambda message: late.append(
        time.time() - message.header.stamp.sec - 1e-9 * message.header.stamp.nanosec), 100)
    robot = start("robot")
    bench.spin_until(lambda: len(late) >= 20, "odom")
    stop(robot)
    dropped = float(robot.lines[-1].split(" simulated, ")[1].split(" s dropped")[0])  # by a machine that is too busy
    assert -1e-3 < min(late) < LATE + dropped  # [s] 1e-3 for the rounding of clocks


def test_closing_the_robots_terminal_seals_the_bag(domain_id, tmp_path):
    """The robot leads the session of its terminal, as in a shell's window."""
    terminal, slave = pty.openpty()
    robot = subprocess.Popen([sys.executable, "-m", "vibro_ros.ros.robot.robot"], cwd=tmp_path, stdin=slave,
                             stdout=slave, stderr=slave, start_new_session=True,
                             preexec_fn=lambda: fcntl.ioctl(slave, termios.TIOCSCTTY, 0))
    try:
        os.close(slave)
        said = b""
        while b"ready: " not in said:
            said += os.read(terminal, 4096)  # OSError when the robot ends before
        os.close(terminal)
        assert robot.wait(PROMPT) == 0
    finally:
        robot.kill()
        robot.wait()
    (folder,) = tmp_path.glob("vibro_robot_*")
    assert len(read_bag(folder)["odom"]["time"])


def test_a_closed_pipe_does_not_end_the_robot(domain_id, tmp_path, bench):
    robot = subprocess.Popen([sys.executable, "-m", "vibro_ros.ros.robot.robot"], cwd=tmp_path, stdout=subprocess.PIPE,
                             stderr=subprocess.STDOUT, text=True)
    try:
        with closing(robot.stdout):
            assert "]: scene " in robot.stdout.readline()
        heard = []
        bench.node.create_subscription(Odometry, "odom", heard.append, 100)
        publisher = bench.node.create_publisher(Float64, "motor_speed", 10)
        bench.spin_until(lambda: heard and publisher.get_subscription_count(), "robot up")
        publisher.publish(Float64(data=-501.0))  # refused, which it says to nobody
        count = len(heard)
        bench.spin_until(lambda: len(heard) > count + 50, "odom after that")
        robot.send_signal(signal.SIGTERM)
        assert robot.wait(PROMPT) == 0
    finally:
        robot.kill()
        robot.wait()
    (folder,) = tmp_path.glob("vibro_robot_*")
    assert read_bag(folder)["motor_speed"]["value"].tolist() == [-501.0]


def test_the_wait_for_a_robot_is_logged_repeatedly(bench, monkeypatch, capfd):
    monkeypatch.setattr(player, "REPORT_PERIOD", 0.05)
    publisher = bench.node.create_publisher(Float64, "motor_speed", 10)
    with StopRequest() as request, pytest.raises(RuntimeError) as error:
        player.wait_for_listeners(bench.node, [publisher], 0.5, request)
    assert str(error.value) == ("no robot listens to /motor_speed after 0.5 s; start one (ros2 run vibro_ros robot), "
                                "in the same ROS domain and namespace")
    said = capfd.readouterr().err
    assert "waiting up to 0.5 s for a robot on /motor_speed" in said
    assert said.count("s: nobody listens to /motor_speed; start one (ros2 run vibro_ros robot)") > 2
    robot = Node(NODE_NAME, context=bench.node.context)  # which is there and does not listen
    bench.spin_until(lambda: NODE_NAME in bench.node.get_node_names(), "robot in the graph")
    with StopRequest() as request, pytest.raises(RuntimeError, match="; /vibro_robot is there and does not: it"):
        player.wait_for_listeners(bench.node, [publisher], 0.1, request)
    robot.destroy_node()


@pytest.mark.parametrize("variable, value, reason", [
    ("HOME", None, "HOME is not set"),
    ("ROS_LOG_DIR", "/dev/null/logs", "/dev/null/logs: Not a directory"),
])
def test_a_node_without_a_log_folder_runs(domain_id, monkeypatch, capfd, variable, value, reason):
    monkeypatch.delenv("ROS_LOG_DIR", raising=False)
    monkeypatch.delenv("ROS_HOME", raising=False)
    monkeypatch.setenv(variable, value) if value else monkeypatch.delenv(variable)
    with process.node_running("robot", ()) as node:
        process.spin_once(node, 0.1)
    said = capfd.readouterr().err
    assert f"ROS writes no log file: {reason}; set ROS_LOG_DIR to a folder that can be written" in said


def test_a_signal_and_the_end_of_work_end_a_wait_of_minutes(domain_id):
    """Else a robot would have to look at its stop request many times a second, at half a millisecond each."""
    begun = time.monotonic()
    with StopRequest() as request, process.node_running("robot", ()) as node:
        work = process.in_thread(partial(time.sleep, 0.2), process.waker(node))
        process.spin_until(node, work.done, 100.0)
        killer = threading.Timer(0.2, partial(os.kill, os.getpid(), signal.SIGTERM))
        killer.start()
        process.spin_until(node, lambda: bool(request), 100.0)
        killer.join()
    assert time.monotonic() - begun < 50.0  # either wait alone would last 100 s


def test_a_robot_that_runs_and_records_has_loaded_only_what_it_needs(start, listener):
    """A robot starts in a second and takes 90 MB because of this; what a client calls may load more."""
    program = ("import atexit, sys; from vibro_ros.process.entry_point import enter; "
               "atexit.register(lambda: print('modules:', *(name for name in sys.modules if sys.modules[name]))); "
               "sys.exit(enter('robot'))")
    robot = start("-c", program, "--ros-args", "-p", "rate.publish:=200.0")
    listener.spin_for_samples(400)  # diagnostics are published once a second
    resident = re.search(r"VmRSS:\s+(\d+) kB", Path(f"/proc/{robot.pid}/status").read_text())
    stop(robot)
    loaded = set(robot.wait_for("modules: ").split())
    assert loaded & {"rclpy", "vibro_ros.bag.recorder"} and loaded & (HEAVY | {"_hashlib", "numpy.ma"}) == set()
    assert int(resident[1]) < 90 * 1024  # with the types of simulation_interfaces, which take 2 MB


def test_a_simulation_has_loaded_only_what_it_needs():
    program = ("import sys, vibro_ros; vibro_ros.simulate(vibro_ros.load_scene('damped'), duration=0.1, rate=100.0); "
               "print(*sys.modules)")
    loaded = set(subprocess.run([sys.executable, "-c", program], check=True, text=True, capture_output=True)
                 .stdout.split())
    assert "vibro_ros.solver.core" in loaded and loaded & OF_NO_SIMULATION == set()
