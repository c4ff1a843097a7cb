"""`identify` against recordings of heyoka whose truth is known, against 40 draws of noise, and against bad visitors.

The bags of `laboratory.record` are not made by the device's own solver. `test_intervals_cover` draws its recordings
from it, because only noise is judged there.
"""

import math

import numpy as np
import pytest
from laboratory_messages import imu, joint_states, numbers, odometry, tracking, written
from scipy.signal import lfilter

import vibro_ros
from vibro_lab.identification.fit import Fitting
from vibro_lab.identification.identify import identify
from vibro_lab.identification.inference import intervals
from vibro_lab.identification.recording import Channel, Recording, read_recording
from vibro_lab.identification.unknowns import Unknowns
from vibro_lab.study.identification_page import identification_page
from vibro_ros.bag.stream import BagError
from vibro_ros.simulation.workers import core_count, in_processes

DAMPED = vibro_ros.load_scene("damped").with_parameters({"motor.speed": 100.0})
TICK = math.tau / 4096
FIELDS = {"odom": ("body_position", "body_velocity"),
          "joint_states": ("upper_position", "upper_velocity", "inclined_position", "inclined_velocity")}
FREE = ("ground.friction", "mass.body", "upper.gap")
THIRTEEN = ("ground.friction", "mass.body", "guide.angle", *(
    f"{side}.{name}" for side in ("upper", "inclined") for name in (
        "spring.stiffness", "spring.damping", "plate.stiffness", "plate.damping", "gap")))
#: Largest relative errors on a laboratory bag of 4 s; gaps [m] and c / sqrt(k) of plates stand beside them.
ALLOWED = {"ground.friction": 3e-3, "mass.body": 5e-3, "guide.angle": 1.5e-3,
           **{f"{side}.spring.{name}": share for side in ("upper", "inclined")
              for name, share in (("stiffness", 3e-3), ("damping", 1e-2))}}
GAP, RESTITUTION = 30e-6, 2e-2


def laboratory():
    """Return `laboratory.record`; skip without heyoka."""
    pytest.importorskip("heyoka", reason="heyoka, the extra `bench`, is not installed")
    from laboratory import record
    return record


def deviation(field):
    return 1e-3 if field.endswith("velocity") else 5e-5


def noise(random, count, correlation=0.0):
    """Return noise of variance 1 whose neighbours are so correlated."""
    white = random.standard_normal(count)
    white[1:] *= math.sqrt(1.0 - correlation**2)
    return lfilter([1.0], [1.0, -correlation], white)


def assert_found(identified, truth, allowed=1.0):
    """Assert that all of `THIRTEEN` are within so many times what issue 38 allows."""
    for name, share in ALLOWED.items():
        assert identified.values[name] == pytest.approx(truth[name], rel=allowed * share), name
    for side in ("upper", "inclined"):
        assert identified.values[f"{side}.gap"] == pytest.approx(truth[f"{side}.gap"], abs=allowed * GAP)
        restitution, true = (values[f"{side}.plate.damping"] / math.sqrt(values[f"{side}.plate.stiffness"])
                             for values in (identified.values, truth))
        assert restitution == pytest.approx(true, rel=allowed * RESTITUTION)


@pytest.mark.process
def test_a_laboratory_recording_tells_a_few_parameters_within_their_intervals(tmp_path):
    """The others are at the truth. Each interval is doubled: one of five would miss in a fifth of all recordings."""
    made = laboratory()(tmp_path / "bag", "damped", seed=2, duration=1.5)
    free = (*FREE, "guide.angle", "upper.spring.damping")
    scene = made.truth.with_parameters({name: made.scene[name] for name in free})
    identified = identify(made.bag, scene, free, workers=1)
    for name, (low, high) in identified.intervals.items():
        assert low < identified.values[name] < high
        assert abs(identified.values[name] - made.truth[name]) < high - low, name
        assert high - low < abs(scene[name] - made.truth[name]), name  # the recording has told something
    assert all(0.9 < square < 1.1 for square in identified.chi_square.values()), identified.chi_square
    assert set(identified.chi_square) == {"odom", "joint_states", "encoder"}
    assert identified.verdict.startswith("the model fits") and identified.rank == ()
    deviations = np.sqrt(np.diag(identified.covariance))
    halves = np.array([high - low for low, high in identified.intervals.values()]) / (2.0 * 1.96)
    np.testing.assert_allclose(halves, deviations, rtol=0.1)  # so well told, the likelihood is nearly normal
    times = np.arange(0.0, 1.5, 0.01)
    positions, true = (vibro_ros.simulate(scene, times=times, commands=identified.recording.commands).body_position
                       for scene in (identified.scene, made.truth))
    assert np.abs(positions - true).max() < 1e-4  # m, of a way of 0.2 m; two standard deviations of a measurement
    assert identified.windows["used"].all() and identified.passes < 500


