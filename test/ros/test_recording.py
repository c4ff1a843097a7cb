"""The robot's bags over a run: killed, on a failing disk, on request, in part; and what /diagnostics says of them."""

import contextlib
import json
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rosbags.rosbag2 import Reader
from std_msgs.msg import Float64
from std_srvs.srv import SetBool

import vibro_ros
from vibro_ros.bag.definitions import defined
from vibro_ros.bag.reader import read_bag
from vibro_ros.bag.recovery import recover
from vibro_ros.bag.writer import BagWriter, Storage
from vibro_ros.ros.inputs import Inputs
from vibro_ros.ros.outputs import Outputs
from vibro_ros.ros.recording import Plan, offer_recovery, open_recording, plan_recording
from vibro_ros.scene_file import DEVICE_PARAMETERS

UNLIMITED = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
LONGEST_LOSS = 0.15  # [s] what the issue allows
SETTINGS = {parameter.name: parameter.default for parameter in DEVICE_PARAMETERS}


@pytest.fixture(scope="module", autouse=True)
def _compiled():
    """Kernels in the cache, so that no test's patience is spent on compiling."""
    vibro_ros.simulator.compile_kernels()


@pytest.fixture
def record(bench):
    """Call the robot's service ~/record; whether it was done, and the answer's words."""
    client = bench.node.create_client(SetBool, "/vibro_robot/record")

    def call(on: bool) -> tuple[bool, str]:
        bench.spin_until(client.service_is_ready, "~/record")
        future = client.call_async(SetBool.Request(data=on))
        bench.spin_until(future.done, "answer of ~/record")
        return future.result().success, future.result().message
    return call


class Listener:
    """Keeps the stamps [ns] of odom and the latest diagnostics by part."""

    def __init__(self, bench):
        self.bench = bench
        self.stamps: list[int] = []
        self.parts: dict[str, DiagnosticStatus] = {}
        bench.node.create_subscription(Odometry, "odom", self._hear, QoSProfile(depth=10_000), raw=True)
        bench.node.create_subscription(DiagnosticArray, "/diagnostics", self._learn, 10)

    def _hear(self, data: bytes) -> None:
        stamp = deserialize_message(data, Odometry).header.stamp
        self.stamps.append(stamp.sec * 10**9 + stamp.nanosec)

    def _learn(self, message: DiagnosticArray) -> None:
        self.parts |= {status.name: status for status in message.status}

    def spin_for_samples(self, count: int) -> None:
        until = len(self.stamps) + count
        self.bench.spin_until(lambda: len(self.stamps) >= until, f"{count} samples")

    def wait_for_status(self, part: str, condition) -> tuple[DiagnosticStatus, dict[str, str]]:
        name = f"vibro_robot: {part}"
        self.bench.spin_until(lambda: name in self.parts and condition(self.parts[name]), f"status of {part}")
        return self.parts[name], {pair.key: pair.value for pair in self.parts[name].values}


@pytest.fixture
def listener(bench):
    return Listener(bench)


def bags(folder: Path) -> list[Path]:
    return sorted(folder.glob("vibro_robot_*"), key=lambda path: path.stat().st_mtime_ns)


def stamps_of(folder: Path, topic: str = "/odom") -> list[int]:
    with Reader(folder) as reader:
        chosen = [one for one in reader.connections if one.topic == topic]
        return [stamp for _, stamp, _ in reader.messages(chosen)]


def stop(robot, code: int = 0) -> None:
    robot.send(signal.SIGINT)
    assert robot.end() == code, robot.text
    assert "Traceback" not in robot.text


@pytest.mark.parametrize("rate", [50.0, 1000.0])
def test_a_killed_robot_loses_the_last_moments_and_the_next_one_tells_how_to_seal(start, listener, tmp_path, rate):
    robot = start("robot", "--ros-args", "-p", f"rate.publish:={rate}")
    listener.spin_for_samples(1)
    end = time.monotonic() + random.uniform(0.1, 1.0)
    while time.monotonic() < end:
        listener.spin_for_samples(1)
    robot.kill()
    with contextlib.suppress(AssertionError):  # what was still on its way
        listener.bench.spin_until(lambda: False, "the rest", patience=0.3)
    (folder,) = bags(tmp_path)
    if rate == 50.0:
        following = start("robot")
        assert "[WARN]" in following.wait_for(f"{folder.name}: not sealed, its robot was killed; seal it with `recover")
        following.wait_for("ready")
        stop(following)
    assert not recover(folder).was_sealed
    recorded, heard = stamps_of(folder), listener.stamps
    assert recorded == [recorded[0] + i * round(1e9 / rate) for i in range(len(recorded))]
    assert (heard[-1] - recorded[-1]) * 1e-9 <= LONGEST_LOSS
    bag = read_bag(folder)
    assert json.loads(bag.metadata["parameters"])["rate.publish"] == rate
    assert "exact" in bag.metadata["solver"] and bag.metadata["version"] and "numpy" in bag.metadata["platform"]


