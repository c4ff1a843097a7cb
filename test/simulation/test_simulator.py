"""The stateful device: commands, events and their instants, and the hard cases of its parameters."""

import dataclasses
import math
import signal
import tracemalloc

import numpy as np
import pytest

import vibro_ros
from vibro_ros.model.slider import Slider
from vibro_ros.solver.methods import SCHEMES

SWINGING = {"effects.upper_contact": "none", "effects.inclined_contact": "none"}
RAMP = {"effects.motor": "ramp", "motor.speed": 0.0}


def device(changes=None, scene="unilateral"):
    return vibro_ros.Simulator(vibro_ros.load_scene(scene).with_parameters(changes or {}))


def state_bits(made):
    return np.array(dataclasses.astuple(made.state)).tobytes()


def of_kind(events, *kinds):
    return events[np.isin(events["kind"], kinds)]


@pytest.mark.parametrize("command", [
    {"motor_speed": 501.0, "upper_gap": 0.001}, {"motor_speed": 50.0, "upper_gap": 0.001, "inclined_gap": math.nan},
    {"upper_gap": -0.07, "motor_speed": 50.0}, {"inclined_gap": 0.001, "motor_speed": -0.0001}])
def test_several_commands_act_all_or_none(command):
    made, untouched = device(RAMP), device(RAMP)
    for each in (made, untouched):
        each.advance_to(0.013)
    with pytest.raises(ValueError, match="give|ask"):
        made.command(**command)
    for time in (0.013, 0.1):
        for each in (made, untouched):
            each.advance_to(time)
        assert state_bits(made) == state_bits(untouched)


def test_an_empty_command_changes_nothing_but_rounding():
    made, untouched = device(scene="damped"), device(scene="damped")
    made.advance_to(0.013)
    made.command()
    for each in (made, untouched):
        each.advance_to(0.1)
    np.testing.assert_allclose(made.state.upper_position, untouched.state.upper_position, rtol=0, atol=1e-13)
    np.testing.assert_allclose(made.state.body_position, untouched.state.body_position, rtol=0, atol=1e-13)


@pytest.mark.parametrize("acceleration", [200.0, 1.0, 1e5])
def test_the_ramp_motor_keeps_to_its_acceleration(acceleration):
    """ω = a t and θ = a t²/2 up to the target, which is met exactly, at v/a; the event says when."""
    made = device(RAMP | SWINGING | {"motor.acceleration": acceleration})
    end = 30.0 / acceleration
    made.command(motor_speed=30.0)
    for share in (0.0, 0.1, 0.5, 0.999):
        made.advance_to(share * end)
        assert made.state.motor_speed == pytest.approx(acceleration * share * end, rel=1e-13)
        assert made.state.crank_angle == pytest.approx(acceleration * (share * end) ** 2 / 2, rel=1e-14)
        assert len(of_kind(made.take_events(), "motor_ramp_end")) == 0
    made.advance_to(end + 1.0)
    assert made.state.motor_speed == 30.0
    assert made.state.crank_angle == pytest.approx(30.0 * (end / 2 + 1.0), rel=1e-14)
    (event,) = of_kind(made.take_events(), "motor_ramp_end")
    assert event["time"] == pytest.approx(end, rel=1e-14)


def test_a_command_during_a_ramp_starts_from_the_speed_reached():
    """Up for 0.1 s to 20 rad/s, then down to 5 in 0.075 s: one end of a ramp, that of the second."""
    made = device(RAMP | SWINGING)
    made.command(motor_speed=100.0)
    made.advance_to(0.1)
    made.command(motor_speed=5.0)
    assert made.state.motor_speed == pytest.approx(20.0, abs=1e-13)
    made.advance_to(0.15)
    assert made.state.motor_speed == pytest.approx(10.0, abs=1e-13)
    made.advance_to(0.3)
    assert made.state.motor_speed == 5.0
    assert made.state.crank_angle == pytest.approx(1.0 + 0.075 * 12.5 + 0.125 * 5.0, rel=1e-14)
    (event,) = of_kind(made.take_events(), "motor_ramp_end")
    assert event["time"] == pytest.approx(0.175, rel=1e-14)


def test_asking_for_the_present_speed_or_gap_is_no_ramp():
    made = device(RAMP | SWINGING)
    made.command(motor_speed=0.0, upper_gap=0.0)
    made.advance_to(0.1)
    assert len(of_kind(made.take_events(), "motor_ramp_end", "gap_reached")) == 0