@pytest.mark.process
def test_a_recording_with_every_fault_of_a_laboratory_is_fitted_as_a_clean_one(tmp_path):
    """Stamps that jitter by 0.3 ms, a camera that is late by 3 ms and states a third of its noise, 2 % wild samples,
    10 % lost ones, and a motor that was started before the recording. Each interval is doubled, as above."""
    record = laboratory()
    from laboratory import Faults
    made = record(tmp_path / "bag", "damped", seed=2, duration=1.5, faults=Faults(
        jitter=3e-4, late={"odom": 0.003}, outliers=0.02, lost=0.1, stated=0.33, begins_in_motion=0.5))
    free = (*FREE, "guide.angle")
    scene = made.truth.with_parameters({name: made.scene[name] for name in free} | {"motor.speed": 90.0})
    identified = identify(made.bag, scene, free, workers=1)
    assert identified.verdict.startswith("the model fits"), identified.verdict
    for name, (low, high) in identified.intervals.items():
        assert abs(identified.values[name] - made.truth[name]) < high - low, name
    assert identified.sensors["odom.offset"][0] == pytest.approx(0.003, abs=1e-4)
    jitters = {noise.sensor: noise.jitter for noise in identified.noises}
    assert all(jitter == pytest.approx(3e-4, rel=0.15) for jitter in jitters.values()), jitters
    assert 5 <= len(identified.outliers["odom.body_position"]) <= 30  # of 675 samples that are not lost, 13 are wild
    assert any("odom: body_position: states a noise of 1.65e-05" in line for line in identified.words())


@pytest.mark.process
@pytest.mark.parametrize(("robot", "remedy"), [("viscous", "viscous"), ("dragged", "drag")])
def test_a_model_that_lacks_an_effect_is_rejected_in_words_that_name_it(tmp_path, robot, remedy):
    """At one constant speed a slope, a drag and a viscous friction are nearly one; the words name each of them."""
    made = laboratory()(tmp_path / "bag", robot, seed=1, duration=1.5)
    hidden = {"ground.viscous_friction": 0.0, "ground.drag": 0.0}
    scene = made.truth.with_parameters(hidden | {name: made.scene[name] for name in FREE})
    identified = identify(made.bag, scene, FREE, workers=1)
    assert identified.p_value < 1e-3
    assert "odom.body" in identified.verdict and remedy in identified.verdict.partition("try effects")[2], (
        identified.verdict)


RIGID = {f"effects.{side}_contact": "restitution" for side in ("upper", "inclined")}


@pytest.mark.slow
@pytest.mark.parametrize(("robot", "wrong", "more", "words"), [
    ("dragged", {"ground.drag": 0.0}, (), "drag"), ("device", {"effects.normal_force": "weight"}, (), ""),
    ("damped", RIGID, ("upper.plate.restitution",), "")], ids=["drag", "weight", "contact"])
def test_a_wrong_model_of_a_recording_with_every_fault_is_rejected_in_words_that_name_the_evidence(
        tmp_path, robot, wrong, more, words):
    """Neither jitter nor noise of another size takes the blame, and the residuals that speak are the body's. A viscous
    friction of 1 N s/m, which a clean recording tells, is not told from Coulomb's by 1.5 s with every fault."""
    record = laboratory()
    from laboratory import Faults
    made = record(tmp_path / "bag", robot, seed=1, duration=1.5, faults=Faults(
        jitter=3e-4, late={"odom": 0.003}, outliers=0.02, lost=0.1, stated=0.33, begins_in_motion=0.5))
    scene = made.truth.with_parameters(wrong | {name: made.scene[name] for name in FREE})
    identified = identify(made.bag, scene, (*FREE, *more), workers=1)
    assert identified.p_value < 1e-3 and identified.verdict.startswith("the model does not fit"), identified.verdict
    assert "The residuals of odom.body_" in identified.verdict
    assert words in identified.verdict.partition("try effects")[2], identified.verdict


