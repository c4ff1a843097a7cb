"""Write `digests.json`, the reference of bits: `python test/reference/digests.py` (about a minute).

Each entry is the SHA-256 of the bytes of all results of a case: the compiled tables of a scene; samples, events, energy
accounts and the checkpoint of a run; or the messages of a recording. The cases have every shipped scene, effect,
command, fault, sensor and method, and random scenes. The same commands give the same bits on every x86-64 computer, so
that `test_digests.py` compares with these. A change of the program that changes a digest says why in CHANGELOG.md.

`python test/reference/digests.py NAME...` prints the entries of some cases instead, by name or beginning of the name.
"""

import hashlib
import json
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[1] / "hard")]
from any_scene import draw_scenario  # noqa: E402
from robot_bag import robot_bag  # noqa: E402

import vibro_ros  # noqa: E402
from vibro_ros.bag.stream import BagStream  # noqa: E402
from vibro_ros.configuration.scene_file import shipped_scenes  # noqa: E402
from vibro_ros.messages.robot_messages import RobotMessages  # noqa: E402
from vibro_ros.model.tables import compile_scene  # noqa: E402

FILE = Path(__file__).with_name("digests.json")
METHODS = ("exact", "rk4", "rk4_located")
RANDOM_SCENES = 40

RIGID = {"effects.upper_contact": "restitution", "effects.inclined_contact": "restitution"}
HOP = {"effects.normal_force": "hop"}
WHOLE = {"effects.reaction": True, "effects.mass_weight": True}
SLIDERS = {"mass.upper_slider": 0.01, "mass.inclined_slider": 0.01}
VOLTAGE = {"motor.control": "voltage", "motor.voltage": 14.0}
STRIBECK = {"effects.friction": "stribeck", "ground.static_friction": 0.4}
# Scene and changes, by the name of an effect.
EFFECTS: dict[str, tuple[str, dict]] = {
    "one guide": ("device", {"effects.inclined_mass": False}),
    "other guide": ("device", {"effects.upper_mass": False}),
    "no guide": ("device", {"effects.upper_mass": False, "effects.inclined_mass": False, "mass.crank_pin": 0.01}),
    "upright": ("device", {"guide.angle": 0.0}), "crank equals rod": ("damped", {"crank.radius": 0.06}),
    "crank near rod": ("damped", {"crank.radius": 0.0599}),
    "no plates": ("device", {"effects.upper_contact": "none", "effects.inclined_contact": "none"}),
    "rigid plates": ("device", RIGID), "plates that pull": ("device", {"effects.adhesion": True}),
    "undamped drives": ("device", {"upper.spring.damping": 0.0, "inclined.spring.damping": 0.0}),
    "no friction": ("device", {"effects.friction": "none"}),
    "static friction": ("device", {"effects.friction": "static", "ground.static_friction": 0.4}),
    "Stribeck": ("damped", STRIBECK), "Stribeck, hop": ("device", STRIBECK),
    "Stribeck, rigid": ("device", STRIBECK | RIGID),
    "weight rule": ("device", {"effects.normal_force": "weight"}),
    "unilateral": ("device", {"effects.normal_force": "unilateral"}),
    "printed": ("damped", {"effects.normal_force": "printed"}),
    "friction backwards": ("device", {"ground.friction_backward": 0.4}), "slope": ("device", {"ground.slope": 0.05}),
    "viscous": ("device", {"ground.viscous_friction": 2.0}), "drag": ("device", {"ground.drag": 0.5}),
    "springy ground": ("device", {"ground.restitution": 0.3}), "no reaction": ("device", {"effects.reaction": False}),
    "sliders": ("device", SLIDERS), "crank pin": ("device", {"mass.crank_pin": 0.01}),
    "weight and reaction": ("damped", WHOLE), "hop": ("damped", HOP),
    "hop, rigid, whole": ("damped", HOP | RIGID | WHOLE),
    "misprint": ("damped", {"effects.misprint": True}), "ideal motor": ("device", {"effects.motor": "ideal"}),
    "lag": ("device", {"effects.motor": "lag"}), "backwards": ("device", {"motor.speed": -100.0}),
    "from zero": ("device", {"start.state": "zero"}),
    "thrown": ("device", {"start.state": "given", "start.body_velocity": 0.2, "start.body_vertical_velocity": 0.2,
                          "start.upper_position": 0.06, "start.inclined_position": 0.06}),
    "no bearing": ("machine", {"motor.friction": 0.0, "motor.static_friction": 0.0}),
    "winding": ("machine", {"motor.winding_inductance": 2.81e-4}), "voltage": ("machine", VOLTAGE),
    "voltage, winding, rigid": ("machine", VOLTAGE | RIGID | {"motor.winding_inductance": 1e-3}),
    "current control": ("machine", {"motor.control": "speed_by_current"}),
    "light sliders": ("machine", {"mass.upper_slider": 0.0, "mass.inclined_slider": 0.0}),
}
SENSORS = {"sensors.imu.rate": 400.0, "sensors.encoder.rate": 200.0, "sensors.tracking.rate": 50.0,
           "sensors.tracking.noise": 1e-4, "sensors.tracking.dropout_probability": 0.05, "sensors.imu.delay": 0.002}