def test_the_motor_stops_and_starts_at_many_phases():
    """It stands still exactly, at the angle that the ramp implies, and starts again from there."""
    made = device(RAMP | {"motor.acceleration": 2000.0}, scene="damped")
    angle = 0.0
    for speed in np.linspace(3.0, 60.0, 12):
        made.command(motor_speed=speed)
        made.advance_to(made.time + speed / 2000.0 + 0.01)
        assert made.state.motor_speed == speed
        made.command(motor_speed=0.0)
        made.advance_to(made.time + speed / 2000.0 + 0.01)
        angle += speed**2 / 2000.0 + 0.01 * speed
        assert made.state.motor_speed == 0.0
        assert made.state.crank_angle == pytest.approx(angle, rel=1e-13)
        assert made.state.motor_power == 0.0


def test_the_gap_moves_at_its_speed():
    made = device({"gap_actuator.speed": 0.005} | RAMP)
    made.command(upper_gap=0.001, inclined_gap=-0.0005)
    for time in (0.0, 0.05, 0.0999):
        made.advance_to(time)
        assert made.state.upper_plate_position == pytest.approx(0.06 + 0.005 * time, abs=1e-15)
        assert made.state.inclined_plate_position == pytest.approx(0.06 - 0.005 * time, abs=1e-15)
        assert (made.state.upper_plate_velocity, made.state.inclined_plate_velocity) == (0.005, -0.005)
    made.advance_to(0.3)
    assert (made.state.upper_plate_position, made.state.inclined_plate_position) == (0.06 + 0.001, 0.06 - 0.0005)
    assert made.state.upper_plate_velocity == 0.0
    reached = of_kind(made.take_events(), "gap_reached")
    np.testing.assert_allclose(reached["time"], [0.1, 0.2], rtol=1e-12)


def falling(gap):
    """The upper mass alone, released at 0 with its slider standing at 0.08 m: u = 0.08 (1 - cos 100 t)."""
    return device({"motor.speed": 0.0, "start.state": "zero", "upper.gap": gap, "effects.inclined_mass": False})


def test_a_contact_is_reported_once_with_its_first_instant():
    """Plate at the slider: the mass comes at 8 m/s after a quarter period; peak √(v² m k4) / √(1 + k2/k4).

    Pushed back by k2 + k4 together, the deepest point is v/√((k2 + k4)/m).
    """
    made = falling(0.02)
    made.advance_to(0.0159)
    assert made.state.upper_plate_force > 0.0
    assert len(made.take_events()) == 0
    made.advance_to(0.03)
    (event,) = of_kind(made.take_events(), "upper_contact")
    assert event["time"] == pytest.approx(math.pi / 200, rel=1e-14)
    assert event["speed"] == pytest.approx(8.0, rel=1e-14)
    assert event["peak_force"] == pytest.approx(8.0 * math.sqrt(0.1 * 1e7) / math.sqrt(1 + 1e-4), rel=1e-12)
    assert event["duration"] == pytest.approx(math.pi / math.sqrt((1e3 + 1e7) / 0.1), rel=1e-10)
    made.advance_to(0.04)
    assert len(of_kind(made.take_events(), "upper_contact")) == 0


def test_a_contact_across_commands_is_one_contact():
    """Commands that arrive while the mass is in contact, one at its deepest point, neither split nor change it."""
    made = falling(0.02)
    contact, depth = math.pi / 200, math.pi / math.sqrt((1e3 + 1e7) / 0.1)
    for share in (0.1, 0.5, 0.5, 0.9):
        made.advance_to(contact + share * depth)
        made.command(upper_gap=0.02)
    made.advance_to(0.03)
    (event,) = of_kind(made.take_events(), "upper_contact")
    assert event["peak_force"] == pytest.approx(8.0 * math.sqrt(1e6) / math.sqrt(1 + 1e-4), rel=1e-12)
    assert event["duration"] == pytest.approx(depth, rel=1e-10)


def test_a_plate_that_closes_onto_a_resting_mass():
    """The mass rests on its slider; the plate comes at 5 mm/s and touches after 1 mm, at 5 mm/s of approach."""
    made = device({"motor.speed": 0.0, "start.state": "rest", "upper.gap": 0.021, "effects.inclined_mass": False})
    made.command(upper_gap=0.0)
    made.advance_to(1.0)
    first = of_kind(made.take_events(), "upper_contact")[0]
    assert first["time"] == pytest.approx(0.2, rel=1e-11)
    assert first["speed"] == pytest.approx(0.005, rel=1e-12)


