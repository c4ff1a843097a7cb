"""Bags that lack the run's beginning: the robot is commanded, changed, disturbed, paused and recorded at random, and
each bag is replayed from each of its checkpoints.
"""

import random
import signal
import time
from collections import Counter
from pathlib import Path

import pytest
from asking import known_client
from observation import bags
from random_run import FASTER, RANGES
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from std_msgs.msg import Float64, String
from std_srvs.srv import SetBool, Trigger
from test_operations import operations_in

from vibro_ros.bag.reader import load_bag
from vibro_ros.bag.stream import BagStream
from vibro_ros.recordings.comparison import compare
from vibro_ros.recordings.energy import energy_of

types = pytest.importorskip("vibro_ros_interfaces.srv", reason="the project's own types are not built")
LIVE = {"ground.friction": (0.0, 0.4), "ground.friction_backward": (-1.0, 0.4), "motor.max_speed": (100.0, 600.0),
        "motor.acceleration": (50.0, 2000.0), "motor.time_constant": (0.01, 0.5), "gap_actuator.speed": (0.001, 0.05),
        "motor.supply_voltage": (20.0, 48.0), "motor.current_limit": (1.0, 20.0), "motor.integral_gain": (0.0, 2.0),
        "rate.real_time_factor": (0.5 * FASTER, 2.0 * FASTER)}
FAULTS = (("motor_stall", "", (0.0, 0.0)), ("plate_stuck", "upper", (0.0, 0.0)),
          ("plate_stuck", "inclined", (0.0, 0.0)), ("friction_patch", "", (0.0, 0.4)),
          ("supply_sag", "", (5.0, 20.0)), ("late_commands", "", (0.01, 0.1)), ("lost_commands", "", (0.0, 0.0)),
          ("sensor_dropout", "tracking", (0.0, 0.0)), ("sensor_freeze", "encoder", (0.0, 0.0)),
          ("sensor_offset", "imu", (-1.0, 1.0)))
SENSORS = ("sensors.preset:=bmi270", "sensors.imu.rate:=400.0", "sensors.encoder.rate:=150.0",
           "sensors.tracking.rate:=60.0", "sensors.tracking.latency:=0.04")


class Cut(BagStream):
    """A bag without the messages before a stamp [ns]."""

    def __init__(self, path: Path, start: int):
        super().__init__(path)
        self.start = max(start, self.start)

    def messages(self, topics: frozenset[str] | None = None):
        return (message for message in super().messages(topics) if message[1] >= self.start)


def starts_of(bag: Path) -> list[int]:
    """Return the stamp [ns] of the bag's first message, and of each checkpoint."""
    with BagStream(bag) as stream:
        checkpoints = stream.messages(frozenset(["/vibro_robot/checkpoint"]))
        return sorted({stream.start, *(stamp for _, stamp, _ in checkpoints)})


def random_parameters(chance: random.Random) -> list[str]:
    """Return the parameters of a robot as words of its command line."""
    words = [f"scene:={chance.choice(('device', 'machine', 'unilateral', 'damped'))}", "motor.speed:=90.0",
             f"rate.real_time_factor:={FASTER}", f"rate.publish:={chance.choice((100.0, 200.0, 333.0))}",
             f"record.enabled:={str(chance.random() < 0.5).lower()}",
             f"rate.start_paused:={str(chance.random() < 0.2).lower()}"]
    words += chance.choice(([], ["record.max_bytes:=1e6"], ["record.max_duration:=0.7"], ["record.max_size:=3e5"],
                            ["record.max_bytes:=2e6", "record.compression:=zstd"]))
    words += chance.choice(([], [], ["command.timeout:=0.2"])) + chance.choice(([], ["effects.motor:=lag"], [*SENSORS]))
    return [word for parameter in words for word in ("-p", parameter)]


