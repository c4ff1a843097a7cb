"""The motion document is read as written, to half a quantisation step; slow motion of a live robot passes through its
samples, and says that it is interpolated between them.
"""

import itertools
import json

import numpy as np
import pytest
from motion_reader import NEAR, MotionDocument

import vibro_ros
from vibro_ros.view.motion import Impact, MotionWriter
from vibro_ros.view.protocol import COLUMNS, MOST_SECONDS
from vibro_ros.view.slow_motion import History, motion_between

SCENE = vibro_ros.load_scene("device")
RATE = 200.0


def published(ticks: int, begin: int = 0) -> np.ndarray:
    """Return rows as the robot publishes them, from its start on, beginning with the sample `begin`."""
    device, rows = vibro_ros.Simulator(SCENE), []
    device.command(motor_speed=100.0)
    for tick in range(ticks):
        device.advance_to(tick / RATE)
        rows.append(device.values.copy())
    rows = np.array(rows)
    rows[:, COLUMNS.index("time")] += begin / RATE
    return rows


def as_browser(document) -> MotionDocument:
    header, payload = document
    return MotionDocument(json.loads(json.dumps(header, allow_nan=False)), payload)


def test_slow_motion_passes_through_the_samples_and_not_across_a_reset():
    history = History()
    history.add_impacts(Impact(time, time, "upper", 3.0) for time in (0.02, 0.9, 1.4))
    for rows in (published(150), published(150, begin=150)):
        history.add(rows)
    motion = as_browser(history.motion(SCENE, 1.0))
    assert not motion.header["exact"] and "record it" in motion.header["why"]
    assert motion.header["resets"] == [pytest.approx(150 / RATE)]
    assert [impact["time"] for impact in motion.header["impacts"]] == [0.9, 1.4]
    samples = history.samples(1.0)
    for name in ("body_position", "upper_position", "crank_angle"):
        assert np.abs(motion.at(samples["time"])[name] - samples[name]).max() <= NEAR
    assert np.isnan(motion.at(np.array([149.5 / RATE]))["body_position"]).all()
    history.clear()
    history.add(published(1))
    with pytest.raises(ValueError, match="no samples of the last seconds; let the robot run"):
        history.motion(SCENE, 1.0)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name, value", [*itertools.product(COLUMNS[1:], (-1.7e308, 1e300))])
def test_any_number_gives_a_motion_without_a_warning(name, value):
    samples = dict(zip(COLUMNS, published(40).T.copy(), strict=True))
    samples[name][[5, 9]] = value, -value
    header = as_browser(motion_between(SCENE, samples)).header
    assert header["end"] > header["begin"]


def test_the_history_is_of_the_last_seconds():
    history, rate = History(), 1000
    assert history.last() is None and history.samples(1.0)["time"].size == 0
    for batch in range(300):
        rows = np.zeros((rate // 10, len(COLUMNS)))
        rows[:, 0] = batch / 10.0 + np.arange(1, rate // 10 + 1) / rate
        history.add(rows)
    assert history.last()[0] == pytest.approx(30.0)
    times = history.samples(1.0)["time"]
    assert times[0] == pytest.approx(29.0) and len(times) == rate + 1
    assert MOST_SECONDS - 0.1 < np.ptp(history.samples(100.0)["time"]) < MOST_SECONDS + 0.2


NAMES, STEPS = ("one", "two", "three"), (1e-3, 1.0, 1e-9)


def written(rng, pieces=50, steps=STEPS):
    borders = np.cumsum(rng.uniform(0.1, 1.0, pieces + 1))
    borders = np.column_stack([borders[:-1], borders[1:]])
    degrees = rng.integers(0, 12, (pieces, len(NAMES)))
    size = 10.0 ** rng.uniform(0, 9, (pieces, len(NAMES), 12)) * np.array(steps)[:, None]
    coefficients = np.where(np.arange(12) <= degrees[:, :, None], rng.choice([-1, 1], size.shape) * size, 0.0)
    coefficients[rng.uniform(size=degrees.shape) < 0.1] = np.nan
    writer = MotionWriter(NAMES, steps)
    for first in range(0, pieces, 7):
        writer.add(borders[first:first + 7], coefficients[first:first + 7])
    return borders, coefficients, writer.document({"exact": True, "why": ""})


def test_the_docstring_is_enough_to_read_a_document():
    """A reader written from the docstring alone reads the document to half a quantisation step of each quantity."""
    borders, coefficients, (header, payload) = written(np.random.default_rng(4))
    motion = MotionDocument(json.loads(json.dumps(header)), payload)
    assert (motion.known == ~np.isnan(coefficients[:, :, 0])).all()
    wrong = np.abs(motion.coefficients - coefficients) / np.array(STEPS)[:, None]
    assert wrong[motion.known].max() <= 0.500001
    assert (motion.borders == borders).all()


def test_a_motion_is_unknown_outside_its_samples_in_gaps_and_for_infinite_numbers():
    writer = MotionWriter(["x"], [1.0])
    writer.add(np.array([[0.0, 1.0], [2.0, 3.0], [3.0, 4.0]]),
               np.array([[[5.0, 1.0]], [[7.0, 0.0]], [[np.inf, 0.0]]]))
    header, payload = writer.document({})
    assert (header["begin"], header["end"], header["pieces"]) == (0.0, 4.0, 3)
    x = MotionDocument(header, payload).at(np.array([-0.1, 0.0, 0.5, 1.0, 1.5, 2.0, 2.9, 3.5, 4.1]))["x"]
    np.testing.assert_array_equal(x, [np.nan, 4.0, 5.0, 6.0, np.nan, 7.0, 7.0, np.nan, np.nan])