def test_recording_is_sealed_and_begun_on_request(start, listener, record, tmp_path):
    robot = start("robot")
    listener.spin_for_samples(20)
    done, said = record(True)
    assert done and said.startswith("already recording to vibro_robot_")
    done, said = record(False)
    assert done and re.fullmatch(r"sealed vibro_robot_\S+: \d+ messages, 0 dropped", said)
    (first,) = bags(tmp_path)
    assert first.name in said
    assert f": {sum(topic.messages for topic in read_bag(first).topics.values())} messages" in said
    assert record(False) == (True, "not recording")
    status, _ = listener.wait_for_status("recorder", lambda status: status.message == "not recording")
    assert status.level == DiagnosticStatus.OK
    listener.spin_for_samples(20)
    done, said = record(True)
    assert done and said.startswith("recording to vibro_robot_")
    listener.spin_for_samples(20)
    stop(robot)
    assert bags(tmp_path)[0] == first and len(bags(tmp_path)) == 2
    last = bags(tmp_path)[1]
    assert f"bag {last.name}: " in robot.lines[-1]
    gap = stamps_of(last)[0] - stamps_of(first)[-1]
    assert gap >= 20 * 5_000_000  # [ns] the samples between


def test_a_full_disk_is_told_once_and_recording_resumes_when_there_is_room(start, listener, record, tmp_path):
    robot = start("robot")
    listener.spin_for_samples(50)
    resource.prlimit(robot.pid, resource.RLIMIT_FSIZE, (1, resource.RLIM_INFINITY))  # [bytes] no write succeeds
    line = robot.wait_for("not recorded: recording to vibro_robot_")
    assert "[ERROR]" in line and "File too large" in line and "~/record" in line
    status, values = listener.wait_for_status("recorder", lambda status: status.level == DiagnosticStatus.ERROR)
    assert "File too large" in status.message and values["fault"] == status.message
    assert int(values["lost"]) > 0 and int(values["dropped"]) > 0
    done, said = record(True)
    assert not done and "cannot record to" in said and "File too large" in said
    (first,) = bags(tmp_path)  # nothing is left of the attempt
    resource.prlimit(robot.pid, resource.RLIMIT_FSIZE, UNLIMITED)
    assert record(True)[0]
    listener.spin_for_samples(20)
    stop(robot, code=1)
    assert len([line for line in robot.lines if "[ERROR]" in line]) == 1
    assert "0.000 s dropped in 0 stalls" in robot.lines[-2]
    assert robot.lines[-1].startswith("robot: recording to vibro_robot_")
    recover(first)
    second = bags(tmp_path)[1]
    assert len(stamps_of(first)) >= 10 and len(stamps_of(second)) >= 20
    assert all(len(set(b - a for a, b in zip(found, found[1:], strict=False))) == 1
               for found in (stamps_of(first), stamps_of(second)))


def test_a_removed_folder_is_told_once_and_the_robot_goes_on(start, listener, record, tmp_path):
    robot = start("robot")
    listener.spin_for_samples(20)
    (folder,) = bags(tmp_path)
    shutil.rmtree(folder)
    assert "No such file or directory; the folder is gone" in robot.wait_for("not recorded: ")
    listener.spin_for_samples(50)
    done, said = record(False)
    assert done and said.startswith("not recording: recording to vibro_robot_")
    assert record(True)[0]
    listener.spin_for_samples(20)
    stop(robot, code=1)
    assert robot.text.count("not recorded: ") == 1
    (folder,) = bags(tmp_path)
    assert len(stamps_of(folder)) >= 20


