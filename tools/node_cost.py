"""Processor load of the robot with recording, by part, and its start time, compared with a bare rclpy node.

The bare node has a publisher for each topic with every sample, a thread that publishes prepared messages, and an
executor in the main thread, as every node; it neither simulates nor records. A node of parts does in such a thread what
the robot does in a tick, up to one of `PARTS`; a part costs what this adds to the parts before it. All of them run in
their own processes, alternately and with the same priority, so that other load of the machine affects them alike. A
start lasts until the first odometry. A lateness is the time by which a wait for the next sample ends too late, while
commands arrive as often as samples are due.
"""

import argparse
import os
import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TransformStamped, WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from tqdm import tqdm

from tools.child import Child
from vibro_ros.bag.recorder import Recorder
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.messages.frames import ALL
from vibro_ros.messages.robot_messages import RobotMessages
from vibro_ros.ros.node.node import qos_profile
from vibro_ros.ros.robot.pacing import RobotTime, set_real_time_priority
from vibro_ros.ros.robot.recording import recorded_topic
from vibro_ros.ros.robot.run import RobotPublishers
from vibro_ros.sensors.device import new_device

RATES = (1000.0, 200.0)  # Hz
ROUNDS, STARTS = 5, 3  # repetitions of the measurements of load, and of start times
LATENESSES = 20  # s of lateness
SETTLING, DURATION = 3.0, 5.0  # s, time before and of each measurement
BARE = "bare node"
#: What a tick of the robot consists of, in order; the rest of a running robot are commands, services and diagnostics.
PARTS = ("waiting", "physics", "messages", "publishing", "recording")
PARTS_RATE = 1000.0  # Hz
#: Motor speed [rad/s] of the robot's cases.
SPEEDS = {"running": 100.0, "standing still": 0.0}
_PATIENCE = 600.0  # s, longest start
_SCHEDULED = 2  # kind of Linux' clock of another process that the C library's clock_getcpuclockid gives
_PARENTS = {"base_link": "odom", "crank": "base_link", "upper_rod": "crank", "inclined_rod": "crank",
            "upper_mass": "upper_guide", "inclined_mass": "inclined_guide", "upper_plate": "upper_guide",
            "inclined_plate": "inclined_guide"}
_JOINTS = ["crank", "upper_mass", "inclined_mass", "upper_plate", "inclined_plate"]


