"""What the simulator refuses, and what it does with the smallest, largest and stiffest input that it accepts.

A refusal is one line that names the value, the limit and the remedy, and changes nothing. Every double, down to 5e-324,
is simulated, or is zero by the rule of `model.parameters.NEGLIGIBLE`, or is refused.
"""

import dataclasses
import math
import re

import numpy as np
import pytest

import vibro_ros
from vibro_ros.model.parameter_checks import fastest_rate
from vibro_ros.model.parameters import NEGLIGIBLE, SCENE_PARAMETERS
from vibro_ros.model.tables import compile_scene
from vibro_ros.solver.equations import RATE_LIMIT

PAPER, DEVICE = vibro_ros.load_scene("paper"), vibro_ros.load_scene("device")
NUMBERS = [parameter for parameter in SCENE_PARAMETERS
           if isinstance(parameter.default, float) and not parameter.name.startswith("solver.")]
TINY = [5e-324, 1e-321, 3.3e-318, 1e-310, 2.3e-308, 1e-306, 4e-200, 9.9e-31]


@pytest.mark.parametrize(("request_", "message"), [
    (lambda device: device.command(motor_speed=math.nan), "motor.speed: nan"),
    (lambda device: device.command(motor_speed=-501.0), "motor.speed: -501"),
    (lambda device: device.command(motor_speed="fast"), "motor.speed: 'fast'"),
    (lambda device: device.command(motor_speed=True), "motor.speed: True"),
    (lambda device: device.command(inclined_gap=0.07), "inclined.gap: 0.07"),
    (lambda device: device.command(motor_speed=50.0, upper_gap=0.001, inclined_gap=-math.inf), "inclined.gap: -inf"),
    (lambda device: device.advance_to(0.01), "0.01"), (lambda device: device.advance_to(math.nan), "nan"),
    (lambda device: device.advance_to(1.0000001e9), "give at most 1e+09 s"),
    (lambda device: device.sample(np.array([0.04, 1e300])), "give instants up to 1e+09 s"),
    *[(lambda device, times=times: device.sample(times), "ascending array of finite instants, none below 0.03 s")
      for times in ([0.02], [0.06, 0.05], [math.nan], [[0.06]], [math.inf])]])
def test_a_refused_request_changes_nothing(request_, message):
    device = vibro_ros.Simulator(vibro_ros.load_scene("unilateral"))
    device.advance_to(0.03)
    checkpoint = device.checkpoint().tobytes()
    with pytest.raises(ValueError, match=rf"^[^\n]*{re.escape(message)}[^\n]*$"):
        request_(device)
    assert device.checkpoint().tobytes() == checkpoint


@pytest.mark.parametrize(("run", "message"), [
    ({"duration": math.nan}, "duration"), ({"duration": 1.0, "rate": 0.0}, "rate"),
    ({"times": [0.2, 0.1]}, "times"), ({"times": [-0.1, 0.1]}, "times"), ({"times": [0.0, math.nan]}, "times"),
    ({"duration": 1e300, "rate": 1e-300}, "give a duration of at most 1e+09 s and at most 1e+08 samples"),
    ({"duration": 1e9, "rate": 1e9}, "give a duration of at most 1e+09 s and at most 1e+08 samples")])
def test_impossible_samples_of_a_run_are_refused(run, message):
    with pytest.raises(ValueError, match=rf"^[^\n]*{re.escape(message)}[^\n]*$"):
        vibro_ros.simulate(PAPER, **run)


def test_the_shortest_run_has_one_sample():
    assert len(vibro_ros.simulate(PAPER, duration=5e-324, rate=1.7e308).time) == 1


@pytest.mark.parametrize(("scene", "changes", "message"), [
    (PAPER, {"mass.upper": 1e-3, "upper.spring.damping": 1e6},
     "0.001 kg, faster than 1e+07 1/s, which takes too long to simulate; give a mass of at least 0.1 kg"),
    (PAPER, {"mass.inclined": 1e-12}, "inclined.plate.stiffness: 1e+07 N/m moves mass.inclined, 1e-12 kg"),
    (DEVICE, {"mass.body": 1e-5, "effects.inclined_mass": False},
     "takes too long to simulate; give at least 2e-05 kg, less ground.friction, stiffness and damping"),
    (DEVICE, {"mass.body": 1e-9, "guide.angle": 1e-7}, "mass.body: 1e-09 kg with effects.reaction leaves the masses")])