def test_commands_and_samples_at_the_instant_of_an_event():
    """The instant of the contact, one rounding before and one behind: the trajectory is the same to rounding."""
    finals = []
    for instant in (math.pi / 200, math.nextafter(math.pi / 200, 0), math.nextafter(math.pi / 200, 1)):
        made = falling(0.02)
        made.advance_to(instant)
        for _ in range(3):
            made.command(upper_gap=0.02, motor_speed=0.0)
            made.advance_to(instant)
        made.advance_to(0.1)
        finals.append(made.state.upper_position)
        assert len(of_kind(made.take_events(), "upper_contact")) == 3
    np.testing.assert_allclose(finals, finals[0], rtol=0, atol=1e-12)


def test_a_plate_called_away_lets_go_at_once():
    """No tension: in the very instant of the command the damper would pull by c E' = 1 N, and must not be seen to."""
    for instant in np.linspace(0.04, 0.06, 60) * math.pi / 3:
        made = device(RAMP | {"effects.adhesion": False, "upper.gap": 0.0199, "upper.plate.damping": 100.0,
                              "upper.spring.damping": 20.0, "upper.plate.stiffness": 1e4, "gap_actuator.speed": 0.5})
        made.advance_to(instant)
        assert made.state.upper_plate_force > 0.0
        made.command(upper_gap=0.03)
        assert made.state.upper_plate_force == 0.0


@pytest.mark.parametrize("scene", ["paper", "unilateral", "damped"])
def test_a_flood_of_commands_at_one_instant(scene):
    """The last of 1000 counts; each jump of the speed jolts the dampers, and none is taken for a lack of progress."""
    made = device({"upper.spring.damping": 50.0, "inclined.spring.damping": 50.0}, scene)
    made.advance_to(0.0155)
    for index in range(1000):
        made.command(motor_speed=500.0 * (index % 2), upper_gap=0.001 * (index % 3))
    made.command(motor_speed=90.0, upper_gap=0.0)
    made.advance_to(0.1)
    assert made.state.motor_speed == 90.0


def test_steps_of_a_picosecond():
    made, whole = device(), device()
    made.advance_to(0.01)
    for _ in range(200):
        made.advance_to(made.time + 1e-12)
    whole.advance_to(made.time)
    assert state_bits(made) == state_bits(whole)


LIGHT = {"mass.body": 1e-3, "mass.upper": 1e-3, "mass.inclined": 1e-3}


@pytest.mark.parametrize("changes", [
    {"guide.angle": 0.0}, {"guide.angle": math.pi / 2}, {"guide.angle": math.pi}, {"gravity": 0.0},
    {"gravity": 0.0, "guide.angle": math.pi / 2}, {"ground.friction": 0.0},
    {"ground.friction": 1e3, "effects.reaction": False}, LIGHT,
    {"upper.spring.stiffness": 0.0, "inclined.spring.stiffness": 0.0},
    {"upper.plate.stiffness": 0.0, "inclined.plate.stiffness": 0.0},
    {"upper.plate.stiffness": 0.0, "inclined.plate.stiffness": 0.0, "effects.adhesion": False,
     "upper.plate.damping": 10.0, "inclined.plate.damping": 10.0},
    {"upper.plate.stiffness": 1e9, "inclined.plate.stiffness": 1e3},
    {"upper.plate.damping": 1e4, "inclined.plate.damping": 1e4},
    {"upper.spring.damping": 1e3, "inclined.spring.damping": 1e3},
    {"upper.gap": 0.06, "inclined.gap": -0.06}, {"upper.gap": -0.06, "inclined.gap": 0.06},
    {"motor.speed": 0.01}, {"motor.speed": 500.0}, {"motor.speed": 0.0}, {"crank.radius": 1e-12},
    {"crank.radius": 0.06, "motor.speed": 0.0}, {"crank.radius": 0.06, "guide.angle": math.pi / 2},
    {"effects.upper_mass": False}, {"effects.inclined_mass": False},
    {"effects.upper_mass": False, "effects.inclined_mass": False}, {"mass.body": 1e-3}, {"mass.body": 1e6}],
    ids=lambda changes: ",".join(f"{name}={value:g}" for name, value in changes.items())[:60])