@pytest.mark.slow
def test_a_laboratory_recording_tells_all_thirteen_from_the_defaults(tmp_path):
    made = laboratory()(tmp_path / "bag", "damped", seed=1)
    identified = identify(made.bag, made.scene, THIRTEEN)
    assert_found(identified, made.truth)
    assert identified.passes <= 1000
    assert all(0.9 < square < 1.1 for square in identified.chi_square.values()), identified.chi_square
    assert identified.verdict.startswith("the model fits")


@pytest.mark.process
def test_outliers_do_not_make_a_late_camera_an_early_one(tmp_path):
    """The mean over the windows of the scan said -20 ms: one outlier among a window's few samples spoils its start."""
    record = laboratory()
    from laboratory import Faults
    made = record(tmp_path / "bag", "device", seed=2, faults=Faults(
        rate=100.0, positions_only=True, jitter=3e-4, late={"tracking": 0.003}, outliers=0.02, lost=0.1, stated=0.33,
        begins_in_motion=0.7))

    class ScannedError(Exception):
        pass

    said = list[str]()

    def until_scanned(sentence):
        said.append(sentence)
        if "half turns" in sentence:
            raise ScannedError

    with pytest.raises(ScannedError):
        identify(made.bag, made.scene, THIRTEEN, say=until_scanned)
    (late,) = [float(sentence.split()[-2]) for sentence in said if sentence.startswith("the stamps of tracking")]
    assert late == pytest.approx(3.0, abs=4.0), said  # ms; the scan has steps of 2 ms, and the fit goes on from there


@pytest.mark.slow
@pytest.mark.parametrize(("robot", "seed", "begins_in_motion"), [
    ("device", 1, 0.0), ("device", 1, 0.7), ("moving", 1, 0.0)])
def test_a_robot_that_hops_is_found_by_positions_at_a_hundred_hertz(tmp_path, robot, seed, begins_in_motion):
    """Between two samples a mass strikes and comes back: the states of half turns must go on into the chain, else the
    motion is lost, with values off by 40 % and a verdict that rejects the right model."""
    record = laboratory()
    from laboratory import Faults
    made = record(tmp_path / "bag", robot, seed=seed, faults=Faults(rate=100.0, positions_only=True,
                                                                    begins_in_motion=begins_in_motion))
    identified = identify(made.bag, made.scene, THIRTEEN)
    inside = [low <= made.truth[name] <= high for name, (low, high) in identified.intervals.items()]
    assert sum(inside) >= 12 and identified.p_value > 0.01, identified.verdict
    assert identified.values["ground.friction"] == pytest.approx(made.truth["ground.friction"], rel=0.01)
    for side in ("upper", "inclined"):
        assert identified.values[f"{side}.gap"] == pytest.approx(made.truth[f"{side}.gap"], abs=5e-5)
        name = f"{side}.spring.stiffness"
        assert identified.values[name] == pytest.approx(made.truth[name], rel=0.005)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "most_outside", "gaps"), [
    (1, 1, ("upper.gap", "inclined.gap")), (2, 2, ("inclined.gap",))])