SLOW = """
import sys, time
from vibro_ros.bag.mcap_segment import McapSegment
from vibro_ros.ros import robot
append, stalled = McapSegment._append, []
def slow(self, data):  # waits for the disk as a write does: without the interpreter lock
    if not stalled and self.stored > 1000:
        stalled.append(True)
        time.sleep(2.0)
    append(self, data)
McapSegment._append = slow
code = robot.main(["--ros-args", "-p", "rate.publish:=1000.0"])
print("stalled" if stalled else "never stalled")
sys.exit(code)
"""


def test_a_disk_that_stalls_for_two_seconds_costs_no_message_and_no_time(listener, tmp_path, domain_id):
    robot = subprocess.Popen([sys.executable, "-c", SLOW], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                             cwd=tmp_path)
    try:
        listener.spin_for_samples(3500)
        robot.send_signal(signal.SIGINT)
        said, _ = robot.communicate(timeout=60)
    finally:
        robot.kill()
    assert robot.returncode == 0 and said.rstrip().endswith("\nstalled"), said
    assert " 0 dropped; " in said and "not recorded" not in said
    (folder,) = bags(tmp_path)
    recorded = stamps_of(folder)
    # a machine too busy to run the robot at all drops time, but that leaves no hole in the stamps
    assert recorded == [recorded[0] + i * 1_000_000 for i in range(len(recorded))]
    assert len(recorded) >= 3500


def test_all_topics_at_1_khz_in_small_files_drop_nothing(start, listener, tmp_path):
    robot = start("robot", "--ros-args", "-p", "rate.publish:=1000.0", "-p", "record.max_duration:=0.5",
                  "-p", "record.compression:=zstd", "-p", "motor.speed:=100.0")
    listener.spin_for_samples(2000)
    stop(robot)
    assert " 0 dropped; " in robot.lines[-1]
    (folder,) = bags(tmp_path)
    recorded = stamps_of(folder)
    assert recorded == [recorded[0] + i * 1_000_000 for i in range(len(recorded))]
    assert len(list(folder.glob("*.mcap"))) >= 4
    assert read_bag(folder).metadata["dropped"] == "0"


def test_only_the_topics_asked_for_are_recorded(start, listener, tmp_path):
    robot = start("robot", "--ros-args", "-p", "record.topics:=[odom, /motor_speed]", "-p", "record.storage:=sqlite3")
    listener.spin_for_samples(20)
    stop(robot)
    (folder,) = bags(tmp_path)
    assert set(read_bag(folder).topics) == {"/odom", "/motor_speed"}
    assert [path.suffix for path in folder.iterdir() if path.name != "metadata.yaml"] == [".db3"]


@pytest.mark.parametrize("wrong, reason", [
    ({"record.topics": ("odmo",)}, "record.topics: 'odmo' is not a topic of the robot; choose from odom, joint_states"),
    ({"record.max_size": 5.0}, "record.max_size: 5 is too small; give 0 for no limit, or at least 100000 bytes"),
    ({"record.storage": "sqlite3", "record.compression": "zstd"}, "record.compression: zstd goes with record.storage"),
], ids=["topic", "size", "compression"])
def test_recordings_that_cannot_be_are_refused(bench, wrong, reason):
    with pytest.raises(ValueError, match=re.escape(reason)):
        plan_recording(SETTINGS | wrong, Inputs(bench.node), Outputs(bench.node, vibro_ros.Scene()), {})


def test_bags_left_unsealed_are_sealed_if_the_robot_is_told_to(bench, tmp_path):
    topics = plan_recording(SETTINGS, Inputs(bench.node), Outputs(bench.node, vibro_ros.Scene()), {}).topics
    folder = tmp_path / "vibro_robot_1"
    writer = BagWriter(folder, defined(topics), {}, Storage())
    writer.write(1, 1, bytes(100))
    writer.flush()
    offer_recovery(tmp_path, True, bench.node.get_logger())
    assert not (folder / "metadata.yaml").exists()  # it is in use
    writer.abandon()
    offer_recovery(tmp_path, False, bench.node.get_logger())
    assert not (folder / "metadata.yaml").exists()
    offer_recovery(tmp_path, True, bench.node.get_logger())
    assert stamps_of(folder, topics[0].name) == [1]


