"""Scripts that make parameters tellable: the promised deviations, the choice, the file that the controller plays."""

import math

import numpy as np
import pytest

import vibro_ros
from vibro_lab.identification import excitation
from vibro_lab.identification.excitation import LABORATORY, candidates, excite, sensors_of
from vibro_lab.identification.recording import Channel, Recording
from vibro_lab.identification.windows import state_names
from vibro_lab.study import identify
from vibro_ros.ros.controller.script import read_script

DAMPED = vibro_ros.load_scene("damped")
FREE = ("ground.friction", "upper.spring.stiffness", "inclined.spring.damping")
DURATION = 2.0


@pytest.fixture(scope="module")
def excitations():
    return excite(DAMPED, FREE, DURATION)


def single_shooting(scene, free, commands):
    """Deviations of a fit of the whole motion, whose parameters and start are unknown, by differences of `simulate`."""
    times = np.arange(round(DURATION * 500.0)) / 500.0
    states = [name for name in state_names(scene)]
    start = vibro_ros.Simulator(scene).state
    fields = [name.split(".")[1] for name in LABORATORY]
    sigmas = np.array([sigma for _, sigma in LABORATORY.values()])

    def measured(changes):
        given = {f"start.{name}": getattr(start, name) + changes.get(name, 0.0) for name in states}
        parameters = {name: scene[name] * (1.0 + changes.get(name, 0.0)) for name in free}
        run = vibro_ros.simulate(scene.with_parameters(parameters | given | {"start.state": "given"}), times=times,
                                 commands=commands)
        return np.concatenate([getattr(run, field) / sigma for field, sigma in zip(fields, sigmas, strict=True)])

    steps = dict.fromkeys(free, 1e-6) | dict.fromkeys(states, 1e-8)
    jacobian = np.column_stack([(measured({name: step}) - measured({name: -step})) / (2.0 * step)
                                for name, step in steps.items()])
    norms = np.linalg.norm(jacobian, axis=0)
    covariance = np.linalg.inv((jacobian / norms).T @ (jacobian / norms))
    return np.sqrt(np.diag(covariance))[:len(free)] / norms[:len(free)]


def test_deviations_are_those_of_a_fit_of_the_whole_motion(monkeypatch):
    """The motion of `damped` contracts, so that small differences give slopes of all of it.

    10 % are for the joints of windows, which are not perfect.
    """
    monkeypatch.setattr(excitation, "_SPEEDS", {name: excitation._SPEEDS[name] for name in (
        "a constant speed", "slow and fast")})
    careful = excite(DAMPED, FREE, DURATION)
    monkeypatch.setattr(excitation, "TIGHT", 1e-5)  # windows are joined to 10 nm and 1 µm/s
    monkeypatch.setattr(excitation, "_STEP", 1e-6)
    monkeypatch.setattr(excitation, "_STATE_STEP", 1e-5)
    monkeypatch.setattr(excitation, "_BENT", 1e9)  # no measurement is left out
    by_small_steps = {candidate.name: candidate for candidate in excite(DAMPED, FREE, DURATION)}
    assert len(by_small_steps) == 3
    for candidate in careful:
        exact = single_shooting(DAMPED, FREE, candidate.commands)
        np.testing.assert_allclose([by_small_steps[candidate.name].relative[name] for name in FREE], exact, rtol=0.1)
        share = np.array([candidate.relative[name] for name in FREE]) / exact
        assert (share > 0.95).all()
        assert (share < 4.0).all()


def test_a_chaotic_motion_promises_no_more_than_a_regular_one(monkeypatch):
    """Where all that changes is counted, as in an infinitesimal derivative, rattling promises 40 times more."""
    monkeypatch.setattr(excitation, "_SPEEDS", {name: excitation._SPEEDS[name] for name in (
        "a constant speed", "slow and fast")})
    free = ("ground.friction", "upper.spring.stiffness")
    relative = {candidate.name: candidate.relative for candidate in excite(vibro_ros.load_scene("device"), free, 3.0)}
    assert len(relative) == 3
    regular = relative.pop("a constant speed")
    for chaotic in relative.values():
        assert all(chaotic[name] > 0.9 * regular[name] for name in free)


