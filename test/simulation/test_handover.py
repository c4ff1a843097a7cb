"""Results on their way between processes: the same bits, arrays of their own, and none overwritten by a later one."""

import numpy as np
import pytest

from vibro_ros.simulation import handover
from vibro_ros.simulation.handover import Handover

ARRAYS = {
    "numbers": np.array([0.1, -0.0, np.nan, np.inf, 5e-324]), "matrix": np.arange(12).reshape(3, 4),
    "columns": np.asfortranarray(np.arange(12.0).reshape(3, 4)), "every other": np.arange(10.0)[::2],
    "one": np.array(3.5), "none": np.empty((0, 3)), "truth": np.array([True, False]), "texts": np.array(["a", "bcd"]),
    "events": np.array([(0.5, "landing")], dtype=[("time", float), ("kind", "U16")]),
    "objects": np.array([{"a": 1}, None], dtype=object)}


def handed(result):
    way = Handover(2)
    try:
        return way.unpack(way.pack(result))
    finally:
        way.close()


@pytest.mark.parametrize("array", ARRAYS.values(), ids=ARRAYS)
def test_an_array_arrives_with_its_bits_type_and_order_and_is_its_own(array):
    (found, again), size = handed((array, [array]))
    assert (found.dtype, found.shape, found.flags.f_contiguous) == (
        array.dtype, array.shape, array.flags.f_contiguous or not array.flags.c_contiguous and array.ndim == 1)
    assert found.tolist() == array.tolist() if array.dtype.hasobject else found.tobytes() == array.tobytes()
    assert found is again[0] and found.flags.writeable
    assert array.size == 0 or array.dtype.hasobject or not array.flags.c_contiguous or found.base is None
    assert size >= array.nbytes


def test_arrays_that_do_not_fit_arrive_as_well(monkeypatch):
    monkeypatch.setattr(handover, "ROOM", 4096)
    arrays = [np.full(count, float(count)) for count in (100, 1000, 300, 100, 5)]
    found, _ = handed(arrays)
    assert [array.tobytes() for array in found] == [array.tobytes() for array in arrays]


def test_two_results_may_be_under_way(monkeypatch):
    """The second fills its room to the last byte."""
    monkeypatch.setattr(handover, "ROOM", 4096)
    way, number, total = Handover(2), 0, 0.0
    messages = [way.pack(np.full(512, 1.0)), way.pack(np.full(512, 2.0))]
    for number in range(3, 9):
        total += way.unpack(messages.pop(0))[0].mean()
        messages.append(way.pack(np.full(512, float(number))))
    total += sum(way.unpack(message)[0].mean() for message in messages)
    way.close()
    assert total == sum(range(1, number + 1))


def test_what_cannot_be_packed_leaves_the_way_open():
    way = Handover(2)
    with pytest.raises(TypeError, match="generator"):
        way.pack((np.ones(3), (number for number in range(3))))
    assert [way.unpack(way.pack(np.full(2, value)))[0].tolist() for value in (1.0, 2.0)] == [[1.0, 1.0], [2.0, 2.0]]
    way.close()
