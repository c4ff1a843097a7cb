"""The motion document: what is written is read again, integer by integer, whatever its size."""

import json

import numpy as np
import pytest
from numpy.polynomial import chebyshev

from vibro_ros.view import varints
from vibro_ros.view.motion import UNKNOWN, Motion, MotionWriter


@pytest.mark.parametrize("numbers", [
    [], [0], [-1, 1, -2, 2], [63, 64, -64, -65], [2**52 - 1, 1 - 2**52, 0],
    list(np.random.default_rng(1).integers(-2**40, 2**40, 1000) >> np.random.default_rng(2).integers(0, 40, 1000))])
def test_integers_are_read_as_written(numbers):
    data = varints.encoded(np.array(numbers, dtype=np.int64))
    assert varints.decoded(data + b"\x00", len(numbers)).tolist() == numbers


def test_an_integer_takes_a_byte_for_seven_bits():
    assert varints.encoded(np.array([0, -1, 1, -64, 64, -8192])) == bytes([0, 1, 2, 127, 128, 1, 255, 127])


@pytest.mark.parametrize("data, count", [(b"", 1), (b"\x80", 1), (b"\x01" * 3, 4), (b"\xff" * 12 + b"\x01", 1)])
def test_bytes_that_hold_other_integers_are_refused(data, count):
    with pytest.raises(ValueError):
        varints.decoded(data, count)


def by_hand(header, payload):
    """The coefficients in units, read as the module's docstring says, one number after the other."""
    at, offset = (header["arrays"][name][1] for name in ("degrees", "coefficients"))
    names = len(header["quantities"])
    before, found = [0] * names, []

    def integer():
        nonlocal offset
        result, factor = 0, 1
        while True:
            byte = payload[offset]
            offset += 1
            result += byte % 128 * factor
            factor *= 128
            if byte < 128:
                return result // 2 if result % 2 == 0 else -(result + 1) // 2

    for piece in range(header["pieces"]):
        found.append([])
        for q in range(names):
            degree = payload[at + piece * names + q]
            if degree == UNKNOWN:
                found[-1].append(None)
                continue
            step, *others = (integer() for _ in range(degree + 1))
            first = step + before[q] - sum((-1) ** k * c for k, c in enumerate(others, start=1))
            before[q] = first + sum(others)
            found[-1].append([first, *others])
    return found


def written(rng, pieces=50, names=("one", "two", "three"), units=(1e-3, 1.0, 1e-9)):
    borders = np.cumsum(rng.uniform(0.1, 1.0, pieces + 1))
    borders = np.column_stack([borders[:-1], borders[1:]])
    degrees = rng.integers(0, 12, (pieces, len(names)))
    size = 10.0 ** rng.uniform(0, 9, (pieces, len(names), 12)) * np.array(units)[:, None]
    coefficients = np.where(np.arange(12) <= degrees[:, :, None], rng.choice([-1, 1], size.shape) * size, 0.0)
    coefficients[rng.uniform(size=degrees.shape) < 0.1] = np.nan
    writer = MotionWriter(names, units)
    for first in range(0, pieces, 7):
        writer.add(borders[first:first + 7], coefficients[first:first + 7])
    return borders, coefficients, writer.document({"exact": True, "why": ""})


def test_a_document_says_what_was_written_to_half_a_unit():
    _, coefficients, (header, payload) = written(np.random.default_rng(3))
    motion = Motion(json.loads(json.dumps(header)), payload)
    units = np.array(header["units"])[:, None]
    assert (motion.known == ~np.isnan(coefficients[:, :, 0])).all()
    wrong = np.abs(motion.coefficients - coefficients) / units
    assert wrong[motion.known].max() <= 0.500001


def test_the_docstring_is_enough_to_read_a_document():
    _, _, (header, payload) = written(np.random.default_rng(4))
    motion, units = Motion(header, payload), header["units"]
    for piece, polynomials in enumerate(by_hand(header, payload)):
        for q, integers in enumerate(polynomials):
            assert (integers is not None) == motion.known[piece, q]
            if integers:
                read = motion.coefficients[piece, q, :len(integers)]
                np.testing.assert_allclose(read, np.array(integers) * units[q], rtol=1e-15)


def test_values_between_the_borders():
    borders, coefficients, document = written(np.random.default_rng(5), units=(1e-12, 1e-12, 1e-12))
    motion = Motion(*document)
    times = np.sort(np.random.default_rng(6).uniform(borders[0, 0], borders[-1, 1], 1000))
    found = motion.at(times)
    for k, time in enumerate(times):
        piece = int(np.flatnonzero(borders[:, 0] <= time)[-1])
        begin, end = borders[piece]
        for q, name in enumerate(motion.quantities):
            expected = chebyshev.chebval((time - begin) / (end - begin) * 2 - 1, coefficients[piece, q])
            np.testing.assert_allclose(found[name][k], expected, atol=12e-12, rtol=1e-12)


def test_nothing_is_known_outside_and_in_gaps():
    writer = MotionWriter(["x"], [1.0])
    writer.add(np.array([[0.0, 1.0], [2.0, 3.0]]), np.array([[[5.0, 1.0]], [[7.0, 0.0]]]))
    header, payload = writer.document({})
    assert (header["begin"], header["end"], header["pieces"]) == (0.0, 3.0, 2)
    x = Motion(header, payload).at(np.array([-0.1, 0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 3.1]))["x"]
    np.testing.assert_array_equal(x, [np.nan, 4.0, 5.0, 6.0, np.nan, 7.0, 7.0, np.nan])


def test_a_document_without_pieces_and_arrays_that_begin_at_multiples_of_8():
    header, payload = MotionWriter(["x", "y"], [1.0, 1.0]).document({})
    assert Motion(header, payload).at(np.array([0.0])) == {"x": pytest.approx(np.nan, nan_ok=True),
                                                           "y": pytest.approx(np.nan, nan_ok=True)}
    header, payload = written(np.random.default_rng(7), pieces=3)[2]
    assert all(offset % 8 == 0 for _, offset, _ in header["arrays"].values()) and len(payload) % 8 == 0


def test_coefficients_that_integers_cannot_hold_are_cut_off():
    """A motion that no page can draw must not spoil what follows it."""
    writer = MotionWriter(["x"], [1e-10])
    writer.add(np.array([[0.0, 1.0], [1.0, 2.0]]), np.array([[[1e300, -1e300]], [[3.0, 1.0]]]))
    assert Motion(*writer.document({})).at(np.array([1.5]))["x"][0] == pytest.approx(3.0, abs=1e-9)