def test_a_robot_that_hops_is_found_by_positions_at_a_hundred_hertz_with_every_fault(
        tmp_path, seed, most_outside, gaps):
    """With seed 1 the noise that was found spoilt the fit, 1 of 13 inside; with seed 2 the camera was taken to be 20 ms
    early. The upper gap shows for 0.1 s only, until a command moves the plate: with seed 2 it is 0.6 mm off, so eleven
    of thirteen are inside."""
    record = laboratory()
    from laboratory import Faults
    made = record(tmp_path / "bag", "device", seed=seed, faults=Faults(
        rate=100.0, positions_only=True, jitter=3e-4, late={"tracking": 0.003}, outliers=0.02, lost=0.1, stated=0.33,
        begins_in_motion=0.7))
    identified = identify(made.bag, made.scene, THIRTEEN)
    inside = [low <= made.truth[name] <= high for name, (low, high) in identified.intervals.items()]
    assert len(THIRTEEN) - sum(inside) <= most_outside and identified.p_value > 0.01, identified.verdict
    assert identified.values["ground.friction"] == pytest.approx(made.truth["ground.friction"], rel=0.01)
    for name in ("upper.spring.stiffness", "inclined.spring.stiffness"):
        assert identified.values[name] == pytest.approx(made.truth[name], rel=0.005)
    for name in gaps:
        assert identified.values[name] == pytest.approx(made.truth[name], abs=5e-5)
    assert identified.sensors["tracking.offset"][0] == pytest.approx(0.003, abs=1e-4)
    assert identified.passes <= 1500


@pytest.mark.slow
def test_noise_that_neighbours_only_bound_is_taken_taken_from_the_residuals(tmp_path):
    """At 100 Hz a mass moves by 4 mm between two samples: neighbouring values give a hundred times its noise, and a fit
    that weighed by it was up to 70 % off and left a quarter of the windows out."""
    record = laboratory()
    from laboratory import Faults
    made = record(tmp_path / "bag", "damped", seed=1, covariances=False, faults=Faults(rate=100.0))
    bounds = [channel.sigma / deviation(channel.field) for channel in read_recording(made.bag, made.scene).channels
              if channel.field.startswith(("upper", "inclined"))]
    assert len(bounds) == 4 and min(bounds) > 100.0
    identified = identify(made.bag, made.scene, THIRTEEN)
    assert_found(identified, made.truth)
    assert identified.windows["used"].mean() > 0.9 and identified.verdict.startswith("the model fits")
    assert all(0.9 < square < 1.1 for square in identified.chi_square.values()), identified.chi_square
    for channel in identified.recording.channels:
        if channel.field.startswith("upper"):
            assert channel.sigma == pytest.approx(deviation(channel.field), rel=0.2)  # 401 samples
    assert sum("by the residuals of the fit" in line for line in identified.said) >= 4


@pytest.mark.process
def test_a_recording_with_pauses_is_fitted_as_a_whole_one(tmp_path):
    """The recorder stops for a minute while the robot stands, and again for 0.7 s while it moves."""
    commands = [(0.0, {"motor_speed": 100.0}), (0.9, {"motor_speed": 0.0}), (61.3, {"motor_speed": 100.0})]
    truth = vibro_ros.load_scene("damped").with_parameters({
        "effects.motor": "ramp", "motor.speed": 0.0, "motor.acceleration": 400.0, "ground.friction": 0.205})
    times = np.concatenate([begin + np.arange(650 if not begin else 401) / 500.0 for begin in (0.0, 61.3, 62.8)])
    random, run = np.random.default_rng(1), vibro_ros.simulate(truth, times=times, commands=commands)

    def noisy(field):
        return getattr(run, field) + deviation(field) * random.standard_normal(len(times))

    speeds = [(instant, given["motor_speed"]) for instant, given in commands]
    bag = written(tmp_path / "bag", numbers("motor_speed", speeds),
                  joint_states(times, {"crank": [TICK * np.round(run.crank_angle / TICK)]}, "encoder"),
                  odometry(times, noisy("body_position"), noisy("body_velocity"), (2.5e-9, 1e-6)),
                  joint_states(times, {f"{side}_mass": [noisy(f"{side}_position"), noisy(f"{side}_velocity")]
                                       for side in ("upper", "inclined")}))
    scene = truth.with_parameters({"ground.friction": 0.2, "mass.body": 1.02})
    identified = identify(bag, scene, ("ground.friction", "mass.body"), workers=1)
    assert identified.values["ground.friction"] == pytest.approx(0.205, rel=1e-3)
    assert identified.values["mass.body"] == pytest.approx(1.0, rel=1e-3)
    assert identified.verdict.startswith("the model fits") and identified.windows["used"].all()
    assert all(((times >= start) & (times < end)).any() for start, end, *_ in identified.windows)
    assert np.diff(identified.windows["end"] - identified.windows["start"]).max() < 1.0  # s; none lies across a pause
    assert (identified.windows["start"] > 62.5).sum() > 3 and identified.passes < 500


