"""The motion document: what is written can be read again, to half a quantisation step of each quantity."""

import json

import numpy as np
from motion_reader import MotionDocument

from vibro_ros.view.motion import MotionWriter

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


def test_nothing_is_known_outside_and_in_gaps_and_of_numbers_that_are_not_finite():
    writer = MotionWriter(["x"], [1.0])
    writer.add(np.array([[0.0, 1.0], [2.0, 3.0], [3.0, 4.0]]),
               np.array([[[5.0, 1.0]], [[7.0, 0.0]], [[np.inf, 0.0]]]))
    header, payload = writer.document({})
    assert (header["begin"], header["end"], header["pieces"]) == (0.0, 4.0, 3)
    x = MotionDocument(header, payload).at(np.array([-0.1, 0.0, 0.5, 1.0, 1.5, 2.0, 2.9, 3.5, 4.1]))["x"]
    np.testing.assert_array_equal(x, [np.nan, 4.0, 5.0, 6.0, np.nan, 7.0, 7.0, np.nan, np.nan])
