"""The online estimator against robots whose truth is known: a scene with parameters 2 % away, and field sensors."""

from dataclasses import fields

import numpy as np
import pytest
from following import BANDWIDTH, FAULTS, FIELD, GAPS, TICK, begun, changed_verdicts, follow, measured

from vibro_lab.twin.estimator import Estimator
from vibro_lab.twin.particles import INDEX, FilterSettings, MeasuredNumber, Particle
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.model.faults import Incident
from vibro_ros.sensors.device import new_device
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.simulator import Simulator

FREE = ("ground.friction", "mass.body", "mass.upper", "mass.inclined", "upper.spring.stiffness",
        "inclined.spring.stiffness", "upper.spring.damping", "inclined.spring.damping")
BELIEVED = load_scene("damped").with_parameters({
    "effects.motor": "ramp", "motor.speed": 100.0, **FIELD})
SIGNS = (1, 1, -1, 1, -1, 1, 1, -1)
TRUE = BELIEVED.with_parameters({name: (1.0 + 0.02 * sign) * BELIEVED[name]
                                 for name, sign in zip(FREE, SIGNS, strict=True)})


def new_estimator(**changes) -> Estimator:
    return Estimator(BELIEVED, **{"free": FREE, "bandwidth": BANDWIDTH, **changes})


def followed(estimator: Estimator, duration: float, acts: dict | None = None, begin: float = 0.0,
             unheard: dict | None = None) -> list:
    """Return what `follow` yields of the true robot, which begins with the commands `unheard` `begin` [s] earlier."""
    robot = new_device(TRUE)
    robot.command(**(unheard or {}))
    robot.advance_to(begin)
    robot.take_measurements()
    return list(follow(estimator, robot, duration, acts or {}, begin))


def command(**given: float):
    """Return an act that commands the robot, a little after the estimator has heard it."""
    def act(robot, estimator) -> None:
        estimator.command(robot.time - 0.4 * TICK, **given)
        robot.command(**given)

    return act


def speed_errors(rows: list) -> np.ndarray:
    return np.array([estimate.mean[INDEX["body_velocity"]] - true.body_velocity for estimate, true, _ in rows])


def rms(errors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(errors**2)))


@pytest.fixture(scope="module")
def ordinary() -> list:
    """Eight seconds with two other motor speeds."""
    return followed(new_estimator(), 8.0, {2.5: command(motor_speed=120.0), 5.5: command(motor_speed=90.0)})


def test_speed_and_place_with_wrong_parameters(ordinary):
    """The open loop, which uses no sensor, has an error of 22 mm/s."""
    open_loop, errors = Simulator(BELIEVED), []
    commands = {2.5: 120.0, 5.5: 90.0}
    for estimate, true, _ in ordinary:
        for at in [at for at in commands if at < estimate.time]:
            open_loop.advance_to(at)
            open_loop.command(motor_speed=commands.pop(at))
        open_loop.advance_to(estimate.time)
        errors.append(open_loop.state.body_velocity - true.body_velocity)
    assert rms(speed_errors(ordinary)) < 5e-3
    assert rms(speed_errors(ordinary)) < 0.4 * rms(np.array(errors))
    places = [estimate.mean[INDEX["body_position"]] - true.body_position for estimate, true, _ in ordinary]
    assert rms(np.array(places)) < 0.6e-3  # one measurement: 1 mm


def test_covariance_is_honest(ordinary):
    """95 % of the errors lie within 2.5 standard deviations, and a half of them beyond 0.3; a normal error: 98.8, 76 %.
    """
    for name in ("body_position", "body_velocity"):
        index = INDEX[name]
        ratios = np.array([abs(getattr(true, name) - estimate.mean[index]) / np.sqrt(estimate.variance[index])
                           for estimate, true, _ in ordinary])
        assert np.mean(ratios < 2.5) >= 0.95, name
        assert np.mean(ratios > 0.3) >= 0.5, name


@pytest.mark.parametrize("robot, difference", [
    ("damped at 100 rad/s", "viscous friction of 5 N·s/m"), ("damped at 100 rad/s", "parameters 8 % farther off"),
    ("device at 60 rad/s", "ground's restitution of 0.3")])
def test_variance_grows_with_what_the_scene_lacks(robot, difference):
    """From the spread of the particles alone, 34 to 48 % of these errors lay within 2.5 deviations."""
    estimator, device = begun(robot, 0, difference)
    ratios = np.array([abs(true.body_velocity - estimate.mean[INDEX["body_velocity"]])
                       / np.sqrt(estimate.variance[INDEX["body_velocity"]])
                       for estimate, true, _ in follow(estimator, device, 5.0)])
    assert np.mean(ratios < 2.5) >= 0.85
    assert np.mean(ratios > 0.3) >= 0.3  # nor is the variance a number that every error is smaller than


@pytest.mark.slow
@pytest.mark.settings
@pytest.mark.parametrize("name", [field.name for field in fields(FilterSettings)])
def test_verdicts_stand_when_a_setting_is_halved_and_doubled(name):
    assert changed_verdicts(name) == []


def test_nothing_is_said_of_a_robot_that_keeps_to_the_model(ordinary):
    assert {departure for _, _, departure in ordinary} == {None}


