"""Kernels get named tuples of arrays as one pointer, and read and write through it as ever."""

from typing import NamedTuple

import numpy as np
import pytest

from vibro_ros.solver import compilation
from vibro_ros.solver.by_reference import Reference
from vibro_ros.solver.progress import progress


class Inner(NamedTuple):
    """A tuple in a tuple."""

    table: np.ndarray
    factor: float


class Outer(NamedTuple):
    """What kernels get."""

    total: np.ndarray
    inner: Inner


@pytest.fixture
def kernels(monkeypatch, tmp_path):
    """A part, and the entry that calls it: total += factor * (sum of the row's products with `weights`)."""
    monkeypatch.setattr(compilation, "_FOLDER", tmp_path)

    @compilation.kernel
    def weighted(inner, row, weights):
        result = 0.0
        for k in range(len(weights)):
            result += inner.table[row, k] * weights[k]
        return inner.factor * result

    @compilation.entry_kernel
    def add(outer, row, weights):
        """Add what `weighted` returns."""
        outer.total[0] += weighted(outer.inner, row, weights)
        return row

    return weighted, add


def test_fields_are_read_and_written_through_references(kernels):
    _, add = kernels
    outer = Outer(np.array([1.0]), Inner(np.array([[1.0, 2.0], [3.0, 4.0]]), 0.5))
    assert add(outer, 1, np.array([10.0, 100.0])) == 1
    assert outer.total[0] == 1.0 + 0.5 * 430.0
    other = outer._replace(inner=outer.inner._replace(factor=2.0))  # nothing of the first call is left
    add(other, 0, np.array([1.0, 1.0]))
    assert outer.total[0] == 216.0 + 6.0


def test_a_part_takes_one_pointer_for_all_fields(kernels):
    weighted, add = kernels
    add(Outer(np.zeros(1), Inner(np.zeros((1, 1)), 1.0)), 0, np.zeros(1))
    (signature,) = weighted.nopython_signatures
    assert isinstance(signature.args[0], Reference)
    assert len(str(signature.args[0])) < 40  # it stands in the name of every symbol


def test_an_entry_is_known_by_its_own_name(kernels):
    _, add = kernels
    assert (add.__name__, add.__doc__) == ("add", "Add what `weighted` returns.")


def test_a_field_that_is_not_there_is_named(kernels):
    @compilation.entry_kernel
    def wrong(outer):
        return outer.nothing

    with pytest.raises(Exception, match="Unknown attribute 'nothing' of type Outer"):
        wrong(Outer(np.zeros(1), Inner(np.zeros((1, 1)), 1.0)))
    progress.under_way.clear()  # a kernel is under way until it is compiled