@pytest.mark.process
def test_an_imu_tells_what_a_tracking_system_of_a_millimetre_does_not(tmp_path, monkeypatch):
    """The springs are up to 9 % off; one of 1090 N/m lets its mass strike twice a turn, the scene's of 1000 N/m once.

    The IMU's constant error is one of the unknowns. Each interval is doubled: one of three would miss in a seventh of
    all recordings."""
    record = laboratory()
    import laboratory as module
    monkeypatch.setitem(module.FIELD, "sensors.imu.accelerometer.turn_on_bias", 0.5)  # m/s², six times the noise
    made = record(tmp_path / "bag", "damped", "field", seed=1, duration=1.5)
    free = ("mass.body", "upper.spring.stiffness", "inclined.spring.stiffness")
    scene = made.truth.with_parameters({name: made.scene[name] for name in free})
    identified = identify(made.bag, scene, free, workers=1)
    for name, (low, high) in identified.intervals.items():
        assert abs(identified.values[name] - made.truth[name]) < high - low < 0.01 * made.truth[name], name
    assert set(identified.chi_square) == {"tracking", "encoder", "imu/data_raw"}
    assert all(0.8 < square < 1.2 for square in identified.chi_square.values()), identified.chi_square
    assert identified.verdict.startswith("the model fits") and identified.windows["used"].mean() > 0.9
    assert "imu/data_raw: acceleration x; mean square" in identification_page(identified, "bag")
    without = identify(made.bag, made.truth, free, noise={"imu/data_raw": math.inf}, workers=1)
    for name, (low, high) in identified.intervals.items():
        assert high - low < 0.1 * np.diff(without.intervals[name])[0], name


@pytest.mark.slow
def test_field_sensors_tell_all_thirteen_from_the_defaults(tmp_path):
    made = laboratory()(tmp_path / "bag", "damped", "field", seed=0)
    identified = identify(made.bag, made.scene, THIRTEEN)
    deviations = np.sqrt(np.diag(identified.covariance))
    errors = np.array([identified.values[name] - made.truth[name] for name in THIRTEEN])
    assert (np.abs(errors) < 4.0 * deviations).all(), dict(zip(THIRTEEN, errors / deviations, strict=True))
    assert identified.verdict.startswith("the model fits")


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["device", "chaotic"])
def test_a_robot_that_hops_is_found_from_thirty_percent_off(tmp_path, robot):
    made = laboratory()(tmp_path / "bag", robot, seed=1, spread=0.3)
    free = tuple(name for name in THIRTEEN if made.scene[name] or name.endswith("gap"))
    identified = identify(made.bag, made.scene, free)
    assert_found(identified, made.truth)
    assert identified.passes <= 1000
    assert all(0.9 < square < 1.1 for square in identified.chi_square.values()), identified.chi_square


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_another_friction_law_is_named_and_without_it_the_model_rejected(tmp_path, seed):
    """With seed 1 the values that Coulomb friction has bent lead to no fit, and those of the scene do."""
    made = laboratory()(tmp_path / "bag", "stribeck", seed=seed, duration=3.0)
    free = tuple(name for name in THIRTEEN if made.scene[name] or name.endswith("gap"))
    identified = identify(made.bag, made.scene, free, effects=("slope", "stribeck"))
    assert identified.alternatives[0].effect == "stribeck"
    assert identified.alternatives[0].p_value < 1e-3
    assert identified.p_value < 1e-3  # by the residuals alone, as without effects
    assert "stribeck" in identified.verdict
    assert identified.alternatives[0].mean_square < 1.1
    assert identified.alternatives[0].values["ground.stribeck_speed"] == pytest.approx(0.05, rel=0.03)