CURRENT = {"sensors.current.rate": 500.0, "sensors.current.noise": 0.01}


def _commands(scene: vibro_ros.Scene) -> dict[str, list[Callable[[vibro_ros.SensedSimulator], object]]]:
    """Return the requests that a scene's device accepts, by name; each is followed by 0.1 s of motion."""
    motor = scene.motor_command
    low, high = (6.0, 18.0) if motor == "motor_voltage" else (40.0, 120.0)
    requests = {
        "motor": [lambda device: device.command(**{motor: low}), lambda device: device.command(**{motor: high})],
        "reverse": [lambda device: device.command(**{motor: -low})],
        "gaps": [lambda device: device.command(upper_gap=0.0005, inclined_gap=-0.0005),
                 lambda device: device.command(upper_gap=-0.001, inclined_gap=0.001)],
        "push": [lambda device: device.push(0.03, force_x=8.0)],
        "stall": [lambda device: device.fail("motor_stall", 0.02)],
        "stuck plates": [lambda device: [device.fail("plate_stuck", 0.03, of=side) for side in scene.plates],
                         lambda device: device.command(upper_gap=0.001)],
        "state": [lambda device: device.set_state(body_position=0.1, crank_angle=2.0)],
        "reset": [lambda device: device.reset()],
        "checkpoint": [lambda device: device.restore(device.checkpoint())],
    }
    if scene["solver.method"] == "exact":
        requests["patch"] = [lambda device: device.fail("friction_patch", 0.06, value=0.02, from_x=-1.0, to_x=1e-4)]
    if scene.has_rotor:
        requests["sag"] = [lambda device: device.fail("supply_sag", 0.04, value=9.0)]
    return requests


def _tables(scene: vibro_ros.Scene) -> Iterator[bytes]:
    model = compile_scene(scene)
    yield from _of_tuple(model.system)
    yield model.output.tobytes()


def _of_tuple(table: tuple) -> Iterator[bytes]:
    for entry in table:
        if isinstance(entry, tuple):
            yield from _of_tuple(entry)
        else:
            for name in entry.dtype.names or [...]:  # of a record its fields, without the bytes between them
                yield np.ascontiguousarray(entry[name]).tobytes()


def _run(scene: vibro_ros.Scene, part: float = 0.1, requests: tuple[Callable, ...] = (),
         parts: int = 2) -> Iterator[bytes]:
    """Yield the results of a run in parts of `part` [s], before each of which a request is made; or its error."""
    device = vibro_ros.SensedSimulator(scene)
    try:
        for request in (None, *requests, *[None] * (parts - 1 - len(requests))):
            if request:
                request(device)
            samples = device.sample(device.time + part * np.arange(1, 21) / 20.0)
            yield from (values.tobytes() for values in vars(samples).values())
    except vibro_ros.SimulationError as error:
        yield str(error).encode()
    for event in device.take_events().tolist():
        yield repr(event).encode()
    for measurement in device.take_measurements():
        yield repr((measurement[0], measurement[1], measurement[2].tolist())).encode()
    yield repr(device.statistics).encode()
    yield device.checkpoint().tobytes()


def _random(seed: int) -> Iterator[bytes]:
    scene, commands, end = draw_scenario(np.random.default_rng([46, seed]))
    yield from _tables(scene)
    requests = tuple(lambda device, keywords=keywords: device.command(**keywords) for _, keywords in commands)
    yield from _run(scene, min(0.1, end / 3.0), requests, 1 + len(requests))


