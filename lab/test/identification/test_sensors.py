"""Clocks that disagree, stamps that jitter, wild samples, noise that is stated wrongly, cameras that are not level.

Each fault is planted in numbers whose truth is known, and comes out with its size.
"""

import math
import warnings

import numpy as np
import pytest

import vibro_ros
from vibro_lab.identification.fit import Fitting
from vibro_lab.identification.inference import whiteness
from vibro_lab.identification.noise import sizes_of, wild
from vibro_lab.identification.nuisances import Start
from vibro_lab.identification.recording import Channel, Recording
from vibro_lab.identification.unknowns import Unknowns
from vibro_lab.identification.windows import Colours, Windows, state_names
from vibro_ros import ToleranceWarning

DAMPED = vibro_ros.load_scene("damped").with_parameters({"motor.speed": 100.0})
HOPPING = vibro_ros.load_scene("device").with_parameters({"motor.speed": 100.0})
TIMES = 0.1 + np.arange(150) / 500.0


def camera(scene, change, late=0.0):
    """Return windows of what a camera measures exactly, its stamps late [s], with the states of the true motion;
    `change` makes the measured numbers from the samples."""
    run = vibro_ros.simulate(scene, times=TIMES - late)
    channels = tuple(Channel("odom", field, TIMES, values, 1.0, "given") for field, values in change(run).items())
    edges = np.array([0.1, 0.25, TIMES[-1] + 1e-6])
    windows = Windows(Recording(0.0, 0.4, channels, (), ()), state_names(scene),
                      np.column_stack([edges[:-1], edges[1:]]))
    return windows, windows.course(scene, Start({}, {}))


def test_stamps_that_are_late_belong_to_the_motion_before_them():
    """By 3 ms. Two samples at a window's start are of before it, and go on from there at its speed."""
    windows, states = camera(DAMPED, lambda run: {"upper_position": run.upper_position}, late=0.003)
    as_stamped = windows.simulate(DAMPED, Start({}, {}), states).residuals
    shifted = windows.simulate(DAMPED, Start({}, {}), states, {("odom", "offset"): 0.003}).residuals
    drifting = windows.simulate(DAMPED, Start({}, {}), states, {
        ("odom", "offset"): 0.003 + 1e-4 * 0.1, ("odom", "drift"): 1e-4}).residuals
    assert np.abs(as_stamped).max() > 3e-3  # m
    inside = np.ones(len(shifted), bool)
    inside[[0, 1, 75, 76]] = False
    assert np.abs(shifted[inside]).max() < 1e-12
    apart = drifting[inside] - shifted[inside]
    assert 0.0 < np.abs(apart).max() < 3.0 * 3e-5  # m: at most 30 µs at 3 m/s


def test_a_camera_that_is_tilted_and_scaled_sees_both_axes_in_each():
    tilt, scale = 0.02, 1.003

    def seen(run):
        return {"body_position": scale * (math.cos(tilt) * run.body_position + math.sin(tilt) * run.body_height),
                "body_height": scale * (math.cos(tilt) * run.body_height - math.sin(tilt) * run.body_position)}

    windows, states = camera(HOPPING, seen)
    errors = {("odom", "scale"): scale - 1.0, ("odom", "tilt"): tilt}
    assert np.abs(windows.simulate(HOPPING, Start({}, {}), states, errors).residuals).max() < 1e-12
    assert np.abs(windows.simulate(HOPPING, Start({}, {}), states).residuals).max() > 1e-5  # m


def test_numbers_of_one_message_have_one_error_of_its_stamp():
    """Whitened together, the covariance of what is left is 1: that of white noise and of g times a normal number."""
    windows, states = camera(DAMPED, lambda run: {"upper_position": run.upper_position,
                                                  "inclined_position": run.inclined_position})
    plain = windows.simulate(DAMPED, Start({}, {}), states).residuals
    jitters = np.where(windows.channel == 0, 2.0, -1.0)
    nothing = np.zeros(len(plain))
    windows.recolour(Colours(np.ones(2), np.zeros(2), jitters, nothing, nothing, nothing > 0.0))
    random, whitened = np.random.default_rng(49), []
    first, second = np.flatnonzero(windows.channel == 0), np.flatnonzero(windows.channel == 1)
    values = windows.values.copy()
    for _ in range(20):
        late = random.standard_normal(len(first))
        windows.values = values + random.standard_normal(len(values))
        windows.values[first] += 2.0 * late
        windows.values[second] -= late
        white = windows.simulate(DAMPED, Start({}, {}), states).residuals
        whitened += [white[first], white[second]]
    upper, inclined = np.concatenate(whitened[::2]), np.concatenate(whitened[1::2])
    assert np.cov(upper, inclined) == pytest.approx(np.eye(2), abs=0.1)  # 3000 of each: 4 deviations are 0.1