def test_a_snapshot_holds_the_last_seconds_when_it_is_asked_for(start, listener, record, tmp_path):
    robot = start("robot", "--ros-args", "-p", "record.snapshot:=0.5")
    assert "keeping the last 0.5 s" in robot.wait_for("ready")
    listener.spin_for_samples(200)  # 1 s
    assert bags(tmp_path) == []
    done, said = record(True)
    assert done and said.startswith("writing the last 0.5 s, ")
    listener.spin_for_samples(20)
    stop(robot)
    (folder,) = bags(tmp_path)
    assert folder.name in said
    recorded = stamps_of(folder)
    assert len(recorded) == 101  # at 200 Hz, both ends included
    assert f" {sum(topic.messages for topic in read_bag(folder).topics.values())} messages" in said


def test_a_snapshot_is_written_when_the_simulation_fails(bench, tmp_path):
    topics = plan_recording(SETTINGS, Inputs(bench.node), Outputs(bench.node, vibro_ros.Scene()), {}).topics
    plan = Plan(tmp_path, topics, Storage(), {"scene": "device"}, snapshot=1.0)
    with open_recording(plan, True, bench.node.get_logger()) as recording:
        for i in range(300):
            recording.record("/motor_power", i * 10_000_000, bytes(12))
        recording.save(vibro_ros.SimulationError("at 3 s in mode slip: stuck"))
    (folder,) = bags(tmp_path)
    assert stamps_of(folder, "/motor_power") == [i * 10_000_000 for i in range(199, 300)]
    assert read_bag(folder).metadata["error"] == "at 3 s in mode slip: stuck"


@pytest.mark.parametrize(("asked", "method"), [("moreau", "moreau"), ("auto", "exact")])
def test_the_node_runs_by_the_method_asked_for(start, listener, bench, tmp_path, asked, method):
    robot = start("robot", "--ros-args", "-p", "motor.speed:=100.0", "-p", f"solver.method:={asked}",
                  "-p", "solver.step:=5.0e-5", "-p", "solver.accuracy:=1.0e-5")
    _, values = listener.wait_for_status("simulation", lambda status: status.level == DiagnosticStatus.OK)
    assert values["solver method"] == method
    assert values.get("solver step [s]") == ("5e-05" if method == "moreau" else None)
    assert values.get("solver accuracy asked for [m]") == ("1e-05" if asked == "auto" else None)
    assert values.get("solver choice", "").startswith("exact: no step" if asked == "auto" else "")
    stop(robot)
    (folder,) = bags(tmp_path)
    metadata = read_bag(folder, {}).metadata
    assert (metadata["scene"], metadata["version"] != "") == ("device", True)
    assert metadata["solver"] == ("moreau, step 5e-05 s" if method == "moreau" else "exact, tolerance 1e-09 m")


def test_diagnostics_tell_how_it_goes(start, listener, bench):
    robot = start("robot", "--ros-args", "-p", "motor.speed:=100.0")
    speed = bench.node.create_publisher(Float64, "motor_speed", 10)
    status, values = listener.wait_for_status("simulation", lambda status: status.level == DiagnosticStatus.OK)
    assert status.hardware_id == "/vibro_robot"
    assert float(values["real-time factor"]) > 0.2  # on however busy a machine
    assert 0.1 < float(values["cost of a step [us]"]) < 1e5
    assert float(values["events per second"]) > 10
    assert (values["solver method"], values["solver tolerance [m]"]) == ("exact", "1e-09")
    assert abs(float(values["energy residual [J]"])) < 1e-6
    assert int(values["missed deadlines"]) >= 0
    bench.spin_until(lambda: speed.get_subscription_count() > 0, "robot up")
    speed.publish(Float64(data=-1.0))
    status, values = listener.wait_for_status("simulation", lambda status: "commands refused" in status.message)
    assert (status.level, values["rejected commands"]) == (DiagnosticStatus.WARN, "1")
    status, values = listener.wait_for_status("recorder", lambda status: True)
    assert (status.level, values["dropped"], values["lost"]) == (DiagnosticStatus.OK, "0", "0")
    assert int(values["written"]) > 0 and int(values["backlog"]) >= 0 and values["fault"] == ""
    robot.send(signal.SIGSTOP)
    time.sleep(0.5)  # the stall itself
    robot.send(signal.SIGCONT)
    status, values = listener.wait_for_status("simulation", lambda status: "dropped" in status.message)
    assert status.level == DiagnosticStatus.WARN and float(values["dropped time [s]"]) > 0.3
    stop(robot)