def _messages(scene: vibro_ros.Scene) -> Iterator[bytes]:
    """Yield the messages of a robot with all transforms and sensors."""
    device, messages = vibro_ros.SensedSimulator(scene), RobotMessages(scene)
    yield from (data for _, data in messages.once(0))
    for tick in range(1, 41):
        device.advance_to(tick / 200.0)
        yield from (data for _, data in messages.of_sample(
            device.values, device.take_events(), device.take_measurements(), tick, lambda time: round(time * 1e9)))


def _recording(scene: vibro_ros.Scene) -> Iterator[bytes]:
    """Yield the messages of a recording with commands and a checkpoint; a replay must have the same bits."""
    with tempfile.TemporaryDirectory() as folder:
        bag = record(Path(folder) / "bag", scene)
        with BagStream(bag) as stream:
            yield from (data for _, _, data in stream.messages())


def record(folder: Path, scene: vibro_ros.Scene) -> Path:
    """Record 0.5 s of a robot that receives commands, and return the bag."""
    told = {20: {scene.motor_command: 60.0 if scene.motor_command == "motor_speed" else 9.0},
            50: {"upper_gap": 0.0005, "inclined_gap": -0.0002}}
    return robot_bag(folder, scene, 100, told, checkpoints=(0, 30))  # a robot writes one with its first sample


def cases() -> dict[str, Callable[[], Iterator[bytes]]]:
    """Return functions that yield the bytes of each case, by the case's name."""
    scenes = {name: vibro_ros.load_scene(name) for name in shipped_scenes()}
    functions: dict[str, Callable[[], Iterator[bytes]]] = {}

    def add(name: str, function: Callable, *arguments: object) -> None:
        functions[name] = lambda: function(*arguments)

    booked = {"solver.accounts": True}
    for name, scene in scenes.items():
        add(f"tables/{name}", _tables, scene.with_parameters(booked))
        for method in METHODS:
            add(f"scene/{name}/{method}", _run, _by(scene, method, booked))
    for name, (of, changes) in EFFECTS.items():
        scene = scenes[of].with_parameters(changes)
        add(f"tables/{name}", _tables, scene.with_parameters(booked))
        add(f"effect/{name}/exact", _run, scene.with_parameters(booked))
        add(f"effect/{name}/rk4_located", _run, _by(scene, "rk4_located"), 0.01)
    for of in ("damped", "device", "machine"):
        for method in METHODS:
            scene = _by(scenes[of], method)
            for name, requests in _commands(scene).items():
                part = 0.1 if method == "exact" else 0.01
                add(f"command/{name}/{of}/{method}", _run, scene, part, tuple(requests), 3)
    for of in ("device", "machine"):
        for preset in ("ideal", "bmi270", "mpu6050"):
            chosen = SENSORS | (CURRENT if scenes[of].has_rotor else {}) | {"sensors.preset": preset}
            sensed = scenes[of].with_parameters(chosen)
            add(f"sensors/{of}/{preset}", _run, sensed)
        add(f"messages/{of}", _messages, sensed)
        add(f"recording/{of}", _recording, sensed)
    for seed in range(RANDOM_SCENES):
        add(f"random/{seed}", _random, seed)
    return functions


def _by(scene: vibro_ros.Scene, method: str, booked: dict | None = None) -> vibro_ros.Scene:
    """Return the scene solved by a method; accounts are booked by the exact one alone."""
    if method == "exact":
        return scene.with_parameters(booked or {})
    return scene.with_parameters({"solver.method": method, "solver.accounts": False})


def digest(parts: Iterator[bytes]) -> str:
    """Return the digest of parts of different lengths."""
    result = hashlib.sha256()
    for part in parts:
        result.update(b"%d " % len(part))
        result.update(part)
    return result.hexdigest()


def digests(chosen: list[str]) -> dict[str, str]:
    """Return the digests of the cases whose names begin with one of `chosen`."""
    return {name: digest(case()) for name, case in cases().items() if name.startswith(tuple(chosen))}


if __name__ == "__main__":
    names = sys.argv[1:]
    text = json.dumps(digests(names or [""]), indent=1)
    print(text) if names else FILE.write_text(text + "\n")
