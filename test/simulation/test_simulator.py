"""The stateful device: events and their instants, samples, long runs, and checkpoints."""

import dataclasses
import importlib.metadata
import math
import re
import signal

import numpy as np
import pytest
from commanded_device import RAMP, device, of_kind, refused, state_bits, suffer

import vibro_ros
from vibro_ros.simulation.motion import Motion
from vibro_ros.simulation.samples import Samples
from vibro_ros.solver import event_loop
from vibro_ros.solver.methods import SCHEMES


@pytest.mark.parametrize("call", [
    lambda scene: vibro_ros.simulate(scene, 1.0, 10.0, method="rk4"), vibro_ros.Simulator, vibro_ros.SensedSimulator])
def test_a_name_in_place_of_a_scene_is_refused_with_the_remedy(call):
    with pytest.raises(TypeError, match=r"^scene: 'device' is no Scene; give load_scene\('device'\)$"):
        call("device")
    with pytest.raises(TypeError, match=r"^scene: \{.*\} is no Scene; give one that load_scene returns$"):
        call({"motor.speed": 100.0})  # which cannot be hashed


def test_the_package_says_its_version():
    assert vibro_ros.__version__ == importlib.metadata.version("vibro_ros")


def falling(gap):
    """The upper mass alone, released at 0 with its slider standing at 0.08 m: u = 0.08 (1 - cos 100 t)."""
    return device({"motor.speed": 0.0, "start.state": "zero", "upper.gap": gap, "effects.inclined_mass": False})


@pytest.mark.parametrize("commanded", [False, True])
def test_a_contact_is_reported_once_with_its_first_instant(commanded):
    """The plate is at the slider: the mass arrives at 8 m/s after a quarter period; the peak is √(v² m k4) / √(1 +
    k2/k4). k2 and k4 together push it back, from the deepest point v/√((k2 + k4)/m). Commands that arrive during the
    contact, one of them at the deepest point, neither split nor change it.
    """
    made = falling(0.02)
    contact, lasts = math.pi / 200, math.pi / math.sqrt((1e3 + 1e7) / 0.1)
    for share in (0.1, 0.5, 0.5, 0.9):
        made.advance_to(contact + share * lasts)
        assert made.state.upper_plate_force > 0.0 and len(made.take_events()) == 0
        if commanded:
            made.command(upper_gap=0.02)
    made.advance_to(0.03)
    (event,) = of_kind(made.take_events(), "upper_contact")
    assert event["time"] == pytest.approx(contact, rel=1e-14)
    assert event["speed"] == pytest.approx(8.0, rel=1e-14)
    assert event["peak_force"] == pytest.approx(8.0 * math.sqrt(0.1 * 1e7) / math.sqrt(1 + 1e-4), rel=1e-12)
    assert event["duration"] == pytest.approx(lasts, rel=1e-10)
    made.advance_to(0.04)
    assert len(of_kind(made.take_events(), "upper_contact")) == 0


def test_commands_and_samples_at_the_instant_of_an_event():
    """At the instant of the contact, one rounding before it and one after it, the trajectory is the same to rounding.
    """
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


def test_a_plate_commanded_away_releases_its_mass_at_once():
    """Without tension: at the instant of the command the damper would pull with c E' = 1 N, which must not appear."""
    for instant in np.linspace(0.04, 0.06, 60) * math.pi / 3:
        made = device(RAMP | {"effects.adhesion": False, "upper.gap": 0.0199, "upper.plate.damping": 100.0,
                              "upper.spring.damping": 20.0, "upper.plate.stiffness": 1e4, "gap_actuator.speed": 0.5})
        made.advance_to(instant)
        assert made.state.upper_plate_force > 0.0
        made.command(upper_gap=0.03)
        assert made.state.upper_plate_force == 0.0


@pytest.mark.parametrize("times", [[0.0, 1e9], np.arange(10_000_001) * 100.0], ids=["sparse", "dense"])
def test_a_run_of_hours_of_computation_can_be_stopped(times):
    """A signal's handler runs between two parts of the run; without parts it would wait until the last sample."""
    def interrupt(number, frame):
        raise KeyboardInterrupt

    handler_before = signal.signal(signal.SIGALRM, interrupt)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.5)
        with pytest.raises(KeyboardInterrupt):
            vibro_ros.simulate(vibro_ros.load_scene("damped"), times=times)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, handler_before)