@pytest.mark.parametrize(("size", "jitter"), [(1.0, 3e-4), (3.0, 0.0), (0.33, 0.0), (3.0, 3e-4)])
def test_size_of_noise_and_jitter_are_told_apart_by_the_rate(size, jitter):
    """Of 2000 samples the size comes out to 5 %, beside a model that is wrong by a slow wave of ten deviations."""
    random, count = np.random.default_rng(1), 2000
    rates = 1e4 * np.sin(0.2 * np.arange(count))  # 1/s: 0.5 m/s of a sensor of 0.05 mm
    residuals = (size * random.standard_normal(count) + jitter * random.standard_normal(count) * rates
                 + 10.0 * np.sin(0.01 * np.arange(count)))
    sizes, estimated_jitter = sizes_of(np.zeros(count, int), np.arange(count) > 0, residuals, rates, np.array([False]))
    assert estimated_jitter == pytest.approx(jitter, rel=0.1)
    assert sizes[0] == pytest.approx(size, rel=0.1 if jitter else 0.05)


def test_a_size_that_jitter_hides_is_not_found_to_be_nothing():
    """Jitter makes 30 times the noise. In three of twenty such draws least squares end at 0, from which no later step
    would lead away, and all lateness would be one channel's: then the size is what its deviation does not exclude."""
    rates = 1e5 * np.sin(0.02 * np.arange(300))
    for seed in range(20):
        random = np.random.default_rng(seed)
        residuals = random.standard_normal(300) + 3e-4 * random.standard_normal(300) * rates
        sizes, estimated_jitter = sizes_of(np.zeros(300, int), np.arange(300) > 0, residuals, rates, np.array([False]))
        assert estimated_jitter == pytest.approx(3e-4, rel=0.2) and 0.4 < sizes[0] < 2.5, seed


def test_an_outlier_is_one_among_good_samples_and_no_wrong_model():
    random = np.random.default_rng(2)
    residuals = random.standard_normal(1000)
    planted = np.arange(20, 1000, 50)
    residuals[planted] += 30.0
    is_wild = wild(np.zeros(1000, int), residuals, np.ones(1000), 6.0, 0.06)
    np.testing.assert_array_equal(np.flatnonzero(is_wild), planted)
    bent = random.standard_normal(1000) + np.where(np.arange(1000) % 100 < 20, 30.0, 0.0)  # for 20 samples at a time
    assert not wild(np.zeros(1000, int), bent, np.ones(1000), 6.0, 0.06).any()
    many = random.standard_normal(1000) + np.where(np.arange(1000) % 10 == 0, 30.0, 0.0)
    assert not wild(np.zeros(1000, int), many, np.ones(1000), 6.0, 0.06).any()


def test_white_residuals_are_called_white_and_a_slow_wave_in_them_is_not():
    """Of 200 draws of white noise some two have a chance below 1 %, and at most six: 3 deviations."""
    random = np.random.default_rng(3)
    chances = [whiteness(3.0 * random.standard_normal(500)) for _ in range(200)]
    assert sum(chance < 0.01 for chance in chances) <= 6
    assert whiteness(random.standard_normal(500) + 0.7 * np.sin(0.1 * np.arange(500))) < 1e-6


@pytest.mark.parametrize("motor", ["ideal", "ramp"])
def test_a_speed_that_was_commanded_before_the_recording_comes_from_the_encoder(motor):
    """The scene's motor rests; the recorded one turns at 70 rad/s, and gets its first recorded command at 0.3 s."""
    scene = vibro_ros.load_scene("device").with_parameters({"effects.motor": motor, "motor.speed": 0.0})
    times = np.arange(251) / 500.0
    run = vibro_ros.simulate(scene.with_parameters({"motor.speed": 70.0}), times=times, commands=[
        (0.3, {"motor_speed": 90.0})])
    tick = math.tau / 4096
    encoder = Channel("encoder", "crank_angle", times, 5.0 + tick * np.round(run.crank_angle / tick),
                      tick / math.sqrt(12.0), "resolution", tick)
    recording = Recording(0.0, 0.5, (encoder,), ((0.3, {"motor_speed": 90.0}),), ())
    fitting = Fitting(recording, Unknowns.of(scene, ("mass.body",), {}), 1, lambda words: None)
    start = fitting.nuisances.start(fitting.nuisances.coordinates)
    assert start.settings["motor.speed"] == pytest.approx(70.0, abs=0.1)
    assert start.state["crank_angle"] == pytest.approx(5.0, abs=2.0 * tick)
    assert motor == "ideal" or start.state["motor_speed"] == start.settings["motor.speed"]
    assert ("encoder", "offset") in fitting.nuisances.errors(fitting.nuisances.coordinates)  # commands are the clock


def test_a_pass_of_the_fit_gives_no_warning_of_its_tolerance():
    scene = DAMPED.with_parameters({"upper.plate.stiffness": 1e11})
    with pytest.warns(ToleranceWarning):
        vibro_ros.Simulator(scene)
    channel = Channel("odom", "body_position", TIMES, np.zeros(150), 1.0, "given")
    with warnings.catch_warnings():
        warnings.simplefilter("error", ToleranceWarning)
        Fitting(Recording(0.0, 0.4, (channel,), (), ()), Unknowns.of(scene, ("mass.body",), {}), 1, print)
        windows = Windows(Recording(0.0, 0.4, (channel,), (), ()), state_names(scene), np.array([[0.1, 0.4]]))
        windows.course(scene, Start({}, {}))