FIVE = (*FREE, "guide.angle", "upper.spring.damping")
HOPS = {**FIELDS, "odom": ("body_position", "body_height", "body_velocity", "body_vertical_velocity")}
MOVING = ((0.0, {"motor_speed": 100.0}), (0.8, {"upper_gap": 0.001}), (1.4, {"motor_speed": 60.0}))


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "free", "correlation", "commands", "fields", "duration", "draws", "jitter",
                          "late"), [
    (DAMPED, FIVE, 0.0, (), FIELDS, 1.0, 120, 0.0, 0.0), (DAMPED, FIVE, 0.6, (), FIELDS, 1.0, 120, 0.0, 0.0),
    (DAMPED, FIVE, 0.0, (), FIELDS, 1.0, 120, 3e-4, 0.003),
    (vibro_ros.load_scene("device"), THIRTEEN, 0.0, MOVING, HOPS, 2.0, 40, 0.0, 0.0)],
    ids=["white", "correlated", "jitter", "device"])
def test_intervals_cover(scene, free, correlation, commands, fields, duration, draws, jitter, late):
    """Of 95 % intervals from 40 or 120 recordings 91 to 98 % have the truth.

    The share of a recording's five intervals that cover varies by 12 %, because the parameters are correlated: of 40
    recordings 95 % cover with a standard deviation of 1.9 %, and one right program in thirteen is beyond the bounds;
    the first 40 with white noise are at 98.5 %, the next two at 94.5 and 93 %. Of 120 it is 1.1 %, and one in 300. The
    seed is fixed, so that the test ends alike each time. Noise with correlated neighbours has about twice the effect
    of white noise on what changes slowly: intervals that took it for white would cover two thirds. The crank's noise
    is drawn as well, because an encoder's steps at constant speed are much the same in every recording. `jitter` [s]
    is that of all stamps, by `late` [s] the camera is late.
    """
    unknowns, times = Unknowns.of(scene, free, {}), np.arange(round(500 * duration) + 1) / 500.0
    run = vibro_ros.simulate(scene, times=times, commands=commands)
    sigmas = {(sensor, field): deviation(field) for sensor, names in fields.items() for field in names}
    sigmas["encoder", "crank_angle"] = TICK / math.sqrt(12.0)

    def covered(seed):
        random, chance = np.random.default_rng([38, seed]), np.random.default_rng([49, seed])
        stamps = {sensor: times + jitter * chance.standard_normal(len(times)) + late * (sensor == "odom")
                  for sensor in (*fields, "encoder")}
        recording = Recording(0.0, times[-1], tuple(Channel(
            sensor, field, stamps[sensor], getattr(run, field) + sigma * noise(random, len(times), correlation), sigma,
            "given") for (sensor, field), sigma in sigmas.items()), commands, ())
        fitting = Fitting(recording, unknowns, 1, lambda words: None)
        errors = [late / each.unit if (each.owner, each.kind) == ("odom", "offset") else first for each, first in zip(
            fitting.nuisances.each, fitting.nuisances.coordinates, strict=True)]
        begin = np.append(unknowns.coordinates(scene.parameters), errors)
        limits, _ = intervals(fitting.followed(begin), lambda words: None)
        return [low <= scene[name] <= high for name, (low, high) in limits.items()]

    all_covered = np.array([future.result() for _, future in in_processes(covered, range(draws), core_count())])
    assert 0.91 <= all_covered.mean() <= 0.98, dict(zip(free, all_covered.sum(axis=0).tolist(), strict=True))
    lowest = 0.95 * draws - 3.6 * math.sqrt(0.95 * 0.05 * draws)  # 3.6 standard deviations of each parameter's number
    assert all_covered.sum(axis=0).min() >= lowest