@pytest.mark.parametrize("scene", ["paper", "unilateral", "damped", "device"])
def test_extremes(scene, changes):
    """No exception, nothing infinite, no mass beyond an open plate, friction within its bound, energy accounted for."""
    made = device(changes | {"solver.audit": True}, scene)
    made.advance_to(0.05)
    made.command(motor_speed=80.0, upper_gap=0.0003, inclined_gap=-0.0003)
    samples = made._motion.sampled(np.linspace(0.05, 0.4, 1500))
    assert all(np.isfinite(values).all() for values in samples.values())
    for side in ("upper", "inclined"):
        if made.scene[f"effects.{side}_mass"] and made.scene["effects.adhesion"]:
            depth = samples[f"{side}_position"] - samples[f"{side}_plate_position"]
            stiff = made.scene[f"{side}.plate.stiffness"] > 0.0
            assert not np.any((samples[f"{side}_plate_force"] == 0.0) & (depth > 1e-12) & stiff)
    limit = made.scene["ground.friction"] * np.abs(samples["normal_force"])
    assert np.all(np.abs(samples["friction_force"]) <= limit + 1e-8 * max(1.0, made.scene["ground.friction"]))
    exchanged = made.statistics["energy_exchanged"]
    assert abs(made.statistics["energy_residual"]) <= 1e-11 * exchanged + 1e-13


@pytest.mark.parametrize("damping", [0.0, 2.0, 300.0])
@pytest.mark.parametrize("adhesion", [True, False])
@pytest.mark.parametrize("load", [0.0, 1e-18, -1e-18, 1e-16, 1e-15, 1e-13, -1e-13])
def test_a_mass_that_rests_on_its_plate_without_load(load, damping, adhesion):
    """Preloads whose penetration is lost in rounding: contact and no contact must not take turns for ever."""
    rest = float(Slider(0.02, 0.06, 0.9).position(0.0))
    made = device(RAMP | {
        "guide.angle": 0.9, "effects.adhesion": adhesion, "upper.gap": 0.02 + load, "inclined.gap": rest - 0.06 + load,
        "upper.plate.stiffness": 1e9, "inclined.plate.stiffness": 1e7, "upper.spring.damping": damping,
        "inclined.spring.damping": damping, "upper.plate.damping": damping, "inclined.plate.damping": damping})
    made.advance_to(0.1)
    made.command(motor_speed=60.0)
    made.advance_to(0.2)
    made.command(motor_speed=0.0)
    made.advance_to(0.6)
    assert made.state.motor_speed == 0.0


# Scenes found by a search with random parameters; each ended with events that took turns at one instant.
@pytest.mark.parametrize(("changes", "speed"), [
    ({"crank.radius": 1.0215784556433672e-08, "guide.angle": math.pi, "inclined.gap": -0.02, "motor.speed": 5.68,
      "effects.normal_force": "printed", "mass.upper": 0.0809123920584814, "upper.gap": -1e-12, "mass.body": 0.0338,
      "upper.plate.stiffness": 1e9, "upper.spring.damping": 2.0, "upper.spring.stiffness": 20.87844653605529}, None),
    ({"effects.adhesion": False, "guide.angle": 0.9, "inclined.gap": 0.010350759266887128, "motor.speed": 0.0,
      "inclined.plate.stiffness": 1e3, "inclined.spring.damping": 78.6217151368093, "effects.motor": "ramp",
      "inclined.spring.stiffness": 81708.80232874175, "upper.gap": 0.019999999999841755,
      "upper.plate.damping": 100.0, "upper.plate.stiffness": 1657589.3619618749, "upper.spring.damping": 2.0,
      "upper.spring.stiffness": 1353.8469751853938}, 50.0)])
def test_modes_that_contradict_each_other_within_rounding(changes, speed):
    made = device(changes)
    made.advance_to(0.3)
    made.command(motor_speed=speed)
    made.advance_to(0.6)
    assert made.time == 0.6


def test_an_hour_of_standing_still_is_cheap():
    """The masses hang freely: one segment a tenth of their period, and the state stays what it was."""
    made = device(SWINGING | {"motor.speed": 0.0})
    before = made.state.upper_position
    made.advance_to(3600.0)
    assert made.state.upper_position == pytest.approx(before, abs=1e-15)
    assert made.statistics["steps"] < 3600 * 112 / 2 * 1.1


def test_a_long_run_needs_no_more_memory():
    """Events are handed over once, and then gone: what stays is little beside what was handed over.

    What stays are some hundred tuples that Python and numba keep for their next call.
    """
    made, handed_over, before = device({"motor.speed": 150.0}, scene="damped"), 0, 0
    for tick in range(1, 6001):
        made.advance_to(tick / 100)
        handed_over += made.take_events().nbytes
        if tick == 200:
            tracemalloc.start()
        if tick == 300:
            before, handed_over = tracemalloc.get_traced_memory()[0], 0
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert handed_over > 200_000
    assert after - before < handed_over / 4