def test_a_scene_that_would_take_for_ever_is_refused(scene, changes, message):
    with pytest.raises(ValueError, match=rf"^[^\n]*{re.escape(message)}[^\n]*$"):
        scene.with_parameters(changes)
    if "mass.body" in changes:
        assert scene.with_parameters(changes | {"effects.reaction": False})
    if enough := re.search("give at least (.*) kg", message):
        assert scene.with_parameters(changes | {"mass.body": float(enough[1])})


@pytest.mark.parametrize("rule", ["weight", "unilateral", "printed", "hop"])
@pytest.mark.parametrize(("friction", "body"), [("none", 1.0), ("coulomb", 1e-2), ("static", 1e-4)])
def test_the_rate_that_is_limited_is_that_of_the_compiled_tables(rule, friction, body):
    scene = DEVICE.with_parameters({
        "effects.normal_force": rule, "effects.friction": friction, "mass.body": body, "ground.friction": 0.05})
    shortest = compile_scene(scene).system.longest_segment.min()
    assert fastest_rate(scene) == pytest.approx(2.0 * RATE_LIMIT / shortest, rel=1e-9)


@pytest.mark.parametrize("changes", [
    {"mass.upper": 1e-3, "upper.plate.stiffness": 1e9}, {"upper.plate.stiffness": 1e12},
    {"mass.upper": 1e-3, "upper.plate.damping": 1e3, "effects.adhesion": False},
    {"mass.upper": 1e-9, "upper.spring.damping": 1e6, "effects.upper_mass": False},
    {"mass.upper": 1e-12, "upper.spring.stiffness": 10.0, "effects.upper_contact": "none"},
    {"mass.upper": 1e-3, "upper.plate.stiffness": 1e12, "effects.upper_contact": "restitution",
     "effects.friction": "none"}])
def test_fast_but_feasible_and_unused_parameters_are_accepted(changes):
    device = vibro_ros.Simulator(PAPER.with_parameters(changes))
    device.advance_to(1e-3)
    assert device.statistics["steps"] < 10_000  # 1e-3 s at 5e6 steps a second, and some for events


def test_a_guide_that_hardly_leans_has_no_limit_of_friction():
    """The product of the guide's sine and the mass is below the smallest number."""
    device = vibro_ros.Simulator(DEVICE.with_parameters({"guide.angle": 5e-324}))
    device.command(motor_speed=50.0)
    device.advance_to(0.1)
    assert device.state.body_position == 0.0


def equal(state, other):
    """Whether two states are the same to the last bit, signs of zeros included."""
    return all(value.hex() == getattr(other, name).hex() for name, value in vars(state).items())


@pytest.mark.parametrize(("name", "motor"), [("paper", "ideal"), ("rigid", "ramp"), ("device", "lag")])
def test_a_speed_below_the_least_is_standstill(name, motor):
    """Such a speed has the bits of the speed 0: as a command to a motor that stands or turns, and as a parameter."""
    scene = vibro_ros.load_scene(name).with_parameters({"effects.motor": motor})

    def states(speed, first):
        device = vibro_ros.Simulator(scene.with_parameters({"motor.speed": first}))
        for time in (0.0, 0.003):
            device.advance_to(time)
            device.command(motor_speed=speed)
        device.advance_to(0.005)
        yield device.state
        device.command(motor_speed=0.0, upper_gap=1e-3)
        device.advance_to(0.01)
        yield device.state

    for first in (0.0, 20.0):
        expected = list(states(0.0, first))
        for speed in (-0.0, *TINY):
            assert all(map(equal, states(speed, first or speed), expected)), speed
    moving = list(states(NEGLIGIBLE, 0.0))[0]
    assert moving.motor_speed == pytest.approx(NEGLIGIBLE, rel=0.05 if motor == "lag" else 1e-15, abs=NEGLIGIBLE)
    assert all(map(math.isfinite, vars(moving).values()))


