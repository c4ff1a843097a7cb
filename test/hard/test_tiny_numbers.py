"""Every double, down to 5e-324: simulated, or zero by the rule of `model.parameters.NEGLIGIBLE`, or refused."""

import dataclasses
import math

import numpy as np
import pytest

import vibro_ros
from vibro_ros.model.parameters import NEGLIGIBLE, SCENE_PARAMETERS

NUMBERS = [one for one in SCENE_PARAMETERS if isinstance(one.default, float) and not one.name.startswith("solver.")]
TINY = [5e-324, 1e-321, 3.3e-318, 1e-310, 2.3e-308, 1e-306, 4e-200, 9.9e-31]


def equal(one, other):
    """Whether two states are the same to the last bit, signs of zeros included."""
    return all(value.hex() == getattr(other, name).hex() for name, value in vars(one).items())


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
        values |= {one.name: one.default for one in NUMBERS if one.name.startswith("motor.") and random.random() < 0.9}
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


@pytest.mark.parametrize("time", [1.0000001e9, 1e300])
def test_an_instant_that_no_clock_resolves_is_refused(time):
    device = vibro_ros.Simulator(vibro_ros.load_scene("paper"))
    with pytest.raises(ValueError, match="cannot advance to .* give at most 1e.09 s"):
        device.advance_to(time)
    with pytest.raises(ValueError, match="times: .* give instants up to 1e.09 s"):
        device.sample(np.array([0.0, time]))


@pytest.mark.parametrize(("duration", "rate"), [(1e308, 1e308), (1e300, 1e-300), (1e9, 1e9), (5e-324, 1.7e308)])
def test_more_time_or_samples_than_a_run_can_have_are_refused(duration, rate):
    scene = vibro_ros.load_scene("no_impact")
    if duration < 1.0:
        assert len(vibro_ros.simulate(scene, duration=duration, rate=rate).time) == 1
        return
    with pytest.raises(ValueError, match="give a duration of at most 1e.09 s and at most 1e.08 samples"):
        vibro_ros.simulate(scene, duration=duration, rate=rate)