def test_a_motor_that_is_switched_on_at_the_first_sample_rests_there_and_a_running_one_has_its_speed():
    """A straight line through the first 20 ms would give the one 2 rad/s, and half a radian of error ever after."""
    times = np.arange(251) / 500.0
    for moving, command, speed in ((False, 100.0, 0.0), (True, 60.0, 60.0)):
        start = {"start.state": "given", "motor.speed": speed} if moving else {}
        scene = vibro_ros.load_scene("device").with_parameters(start)
        commands = ((0.0, {"motor_speed": command}),)
        run = vibro_ros.simulate(scene, times=times, commands=commands)
        angle = TICK * np.round(run.crank_angle / TICK)
        encoder = Channel("encoder", "crank_angle", times, angle, TICK / math.sqrt(12.0), "resolution", TICK)
        fitting = Fitting(Recording(0.0, times[-1], (encoder,), commands, ()), Unknowns.of(scene, FREE, {}), 1, print)
        start = fitting.nuisances.start(fitting.nuisances.coordinates).state
        assert start["motor_speed"] == pytest.approx(speed, abs=0.3)
        assert start["crank_angle"] == pytest.approx(0.0, abs=TICK)
        assert [nuisance.kind for nuisance in fitting.nuisances.each] == ["crank_angle"] + ["motor_speed"] * moving


def test_a_crank_that_turns_is_not_at_rest_because_its_encoder_has_lost_a_sample():
    """Of 100 Hz, in the first 20 ms two are left: then the scene's speed, 0, was taken, and the motor began late."""
    times = np.delete(np.arange(51) / 100.0, 1)
    encoder = Channel("encoder", "crank_angle", times, TICK * np.round(100.0 * times / TICK), TICK / math.sqrt(12.0),
                      "resolution", TICK)
    scene = vibro_ros.load_scene("device").with_parameters({"motor.speed": 0.0})
    fitting = Fitting(Recording(0.0, times[-1], (encoder,), (), ()), Unknowns.of(scene, FREE, {}), 1, print)
    start = fitting.nuisances.start(fitting.nuisances.coordinates)
    assert not fitting.nuisances.rests
    assert start.state["motor_speed"] == start.settings["motor.speed"] == pytest.approx(100.0, abs=0.1)


def bag(folder, *, duration=0.5, sensors=("odom", "joint_states", "encoder"), still=False):
    """Write a bag of the damped robot by our own solver; `still`: all masses and the body stay where they begin."""
    times = np.arange(round(500 * duration) + 1) / 500.0
    random, run = np.random.default_rng(1), vibro_ros.simulate(DAMPED, times=times)

    def values(field):
        moved = getattr(run, field)
        return (np.full(len(times), moved[0]) if still else moved) + deviation(field) * random.standard_normal(
            len(times))

    crank = values("crank_angle")
    rows = {"odom": lambda: odometry(times, values("body_position"), values("body_velocity"), (2.5e-9, 1e-6)),
            "tracking": lambda: tracking(times[::5], values("body_position")[::5], 2.5e-9),
            "joint_states": lambda: joint_states(times, {
                f"{side}_mass": [values(f"{side}_position"), values(f"{side}_velocity")]
                for side in ("upper", "inclined")}),
            "encoder": lambda: joint_states(times, {"crank": [TICK * np.round(crank / TICK)]}, "encoder"),
            "imu/data_raw": lambda: imu(times, values("body_velocity") + 1.0, values("body_velocity"), 1.0)}
    return written(folder, numbers("motor_speed", [(0.0, 100.0)]), *(rows[name]() for name in sensors))


@pytest.fixture(scope="module")
def moving(tmp_path_factory):
    return bag(tmp_path_factory.mktemp("moving") / "bag")