@pytest.mark.parametrize("parameter", NUMBERS, ids=lambda parameter: parameter.name)
def test_a_tiny_parameter_is_zero_or_refused(parameter):
    for tiny in (-0.0, *TINY):
        if parameter.positive or parameter.minimum > 0.0:
            with pytest.raises(ValueError, match=rf"{parameter.name}: .* out of range; give a number"):
                parameter.checked(tiny)
        else:
            assert parameter.checked(tiny).hex() == (0.0).hex()
    if parameter.minimum <= 0.0 and not parameter.smallest:
        assert parameter.checked(NEGLIGIBLE) == NEGLIGIBLE


def _extreme(parameter, random):
    """Draw the default, an end of the range, a negligible number, or a number from any legal decade."""
    if isinstance(parameter.default, bool):
        return bool(random.random() < 0.6)
    if parameter.choices:
        return str(random.choice(parameter.choices))
    smallest, highest = math.log10(NEGLIGIBLE), math.log10(parameter.maximum)
    return float(random.choice([
        parameter.default, parameter.default, parameter.default, parameter.maximum,
        random.choice([0.0, 5e-324, 1e-310]) if not parameter.positive else NEGLIGIBLE,
        min(10.0 ** random.uniform(smallest, highest), parameter.maximum),
        min((parameter.default or 1.0) * 10.0 ** random.uniform(-3.0, 3.0), parameter.maximum)]))


def _scene(random):
    """Draw a scene of extremes, made legal where that is easy; None if it is rightly refused."""
    values = {parameter.name: max(_extreme(parameter, random), parameter.minimum) if parameter in NUMBERS else
              _extreme(parameter, random) for parameter in SCENE_PARAMETERS
              if not parameter.name.startswith(("solver.", "sensors."))}
    rods = [values[f"crank.{side}_rod"] for side in ("upper", "inclined")]
    values["crank.radius"] = max(NEGLIGIBLE, min(rods) * random.choice([1.0, 1.0 - 1e-15, 0.999, 0.3, 1e-15]))
    values["motor.speed"] = min(values["motor.speed"], values["motor.max_speed"])
    values["motor.static_friction"] = max(values["motor.static_friction"], values["motor.friction"])
    if values["effects.motor"] == "dc":  # of which nearly all extremes are refused
        values |= {parameter.name: parameter.default for parameter in NUMBERS
                   if parameter.name.startswith("motor.") and random.random() < 0.9}
    values["motor.voltage"] = min(values["motor.voltage"], values["motor.supply_voltage"])
    values["ground.static_friction"] = max(values["ground.static_friction"], values["ground.friction"])
    for side, rod in zip(("upper", "inclined"), rods, strict=True):
        values[f"{side}.gap"] = float(random.choice([0.0, 0.0, 1.0, -1.0]) * random.choice([rod, 5e-324]))
    try:
        return vibro_ros.Scene("extreme", values)
    except ValueError as refusal:
        assert "\n" not in str(refusal) and ("give" in str(refusal) or "choose" in str(refusal))
        return None


@pytest.mark.parametrize("seed", range(2))
def test_extremes_of_every_parameter_together(seed):
    """Every accepted scene runs, with commands from one end of the speeds to the other and steps from 5e-324 s up."""
    random, accepted = np.random.default_rng(seed), 0
    for _ in range(400):
        if (scene := _scene(random)) is None:
            continue
        accepted += 1
        device, most = vibro_ros.Simulator(scene), scene["motor.max_speed"]
        for duration, speed in ((5e-324, most), (1e-12, 0.0), (1e-9, min(most, NEGLIGIBLE)), (1e-7, most), (1e-5, 0.0)):
            device.advance_to(device.time + duration)
            state = dataclasses.asdict(device.state)
            assert all(map(math.isfinite, state.values())), (scene, state)
            subnormal = [name for name, value in state.items() if name != "time" and 0.0 < abs(value) < 1e-300]
            assert not subnormal, (scene, subnormal)
            jumps = scene.linkage and scene["effects.motor"] == "ideal"  # such a motor keeps its speed
            most_volts = scene["motor.supply_voltage"] if scene.motor_command == "motor_voltage" else most
            motor = {} if jumps else {scene.motor_command: min(speed, most_volts)}
            device.command(**motor, upper_gap=float(random.uniform(-1.0, 1.0) * scene["crank.upper_rod"]))
    assert accepted > 15
