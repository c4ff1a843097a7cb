"""A real robot commanded over DDS at random instants and recorded."""

import random
import signal
import time
from pathlib import Path
from types import MappingProxyType

from std_msgs.msg import Float64

SECONDS = 2.0
COMMANDS = 75.0  # a second at least, however busy the machine
FASTER = 2.5  # than the clock, so that a recording of 5 s takes 2 s
RANGES = {"motor_speed": (-520.0, 200.0), "upper_gap": (-1e-3, 2e-3), "inclined_gap": (-1e-3, 2e-3)}
SENSORS = ("sensors.preset:=bmi270", "sensors.imu.rate:=800.0", "sensors.imu.delay:=0.003",
           "sensors.encoder.rate:=150.0", "sensors.tracking.rate:=60.0", "sensors.tracking.latency:=0.04",
           "sensors.tracking.dropout_probability:=0.05", "motor.speed:=100.0", "effects.motor:=dc",
           "sensors.current.rate:=100.0", "sensors.current.noise:=0.1", "sensors.current.supply_resistance:=0.5")


def command_at_random(bench, seconds: float, seed: int, topics: dict[str, str]) -> None:
    """Send commands at random instants for so long, `COMMANDS` a second at least; some come together, some are bad."""
    chance = random.Random(seed)
    publishers = bench.publishers({topics.get(name, name): Float64 for name in RANGES})
    end, sent = time.monotonic() + seconds, 0
    while time.monotonic() < end or sent < COMMANDS * seconds:
        together = chance.choice((1, 1, 3))
        for _ in range(together):
            name = chance.choice(list(RANGES))
            publishers[topics.get(name, name)].publish(Float64(data=chance.uniform(*RANGES[name])))
        sent += together
        due = time.monotonic() + chance.expovariate(50.0)
        bench.spin_until(lambda due=due: time.monotonic() >= due, "the next command", patience=10.0)


def record_run(start, bench, folder: Path, *parameters: str, seconds: float = SECONDS, end=signal.SIGINT, names=(),
               topics: dict[str, str] = MappingProxyType({}), afterwards=None) -> Path:
    """Record a robot that is commanded at random, and return its bag."""
    words = [word for parameter in (f"record.directory:={folder}", *parameters) for word in ("-p", parameter)]
    robot = start("robot", "--ros-args", *words, *names)
    robot.wait_for("ready")
    command_at_random(bench, seconds, len(parameters), topics)
    if afterwards:
        afterwards(bench)
        command_at_random(bench, seconds, 1 + len(parameters), topics)
    robot.send(end)
    assert robot.end() == (0 if end == signal.SIGINT else -end), robot.text
    (bag,) = folder.glob("vibro_robot_*")
    return bag