@pytest.mark.parametrize(("arguments", "words"), [
    ({"free": ("mass.bodi",)}, ["mass.bodi", "no number of the robot", "docs/guide/parameters.md"]),
    ({"free": ()}, ["free", "give a list of names"]),
    ({"free": "mass.body"}, ["mass.body", "give a list of names"]),
    ({"free": ("mass.body", "mass.body")}, ["each once"]),
    ({"free": ("effects.friction",)}, ["effects.friction", "no number of the robot"]),
    ({"ranges": {"mass.body": (2.0, 0.5)}}, ["2 to 0.5 is no range", "LOW:HIGH"]),
    ({"ranges": {"mass.body": 1.0}}, ["range of mass.body", "give two numbers"]),
    ({"ranges": {"mass.body": ("low", "high")}}, ["range of mass.body", "give two numbers"]),
    ({"ranges": {"mass.body": (math.nan, 2.0)}}, ["range of mass.body", "no range"]),
    ({"noise": {"odom": "loud"}}, ["odom", "loud", "a number above 0"]),
    ({"effects": ("wind",)}, ["wind", "stribeck, slope, drag, viscous, reaction, lag"]),
    ({"free": ("ground.slope",), "effects": ("slope",)}, ["slope", "leave it out"]),
    ({"noise": {"odom": 0.0}}, ["odom", "number above 0", "inf to leave it out"]),
    ({"noise": {"radar": 1.0}}, ["radar", "no such channel", "encoder"]),
    ({"scene": DAMPED.with_parameters({"effects.upper_mass": False})}, ["upper_mass", "does not have", "choose"]),
], ids=range(15))
def test_what_cannot_be_identified_is_refused_in_one_line(moving, arguments, words):
    given = {"scene": DAMPED, "free": FREE, **arguments}
    with pytest.raises((ValueError, BagError)) as refusal:
        identify(moving, workers=1, **given)
    said = str(refusal.value)
    assert "\n" not in said
    for word in words:
        assert word in said


def test_a_bag_without_messages_of_the_robot_or_of_an_imu_alone_is_refused(tmp_path):
    empty = written(tmp_path / "empty", numbers("motor_speed", [(0.0, 1.0), (1.0, 2.0)]))
    with pytest.raises(BagError, match="measures nothing of a robot; record one of odom, tracking"):
        identify(empty, DAMPED, FREE, workers=1)
    alone = bag(tmp_path / "imu", sensors=("imu/data_raw",))
    with pytest.raises(BagError, match="IMU alone, which tell no place and no angle of the crank; record tracking"):
        identify(alone, DAMPED.with_parameters({"sensors.preset": "mpu6050"}), FREE, workers=1)
    with pytest.raises(BagError, match="no such folder"):
        identify(tmp_path / "none", DAMPED, FREE, workers=1)


def test_a_recording_of_a_tenth_of_a_second_tells_what_it_can(tmp_path):
    identified = identify(bag(tmp_path / "bag", duration=0.1), DAMPED, FREE, workers=1)
    assert identified.values["ground.friction"] == pytest.approx(DAMPED["ground.friction"], rel=0.02)
    assert all(low < high for low, high in identified.intervals.values())


@pytest.mark.process
@pytest.mark.parametrize(("sensors", "still", "untold"), [
    (("encoder",), False, FREE), (("odom", "joint_states"), True, ("ground.friction", "mass.body")),
    (("tracking",), False, ())], ids=["an encoder alone", "nothing moves", "tracking alone"])
def test_what_a_recording_does_not_tell_is_said(tmp_path, sensors, still, untold):
    identified = identify(bag(tmp_path / "bag", duration=0.3, sensors=sensors, still=still), DAMPED, FREE, workers=1)
    for name in untold:
        assert f"the recording does not tell {name}" in identified.rank
        low, high = identified.intervals[name]
        assert still or high > 3.0 * low
    assert len(set(identified.rank)) == len(identified.rank)
    assert all(low <= high for low, high in identified.intervals.values())
    assert np.isfinite(identified.covariance).all()
    assert not still or not identified.verdict.startswith("the model fits")


def test_a_parameter_at_the_end_of_its_range_stays_there_and_the_others_still_fit(moving):
    """The recorded robot has no viscous friction, which is where the parameter's range begins."""
    scene = DAMPED.with_parameters({"ground.friction": 0.22})
    identified = identify(moving, scene, ("ground.friction", "ground.viscous_friction"), workers=1)
    assert 0.0 <= identified.values["ground.viscous_friction"] < 0.1
    assert identified.values["ground.friction"] == pytest.approx(0.2, rel=0.02)
    assert all(0.85 < square < 1.15 for square in identified.chi_square.values()), identified.chi_square
    identified = identify(moving, DAMPED.with_parameters({"upper.gap": 5e-4}), ("upper.gap",),
                          ranges={"upper.gap": (1e-4, 1e-3)}, workers=1)
    assert identified.values["upper.gap"] == pytest.approx(1e-4, rel=1e-3)
    assert "does not fit" in identified.verdict or "left out" in identified.verdict