def acts_on(bench, chance: random.Random) -> list:
    """Return functions that each command the robot, or request something of it without waiting for the answer."""
    pause, record, reset, step, parameters, state, push, fault = (known_client(bench, kind, name) for kind, name in (
        (SetBool, "pause"), (SetBool, "record"), (Trigger, "reset"), (Trigger, "step"),
        (SetParameters, "set_parameters"), (types.SetState, "set_state"), (types.Push, "push"),
        (types.InjectFault, "inject_fault")))
    publishers = bench.publishers(dict.fromkeys(RANGES, Float64))

    def command():
        name = chance.choice(list(RANGES))
        publishers[name].publish(Float64(data=chance.uniform(*RANGES[name])))

    def change():
        names = chance.sample(list(LIVE), chance.choice((1, 1, 2)))
        values = {name: 0.0 if name == "ground.friction" and chance.random() < 0.2 else chance.uniform(*LIVE[name])
                  for name in names}
        return parameters.call_async(SetParameters.Request(parameters=[
            Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]))

    def fail():
        name, of, values = chance.choice(FAULTS)
        place = {"from_x": -0.01, "to_x": 0.01} if name == "friction_patch" else {}
        return fault.call_async(types.InjectFault.Request(fault=name, of=of, value=chance.uniform(*values),
                                                        duration=chance.uniform(0.01, 0.5), **place))

    return [
        command, command, command, change, change, change, fail,
        lambda: record.call_async(SetBool.Request(data=chance.random() < 0.6)),
        lambda: record.call_async(SetBool.Request(data=chance.random() < 0.6)),
        lambda: reset.call_async(Trigger.Request()), lambda: step.call_async(Trigger.Request()),
        lambda: pause.call_async(SetBool.Request(data=chance.random() < 0.3)),
        lambda: state.call_async(types.SetState.Request(names=["body_velocity"], values=[chance.uniform(-0.1, 0.1)])),
        lambda: push.call_async(types.Push.Request(duration=chance.uniform(0.001, 0.3),
                                                 force_x=chance.uniform(-3.0, 3.0)))]


def record_at_random(start, bench, folder: Path, seed: int, seconds: float) -> tuple[list[Path], Counter]:
    """Return the bags of a robot with random parameters that is treated at random, and the operations that it did."""
    chance, done, answers = random.Random(seed), [], []
    bench.node.create_subscription(String, "/vibro_robot/operations", lambda message: done.append(message.data),
                                   QoSProfile(depth=1000))
    robot = start("robot", "--ros-args", "-p", f"record.directory:={folder}", *random_parameters(chance))
    robot.wait_for("ready")
    acts = acts_on(bench, chance)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        answers.append(chance.choice(acts)())
        due = time.monotonic() + chance.expovariate(40.0)
        bench.spin_until(lambda due=due: time.monotonic() >= due, "the next", patience=10.0)
    bench.spin_until(lambda: all(answer.done() for answer in answers if answer), "answers")
    robot.send(signal.SIGINT)
    assert robot.end() == 0, robot.text
    return bags(folder), Counter(done)


def differences_in(bag: Path) -> tuple[int, list[str]]:
    """Replay a bag from each of its beginnings; return how many there are, and the differences in words."""
    starts, differences = starts_of(bag), []
    for stamp in starts:
        with Cut(bag, stamp) as stream:
            if difference := compare(stream).difference:
                differences.append(f"{bag.name} from {stamp}: {difference}")
    return len(starts), differences


@pytest.mark.parametrize("seed", range(2))
def test_every_bag_of_a_random_run_replays_from_each_of_its_checkpoints(start, bench, tmp_path, seed):
    recorded, done = record_at_random(start, bench, tmp_path, seed, 4.0)
    replayed = [differences_in(bag) for bag in recorded]
    assert not [difference for _, differences in replayed for difference in differences]
    assert sum(count for count, _ in replayed) > len(recorded)
    for bag in recorded:
        assert Counter(operations_in(bag)) <= done  # none that nobody asked for
        energy = energy_of(load_bag(bag))
        assert "unknown" not in energy or energy["unknown"].startswith("no odometry"), energy