def test_the_best_script_comes_first_and_a_constant_speed_is_among_them(excitations):
    worst = [max(candidate.relative.values()) for candidate in excitations]
    assert worst == sorted(worst)
    assert "a constant speed" in [candidate.name for candidate in excitations]
    for candidate in excitations:
        assert candidate.deviations == pytest.approx({name: DAMPED[name] * candidate.relative[name] for name in FREE})


def test_the_controller_plays_the_script(excitations, tmp_path):
    for number, candidate in enumerate(excitations):
        path = tmp_path / f"{number}.yaml"
        path.write_text(candidate.script)
        script = read_script(path)
        assert script.duration == pytest.approx(DURATION)
        for time, given in candidate.commands:
            assert script.command_at(time + 1e-6).items() >= given.items()


def test_a_parameter_without_effect_is_not_promised_and_plates_move_where_theirs_are_free():
    excitations = excite(DAMPED, ("ground.friction", "gap_actuator.speed"), 1.0)
    assert "with moving plates" in excitations[0].name
    assert excitations[0].relative["gap_actuator.speed"] < 0.1
    still = next(candidate for candidate in excitations if "moving" not in candidate.name)
    assert still.worst == (1, still.relative["ground.friction"])
    assert "gap_actuator.speed: cannot be told" in still.script


def test_a_tracking_system_alone_tells_less(excitations):
    sensors = {"tracking.body_position": (100.0, 1e-3)}
    scene = DAMPED.with_parameters({"sensors.tracking.rate": 100.0, "sensors.tracking.noise": 1e-3})
    alone = {candidate.name: candidate for candidate in excite(DAMPED, FREE, DURATION, sensors)}
    assert {candidate.name: candidate.relative for candidate in excite(scene, FREE, DURATION)} == {
        name: candidate.relative for name, candidate in alone.items()}
    for candidate in excitations:
        assert candidate.relative["ground.friction"] < 0.2 * alone[candidate.name].relative["ground.friction"]


@pytest.mark.parametrize(("changes", "limit"), [
    ({"motor.max_speed": 90.0}, 90.0),
    ({"effects.motor": "dc", "motor.control": "voltage", "motor.supply_voltage": 12.0}, 12.0)])
def test_commands_keep_to_the_limits_of_the_motor(changes, limit):
    scene = DAMPED.with_parameters({"motor.speed": 0.0} | changes)
    values = {value for _, commands in candidates(scene, FREE, 5.0) for _, given in commands
              for name, value in given.items() if name == scene.motor_command}
    assert 0.95 * limit < max(values) <= limit
    assert min(values) == 0.0
    for name, commands in candidates(scene, ("upper.gap",), 5.0):
        for _, given in commands:
            assert all(math.isfinite(scene.checked_command(*command)) for command in given.items()), name


@pytest.mark.parametrize(("arguments", "why"), [
    ((("ground.friction",), 0.5), "duration: 0.5 s is out of range; give 1 to 600 s"),
    ((("ground.fiction",), 2.0), "ground.fiction"),
    ((FREE, 2.0, {"imu/data_raw.acceleration_x": (1e3, 0.1)}), "measures no field of a sample")])
def test_what_cannot_be_excited_is_refused(arguments, why):
    with pytest.raises(ValueError, match=why):
        excite(DAMPED, *arguments)


def test_the_command_writes_the_best_script_for_the_controller(tmp_path, capsys):
    words = ["--excite", "1", "--scene", "damped", "--free", "ground.friction", "--output", str(tmp_path)]
    assert identify.main(words) == 0
    assert read_script(tmp_path / "script.yaml").duration == pytest.approx(1.0)
    printed = capsys.readouterr().out
    assert "Expected standard deviations of a fit" in printed
    assert "starts and stops, 0.5 s each: the worst of 1 to" in printed
    assert identify.main(["--scene", "damped", "--output", str(tmp_path)]) == 2
    assert "give a BAG, or --excite SECONDS" in capsys.readouterr().err


def test_sensors_of_a_recording_are_those_that_will_measure_again():
    times = np.arange(11) / 10.0
    channels = tuple(Channel(*name, times, times, sigma, "given") for name, sigma in (
        (("odom", "body_position"), 1e-4), (("imu/data_raw", "acceleration_x"), 0.3)))
    recording = Recording(0.0, 1.0, channels, (), ())
    assert sensors_of(recording) == {"odom.body_position": (pytest.approx(10.0), 1e-4)}