@pytest.mark.parametrize("fault, changed, words", [
    (Incident("motor_stall", 10.0), {}, "motor_stall"),
    (Incident("friction_patch", 10.0, "", 0.03, -100.0, 100.0), {}, "friction_patch of about 0.02"),
    (Incident("plate_stuck", 10.0, "inclined"), {"inclined_gap": 0.002}, "plate_stuck of inclined"),
    (Incident("sensor_freeze", 10.0, "encoder"), {}, "sensor_freeze of encoder"),
], ids=["stall", "ice", "plate", "encoder"])
def test_fault_is_named_within_a_second(fault, changed, words):
    """A stuck plate shows when it is commanded to move."""
    def fail(robot, estimator) -> None:
        robot.fail(*fault)
        if changed:
            command(**changed)(robot, estimator)

    rows = followed(new_estimator(), 4.0, {3.0: fail})
    named = [(estimate.time, departure) for estimate, _, departure in rows if departure]
    assert named and 3.0 < named[0][0] <= 4.0
    assert {departure.words for _, departure in named} == {words}
    assert abs(named[0][1].since - 3.0) < 0.7


@pytest.mark.parametrize("fault", ["plate_stuck of upper", "none, but both plates move"])
def test_plates_of_a_chaotic_robot(fault):
    """A plate that is commanded to move and does not is named, and one that moves is not."""
    estimator, device = begun("device at 90 rad/s", 0)
    for _ in follow(estimator, device, 2.5):
        pass
    incident, gaps = FAULTS[fault]
    if incident:
        device.fail(*incident)
    commands = {gap: GAPS[gap] for gap in gaps}
    estimator.command(device.time, **commands)
    device.command(**commands)
    words = {departure.words for _, _, departure in follow(estimator, device, 1.0) if departure}
    assert words == ({fault} if incident else set())


def test_end_of_a_fault_is_noticed():
    rows = followed(new_estimator(), 4.5, {2.0: lambda robot, _: robot.fail("motor_stall", 1.0)})
    assert rows[50][2].words == "motor_stall"  # at 2.55 s
    assert rows[-1][2] is None
    assert rms(speed_errors(rows[-10:])) < 30e-3  # of 220: the crank turns again as the robot's


def test_an_encoder_that_freezes_is_not_used_and_its_end_is_noticed():
    """The estimate goes on with the other sensors."""
    rows = followed(new_estimator(), 5.0, {2.0: lambda robot, _: robot.fail("sensor_freeze", 1.5, "encoder")})
    words_by_time = {round(estimate.time, 2): departure.words for estimate, _, departure in rows if departure}
    assert set(words_by_time.values()) == {"sensor_freeze of encoder"}
    assert 2.0 < min(words_by_time) < 3.0 and 3.4 < max(words_by_time) < 3.7
    frozen = [row for row in rows if 3.0 < row[0].time < 3.5]
    assert rms(speed_errors(frozen)) < 20e-3  # of 220
    assert rms(speed_errors(rows[-10:])) < 8e-3


def test_one_bad_message_does_not_move_the_estimate():
    estimator, robot = new_estimator(), new_device(TRUE)
    for tick in range(1, 401):
        robot.advance_to(tick * TICK)
        for measurement in measured(robot):
            estimator.measure(measurement)
        if tick == 395:
            estimator.measure(MeasuredNumber(tick * TICK, "body_position", 1e6, 1e-6))
    estimator.advance_to(2.0)
    assert abs(estimator.estimate().mean[INDEX["body_position"]] - robot.state.body_position) < 2e-3


def test_beginning_in_the_middle_of_a_motion():
    """The crank's angle and speed come from the encoder, the place from the tracking system; the rest converges."""
    rows = followed(new_estimator(), 3.5, begin=1.234, unheard={"motor_speed": 110.0})
    assert rms(speed_errors(rows[-20:])) < 8e-3
    estimate, true, _ = rows[-1]
    assert estimate.mean[INDEX["crank_angle"]] == pytest.approx(true.crank_angle, abs=5e-3)


def test_division_of_time_changes_nothing():
    robot = new_device(TRUE)
    robot.advance_to(1.0)
    whole, divided = new_estimator(particles=6), new_estimator(particles=6)
    messages = list(measured(robot))
    for message in messages:
        whole.measure(message)
        divided.measure(message)
    whole.advance_to(1.0)
    for time in np.linspace(0.0, 1.0, 37):
        divided.advance_to(time)
    assert np.array_equal(whole.estimate().mean, divided.estimate().mean)
    late = divided.late
    divided.measure(messages[0])
    assert divided.late == late + 1


def test_prediction_is_clipped_as_the_sensor_clips():
    estimator = new_estimator(particles=4)
    for k in range(1, 10):
        estimator.measure(MeasuredNumber(0.005 * k, "acceleration_x", 0.5, 1e-4, 0.5))
    estimator.advance_to(0.05)
    assert max(abs(0.5 - innovation.value) for innovation in estimator.innovations) <= 0.5


def test_particle_that_cannot_go_on_is_replaced(monkeypatch):
    estimator, robot, predict = new_estimator(particles=6), new_device(TRUE), Particle.predict
    robot.advance_to(0.5)
    for message in measured(robot):
        estimator.measure(message)
    estimator.advance_to(0.25)
    broken = estimator._particles[2]  # no robot is known whose motion ends

    def fail(particle, *arguments) -> None:
        if particle is broken:
            raise SimulationError("at 0.3 s")
        predict(particle, *arguments)

    monkeypatch.setattr(Particle, "predict", fail)
    estimator.advance_to(0.5)
    assert estimator.restarts == 0 and broken not in estimator._particles
    assert np.isfinite(estimator.estimate().mean).all()


def test_gap_starts_again():
    estimator = new_estimator(particles=4)
    estimator.advance_to(1000.0)
    assert (estimator.restarts, round(estimator.time, 6)) == (1, 1000.0)


@pytest.mark.parametrize("name", ["effects.motor", "sensors.imu.rate", "ground.slope", "nothing"])
def test_free_parameter_is_refused(name):
    with pytest.raises(ValueError, match=f"^{name}: is no parameter above 0 of this scene's machine; leave it out$"):
        Estimator(BELIEVED, (name,))
