"""A kept tuple is for kernels what the tuple is, and follows what its arrays hold."""

import copy
from typing import NamedTuple

import numpy as np
import pytest

from vibro_ros.solver import compilation
from vibro_ros.solver.kept import Kept

PAIR = np.dtype([("one", np.float64), ("other", np.int64)], align=True)


class Inner(NamedTuple):
    """A tuple in a tuple."""

    table: np.ndarray
    flags: np.ndarray


class Outer(NamedTuple):
    """Arrays of every kind that systems and states have."""

    total: np.ndarray
    inner: Inner
    numbers: np.ndarray
    now: np.ndarray
    empty: np.ndarray


@pytest.fixture
def read(monkeypatch, tmp_path):
    """A kernel that reads something of every array, and adds the result to the total."""
    monkeypatch.setattr(compilation, "_FOLDER", tmp_path)

    @compilation.entry_kernel
    def read(outer, weight):
        result = 0.0
        for row in range(outer.inner.table.shape[0]):
            for column in range(outer.inner.table.shape[1]):
                if outer.inner.flags[row]:
                    result += outer.inner.table[row, column] * (1 + column)
        result += outer.now[0].one * outer.now[0].other + outer.numbers[-1] + len(outer.empty)
        outer.total[0] += weight * result
        return result
    return read


def example(rows: int) -> Outer:
    rng = np.random.default_rng(rows)
    return Outer(np.zeros(1), Inner(rng.standard_normal((rows, 3)), rng.random(rows) < 0.5), np.arange(rows),
                 np.array([(0.5, 3)], PAIR), np.empty((0, rows)))


def test_a_kernel_reads_and_writes_a_kept_tuple_as_the_tuple(read):
    for rows in (1, 4):  # one type, other shapes
        plain, other = example(rows), example(rows)
        kept = Kept(other)
        assert read(kept.layout, 2.0) == read(plain, 2.0) != 0.0
        assert other.total[0] == plain.total[0]
    assert len(read.signatures) == 2


def test_what_the_arrays_hold_may_change(read):
    outer = example(4)
    kept = Kept(outer)
    before = read(kept.layout, 1.0)
    outer.inner.table[...] *= 2.0
    outer.now["other"] = 7
    assert read(kept.layout, 1.0) == read(outer, 1.0) != before


def test_a_copy_is_of_its_own_arrays(read):
    kept = Kept(example(4))
    copied = copy.deepcopy(kept)
    read(copied.layout, 1.0)
    assert copied.values.total[0] != 0.0 == kept.values.total[0]
    assert not np.shares_memory(copied.values.total, kept.values.total)


def test_tuples_of_another_type_have_a_layout_of_another_type():
    outer = example(2)
    other = outer._replace(numbers=outer.numbers.astype(float))
    assert Kept(outer).layout.dtype == Kept(example(3)).layout.dtype != Kept(other).layout.dtype


def test_what_is_no_array_cannot_be_kept():
    with pytest.raises(TypeError):
        Kept(example(1)._replace(total=1.0))