def main(words: Sequence[str]) -> int:
    """Measure and print the tables, or run as the bare node."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bare", type=float, metavar="RATE", help="be the bare node, publishing at this rate [Hz]")
    parser.add_argument("--namespace", default="", help="of the bare node")
    parser.add_argument("--part", choices=PARTS, help="be the node of parts up to this one instead")
    options = parser.parse_args(words)
    if options.bare:
        return _publish(options.bare, options.namespace, options.part)
    cases = [(rate, case) for rate in RATES for case in (BARE, *SPEEDS)] + [(PARTS_RATE, part) for part in PARTS]
    shares_of: dict[tuple[float, str], list[float]] = {case: [] for case in cases}
    for rate, case in tqdm(cases * ROUNDS, unit="process", disable=None):
        shares_of[rate, case].append(_share(rate, case))
    print(f"{table(shares_of)}\n\n{parts_table(shares_of)}\n\n{starts()}\n\n{latenesses()}")
    return 0


def table(shares_of: Mapping[tuple[float, str], Sequence[float]]) -> str:
    """Return the table of loads in Markdown: medians over the rounds of core shares and of ratios to the bare node."""
    rows = ["| rate | bare node | robot | of a core | bare node = 1 |", "|---" * 5 + "|"]
    for rate in dict.fromkeys(rate for rate, _ in shares_of):
        bare = shares_of[rate, BARE]
        for case in SPEEDS:
            robot = shares_of[rate, case]
            ratio = statistics.median(of_robot / of_bare for of_robot, of_bare in zip(robot, bare, strict=True))
            rows.append(f"| {rate:g} Hz | {100.0 * statistics.median(bare):.1f} % | {case} | "
                        f"{100.0 * statistics.median(robot):.1f} % | {ratio:.2f} |")
    return "\n".join([*rows, "", f"medians of {len(bare)} rounds"])


def parts_table(shares_of: Mapping[tuple[float, str], Sequence[float]]) -> str:
    """Return the table of parts in Markdown: medians over the rounds of core shares and of ratios to the bare node."""
    rows = [f"| part of the robot at {PARTS_RATE:g} Hz | of a core | bare node = 1 |", "|---" * 3 + "|"]
    bare, running = (shares_of[PARTS_RATE, case] for case in (BARE, "running"))
    upto = [[0.0] * len(bare), *(shares_of[PARTS_RATE, part] for part in PARTS), running]
    for name, (shares_without, shares_with) in zip((*PARTS, "the rest"), pairwise(upto), strict=True):
        shares = [with_part - without for with_part, without in zip(shares_with, shares_without, strict=True)]
        ratio = statistics.median(share / of_bare for share, of_bare in zip(shares, bare, strict=True))
        rows.append(f"| {name} | {100.0 * statistics.median(shares):.1f} % | {ratio:.2f} |")
    return "\n".join(rows)


def _share(rate: float, case: str) -> float:
    """Measure the share of a core that a case uses after it has settled."""
    with tempfile.TemporaryDirectory() as folder, Child(*_words(rate, case, folder), shown=False) as child:
        child.wait_for("ready")
        time.sleep(SETTLING)
        begun, earlier_time = time.monotonic(), _processor_time(child)
        time.sleep(DURATION)
        return (_processor_time(child) - earlier_time) / (time.monotonic() - begun)


def starts() -> str:
    """Measure start times, and return the table of their medians [s] in Markdown."""
    times_of: dict[str, list[float]] = {"robot": [], BARE: []}
    for _ in range(STARTS):
        for name, times in times_of.items():
            times.append(_start("running" if name != BARE else BARE))
    return "\n".join(["| what starts | until its first odometry |", "|---|---|",
                      *(f"| {name} | {statistics.median(times):.1f} s |" for name, times in times_of.items() if times)])


def _start(case: str) -> float:
    """Measure the time [s] from the command of a case to its first odometry."""
    context, heard = rclpy.Context(), list[Odometry]()
    rclpy.init(args=[], context=context)
    node = Node("node_cost", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    namespace = f"/node_cost_{os.getpid()}_{time.monotonic_ns()}"  # not used by an earlier process
    node.create_subscription(Odometry, f"{namespace}/odom", heard.append, qos_profile("odom"))
    try:
        with tempfile.TemporaryDirectory() as folder:
            begun = time.monotonic()
            words = _words(200.0, case, folder)
            words += ["-r", f"__ns:={namespace}"] if case != BARE else ["--namespace", namespace]
            with Child(*words, shown=False) as child:
                while not heard and child.exit_code is None and time.monotonic() - begun < _PATIENCE:
                    executor.spin_once(timeout_sec=0.01)
                if not heard:
                    raise RuntimeError(f"{case}: no odometry within {_PATIENCE:g} s, or it has ended")
                return time.monotonic() - begun
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown(context=context)


def latenesses() -> str:
    """Measure the lateness of a robot that takes commands at its own rate, and return a table of it in Markdown."""
    rows: list[dict[str, str]] = []
    rclpy.init(args=[])
    node = Node("node_cost")
    commands = node.create_publisher(Float64, "motor_speed", qos_profile("motor_speed"))

    def keep(message: DiagnosticArray) -> None:
        rows.extend({entry.key: entry.value for entry in status.values} for status in message.status
                    if status.name.endswith("simulation"))

    node.create_subscription(DiagnosticArray, "/diagnostics", keep, qos_profile("diagnostics"))
    node.create_timer(1.0 / PARTS_RATE, lambda: commands.publish(Float64(data=SPEEDS["running"])))
    with tempfile.TemporaryDirectory() as folder, Child(*_words(PARTS_RATE, "running", folder), shown=False) as child:
        child.wait_for("ready")
        while len(rows) < SETTLING + LATENESSES:  # one a second
            rclpy.spin_once(node)
    node.destroy_node()
    rclpy.try_shutdown()
    title = f"lateness of {LATENESSES} s at {PARTS_RATE:g} Hz"
    lines = [f"| {title}, beside as many commands | median of the seconds | worst second |", "|---" * 3 + "|"]
    for kind in ("median", "p99", "max"):
        values = [float(row[f"lateness {kind} [us]"]) for row in rows[int(SETTLING):]]
        lines.append(f"| {kind} | {statistics.median(values):.0f} us | {max(values):.0f} us |")
    return "\n".join(lines)


def _words(rate: float, case: str, folder: str) -> list[str]:
    """Return the command of a case."""
    if case in (BARE, *PARTS):
        return ["tools.node_cost", "--bare", f"{rate}", *(["--part", case] if case != BARE else [])]
    settings = {"record.directory": f"'{folder}'", "rate.publish": rate, "motor.speed": SPEEDS[case]}
    return ["vibro_ros.ros.robot.robot", "--ros-args",
            *(word for name, value in settings.items() for word in ("-p", f"{name}:={value}"))]


def _processor_time(child: Child) -> float:
    """Processor time [s] of all threads of a process, in user mode and in the kernel."""
    return time.clock_gettime(~child.pid << 3 | _SCHEDULED)


def _publish(rate: float, namespace: str, part: str | None) -> int:
    """Run as the bare node, or as the node of parts up to `part`, until SIGINT."""
    rclpy.init(args=[])
    node = Node("bare_node", namespace=namespace)
    with tempfile.TemporaryDirectory() as folder:
        tick = _parts_of_tick(node, rate, part, Path(folder)) if part else _publishing(node)

        def run() -> None:
            start, ticks = time.monotonic(), 0
            while rclpy.ok():
                tick()
                ticks += 1
                time.sleep(max(0.0, start + ticks / rate - time.monotonic()))

        threading.Thread(target=run, name="publishing", daemon=True).start()
        set_real_time_priority(1.0, paused=False)
        print("ready", flush=True)
        try:
            rclpy.spin(node)
        except (KeyboardInterrupt, ExternalShutdownException):
            pass
        return 0


def _publishing(node: Node) -> Callable[[], None]:
    ready = [(node.create_publisher(type(message), topic, qos_profile(topic)), message)
             for topic, message in ready_messages().items()]

    def tick() -> None:
        for publisher, message in ready:
            publisher.publish(message)

    return tick


def _parts_of_tick(node: Node, rate: float, part: str, folder: Path) -> Callable[[], None]:
    """Return a function that takes the next sample of a running robot, up to `part`."""
    scene = load_scene("device").with_parameters({"motor.speed": SPEEDS["running"]})
    device, messages, robot_time = new_device(scene), RobotMessages(scene), RobotTime(rate, time.time_ns())
    publishers = RobotPublishers(node, scene, transforms=ALL)
    topics = [recorded_topic(name, topic) for name, topic in publishers.topics.items()]
    recorder = Recorder(folder / "bag", topics, {}) if part == "recording" else None
    count = PARTS.index(part)

    def record(*message: Any) -> None:
        if recorder:
            recorder.write(*message)

    def tick() -> None:
        if count:
            device.advance_to(robot_time.due_of_device)
            robot_time.ticks += 1
            values, events = device.values, device.take_events()
        if part == "messages":
            messages.of_sample(values, events, (), robot_time.stamp, robot_time.stamp_of)
        elif count > 2:
            publishers.publish(values, events, robot_time, record)

    return tick


def ready_messages() -> Mapping[str, Any]:
    """Return a message for each topic with every sample, as large as the robot's in the scene `device`."""
    odometry = Odometry(child_frame_id="base_link")
    odometry.header.frame_id = "odom"
    joints = JointState(name=_JOINTS, position=[1.0] * 5, velocity=[2.0] * 5, effort=[3.0] * 5)
    contact = WrenchStamped()
    joints.header.frame_id = contact.header.frame_id = "base_link"
    messages = {"odom": odometry, "joint_states": joints, "ground_contact": contact, "motor_power": Float64(data=1.0)}
    try:
        from tf2_msgs.msg import TFMessage
    except ImportError:
        return messages
    transforms = TFMessage(transforms=[TransformStamped(child_frame_id=child) for child in _PARENTS])
    for transform, parent in zip(transforms.transforms, _PARENTS.values(), strict=True):
        transform.header.frame_id = parent
    return {**messages, "tf": transforms}


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