@pytest.mark.parametrize("method", ["exact", *sorted(SCHEMES)])
def test_the_state_is_a_sample_taken_now_whatever_came_before(method):
    """After an advance, a command, samples and a checkpoint; the constructor of the class gives the same."""
    scene = vibro_ros.load_scene("device").with_parameters({"solver.method": method, "solver.step": 1.3e-4})
    made, other = vibro_ros.Simulator(scene), vibro_ros.Simulator(scene)
    states = []

    def look():
        state, (sample,) = made.state, zip(*dataclasses.astuple(other.sample([other.time])), strict=True)
        assert state_bits(made) == np.array(sample).tobytes()
        assert state == made.state == Samples(**dataclasses.asdict(state))
        assert all(type(value) is float for value in dataclasses.astuple(state))
        states.append(state)

    look()
    start = made.checkpoint()
    for step in (lambda device: device.advance_to(0.3), lambda device: device.command(motor_speed=90.0),
                 lambda device: device.advance_to(0.4), lambda device: device.sample([0.41, 0.5]),
                 lambda device: device.restore(start)):
        for each in (made, other):
            step(each)
        look()
    assert states[-1] == states[0] != states[1]


def test_statistics_count_the_events_that_were_taken():
    made = device()
    taken = []
    for time in (0.05, 0.1, 0.3):
        made.advance_to(time)
        taken.extend(made.take_events()["kind"])
    counts = {kind: taken.count(kind) for kind in taken}
    assert {name: made.statistics[name] for name in counts} == counts
    assert len(made.take_events()) == 0


def test_a_checkpoint_of_another_scene_is_refused():
    made = device(scene="device")
    with refused(made, "same scene and version"):
        made.restore(made.checkpoint()[:-1])


DC = {"effects.motor": "dc", "motor.control_rate": 400.0}


@pytest.mark.process
@pytest.mark.parametrize("changes", [
    {}, *({"solver.method": method, "solver.step": 1e-4} for method in sorted(SCHEMES)),
    *(DC | {"motor.control": law} for law in ("voltage", "speed_by_voltage", "speed_by_current"))],
    ids=lambda changes: "-".join(map(str, changes.values())))
def test_a_forged_checkpoint_is_refused_without_a_crash(changes):
    """A bag may have any numbers: each number of a checkpoint in turn, those of faults, filters and controllers
    included, is not finite or far beyond the tables. A refused checkpoint changes nothing; with an accepted one the
    device goes on, or fails with an error that names the checkpoint.
    """
    scene = vibro_ros.load_scene("device").with_parameters({"motor.speed": 100.0, **changes})
    made, other = (vibro_ros.Simulator(scene, 300.0 * ("solver.method" not in changes)) for _ in range(2))
    made.advance_to(0.2)
    suffer(made)
    whole, refused = made.checkpoint(), 0
    far = 1e3 if scene.has_rotor else 1e9  # a spring of 1e9 m would turn a crank for minutes
    for place in range(1, len(whole)):
        for number in (math.nan, (math.inf, far, -far, 1e-300)[place % 4]):
            spoilt = whole.copy()
            spoilt[place] = number
            other.restore(whole)
            try:
                other.restore(spoilt)
            except ValueError as error:
                assert re.search("no state that this device can be|the checkpoint has shape|supply_voltage", str(error))
                assert other.checkpoint().tobytes() == whole.tobytes()
                refused += 1
                continue
            try:
                other.advance_to(0.2005)
                assert np.isfinite(other.values).all()
            except vibro_ros.SimulationError as error:
                assert "report the scene" not in str(error)
    assert refused >= 1.25 * len(whole) - 10  # all that are not finite


def test_a_buffer_full_of_events_within_a_nanosecond_ends_the_run():
    """A stepper in place of the solver's, because the checks of states leave no scene that does this."""
    motion, calls = Motion(vibro_ros.load_scene("damped")), []

    class Rattle:
        def advance(self, *_: object) -> tuple[int, int, int]:
            calls.append(self)
            return event_loop.EVENTS_FULL, 0, 0

    motion.stepper = Rattle()
    with pytest.raises(vibro_ros.SimulationError, match="events follow each other without any progress of time"):
        motion.advance_at_once(np.array([1.0]), motion.new_trace(1))
    assert len(calls) == 1