@pytest.mark.parametrize("times", [[0.0, 1e9], np.arange(10_000_001) * 100.0], ids=["sparse", "dense"])
def test_a_run_of_hours_of_computation_can_be_stopped(times):
    """A signal's handler runs between two parts of the run; without parts it would wait for the last sample."""
    def interrupt(number, frame):
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.5)
        with pytest.raises(KeyboardInterrupt):
            vibro_ros.simulate(vibro_ros.load_scene("damped"), times=times)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def test_samples_are_the_states_at_their_instants():
    """On from where the device stands, after a command, with two samples at one instant."""
    made, whole = device(scene="device"), device(scene="device")
    for each in (made, whole):
        each.command(motor_speed=80.0)
        each.advance_to(0.5)
    times = [0.5, 0.61, 0.7, 0.7]
    samples = whole.sample(times)
    for index, time in enumerate(times):
        made.advance_to(time)
        for field in dataclasses.fields(samples):
            assert getattr(samples, field.name)[index] == getattr(made.state, field.name)
    assert whole.time == 0.7


@pytest.mark.parametrize("times", [[0.4], [0.6, 0.5], [math.nan], [[0.6]], [math.inf]])
def test_samples_run_forwards(times):
    made = device()
    made.advance_to(0.5)
    with pytest.raises(ValueError, match="ascending array of finite instants, none below 0.5 s"):
        made.sample(times)
    assert made.time == 0.5


def test_statistics_count_the_events_that_were_taken():
    made = device()
    taken = []
    for time in (0.05, 0.1, 0.3):
        made.advance_to(time)
        taken.extend(made.take_events()["kind"])
    counts = {kind: taken.count(kind) for kind in taken}
    assert {name: made.statistics[name] for name in counts} == counts
    assert len(made.take_events()) == 0


def test_tolerance_and_method_override_the_scene():
    scene = vibro_ros.load_scene("damped")
    usual = vibro_ros.simulate(scene, duration=0.1, rate=100.0)
    asked = vibro_ros.simulate(scene, duration=0.1, rate=100.0, tolerance=1e-12, method="exact")
    assert np.array_equal(usual.body_position, asked.body_position)
    with pytest.raises(ValueError, match="solver.tolerance: 1e-15 is out of range; give .* 1e-12 to 0.001 m"):
        vibro_ros.simulate(scene, duration=0.1, rate=100.0, tolerance=1e-15)
    with pytest.raises(ValueError, match="solver.method: 'euler' is unknown; choose one of exact"):
        vibro_ros.simulate(scene, duration=0.1, rate=100.0, method="euler")


@pytest.mark.parametrize(("name", "changes"), [
    *((name, changes) for name in ("device", "unilateral", "rigid")
      for changes in ({}, {"effects.motor": "lag"}, {"upper.plate.stiffness": 1e9})),
    *(("rigid", {"solver.method": method, "solver.step": 1.3e-4}) for method in sorted(SCHEMES))])
def test_a_device_goes_on_from_a_checkpoint_bit_for_bit(name, changes):
    scene = vibro_ros.load_scene(name).with_parameters(changes)
    device = vibro_ros.Simulator(scene)
    device.command(motor_speed=110.0, upper_gap=5e-4)
    device.advance_to(0.777)  # amid ramps, with a history of its own
    device.take_events()
    follower = vibro_ros.Simulator(scene)
    follower.advance_to(2.0)
    follower.restore(device.checkpoint())
    assert follower.time == device.time
    ends = []
    for one in (device, follower):
        one.advance_to(1.1)
        one.command(motor_speed=60.0, inclined_gap=-2e-4)
        samples = one.sample(np.arange(1.2, 2.0, 0.01))
        ends.append([getattr(samples, field).tobytes() for field in samples.__dataclass_fields__]
                    + [one.take_events().tobytes()])
    assert ends[0] == ends[1]


def test_a_checkpoint_of_another_scene_is_refused():
    device = vibro_ros.Simulator(vibro_ros.load_scene("device"))
    before = device.checkpoint()
    with pytest.raises(ValueError, match="same scene and version"):
        device.restore(before[:-1])
    assert device.checkpoint().tobytes() == before.tobytes()
