"""1000 s of each error against its closed form: spectrum, Allan deviation, variance, share of clipped samples."""

import math

import numpy as np
import pytest
from scipy.signal import welch

from vibro_ros.model.parameters import BY_NAME
from vibro_ros.model.scene import Scene
from vibro_ros.sensors.noise import PRESETS, InertialErrors, of_imu

RATE, COUNT = 200.0, 200_000


def read(changes: dict, true=lambda k: 0.0, part: str = "accelerometer") -> np.ndarray:
    scene = Scene("sensed", {"sensors.imu.rate": RATE,
                             **{f"sensors.imu.{part}.{name}": value for name, value in changes.items()}})
    chain = InertialErrors(scene, part)
    return np.array([chain.read([true(k)] * 3, k) for k in range(COUNT)])


def allan_deviation(values: np.ndarray, width: int) -> float:
    means = values[:len(values) // width * width].reshape(-1, width, values.shape[1]).mean(axis=1)
    return math.sqrt(0.5 * np.mean(np.diff(means, axis=0)**2))


def test_noise_has_the_spectrum_of_its_density():
    """A62."""
    density, values = 0.02, read({"noise_density": 0.02})
    assert values.std() == pytest.approx(density * math.sqrt(0.5 * RATE), rel=0.005)  # 4 standard errors
    _, power = welch(values[:, 0], RATE, nperseg=2000)
    assert np.mean(power[1:-1]) == pytest.approx(density**2, rel=0.015)  # which leaves out two of 1001 bins
    thirds = [np.mean(part) for part in np.array_split(power[1:-1], 3)]
    assert np.ptp(thirds) < 0.05 * density**2  # white: 6 standard errors
    for seconds in (0.1, 1.0, 10.0):  # by so many differences of means
        deviation, number = allan_deviation(values, round(seconds * RATE)), 3 * COUNT / (seconds * RATE)
        assert deviation == pytest.approx(density / math.sqrt(2.0 * seconds), rel=4.0 / math.sqrt(number))


def test_the_bias_walks():
    """A62."""
    drift, values = 0.01, read({"bias_random_walk": 0.01}, part="gyroscope")
    steps = np.diff(values, axis=0)
    assert steps.std() == pytest.approx(drift / math.sqrt(RATE), rel=0.006)
    for seconds in (1.0, 10.0):
        number = 3 * COUNT / (seconds * RATE)
        assert allan_deviation(values, round(seconds * RATE)) == pytest.approx(
            drift * math.sqrt(seconds / 3.0), rel=4.0 / math.sqrt(number))


def test_the_variance_that_is_published_is_that_of_the_errors():
    names = {"noise_density": 0.002, "bias_random_walk": 0.02, "turn_on_bias": 0.3, "resolution": 0.05}
    errors, variance = [], 0.0
    for seed in range(400):
        chain = InertialErrors(Scene("sensed", {"sensors.seed": float(seed), "sensors.imu.rate": RATE, **{
            f"sensors.imu.accelerometer.{name}": value for name, value in names.items()}}), "accelerometer")
        errors += chain.read((0.0, 0.0, 0.0), 7000)
        variance = chain.variance(7000)
    steps = np.array(errors) / 0.05
    assert np.abs(steps - np.rint(steps)).max() < 1e-9
    assert variance == pytest.approx(0.002**2 * RATE / 2 + 0.02**2 * 35.0 + 0.3**2 + 0.05**2 / 12.0)
    assert np.mean(np.square(errors)) == pytest.approx(variance, rel=4.0 * math.sqrt(2.0 / 1200))


def test_clipping_cuts_the_share_that_a_sine_has_beyond_the_range():
    """A63."""
    values = read({"range": 3.0}, lambda k: 5.0 * math.sin(0.1234567 * k))
    assert (abs(values) == 3.0).mean() == pytest.approx(2.0 / math.pi * math.acos(3.0 / 5.0), abs=1e-4)


def test_a_preset_gives_what_the_scene_does_not():
    scene = Scene("sensed", {"sensors.preset": "bmi270", "sensors.imu.accelerometer.noise_density": 0.0})
    assert of_imu(scene, "accelerometer.range") == PRESETS["bmi270"]["accelerometer.range"] == 16.0 * 9.80665
    assert of_imu(scene, "accelerometer.noise_density") == 0.0
    assert of_imu(Scene(), "gyroscope.range") == 0.0
    known = {name.removeprefix("sensors.imu.") for name in scene.parameters}
    assert all(set(preset) <= known for preset in PRESETS.values())
    assert set(PRESETS) == set(BY_NAME["sensors.preset"].choices)
