"""What is private to numba: what it gives, what is said when a numba lacks it, and the plain road without it."""

import copy
import faulthandler
import os
import re
import subprocess
import sys
from typing import NamedTuple

import numpy as np
import pytest
from numba.core.compiler_machinery import PassManager

from vibro_ros.solver import compilation, numba_private
from vibro_ros.solver.compilation import Laid
from vibro_ros.solver.kernel_cache import KernelFolder
from vibro_ros.solver.numba_private import Reference, missing_parts

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


def example(rows: int) -> Outer:
    rng = np.random.default_rng(rows)
    return Outer(np.zeros(1), Inner(rng.standard_normal((rows, 3)), rng.random(rows) < 0.5), np.arange(rows),
                 np.array([(0.5, 3)], PAIR), np.empty((0, rows)))


@pytest.fixture
def kernels(monkeypatch, tmp_path):
    """A part, and the entry that calls it, which reads something of every array and adds the result to the total."""
    monkeypatch.setattr(compilation, "_FOLDER", KernelFolder(tmp_path / "kernels"))

    @compilation.kernel
    def weighted(inner, row):
        return inner.table[row, 0] + 2.0 * inner.table[row, 2] if inner.flags[row] else 0.0

    @compilation.entry_kernel
    def read(outer, weight):
        """Add what `weighted` returns."""
        result = outer.now[0].one * outer.now[0].other + outer.numbers[-1] + len(outer.empty)
        for row in range(len(outer.inner.table)):
            result += weighted(outer.inner, row)
        outer.total[0] += weight * result
        return result
    return weighted, read


def by_numpy(outer: Outer) -> float:
    return 1.5 + outer.numbers[-1] + ((outer.inner.table[:, 0] + 2.0 * outer.inner.table[:, 2])
                                      @ outer.inner.flags.astype(float))


def test_kernels_read_and_write_tuples_and_their_layouts(kernels):
    _, read = kernels
    for rows in (1, 4):  # one type, other shapes
        plain, other = example(rows), example(rows)
        assert read(Laid(other).layout, 2.0) == read(plain, 2.0) == pytest.approx(by_numpy(plain), rel=1e-14)
        assert other.total[0] == plain.total[0] == 2.0 * read(plain, 0.0)
    assert len(read.signatures) == 2
    assert (read.__name__, read.__doc__) == ("read", "Add what `weighted` returns.")


def test_a_copy_is_of_its_own_arrays(kernels):
    laid, (_, read) = Laid(example(4)), kernels
    copied = copy.deepcopy(laid)
    read(copied.layout, 1.0)
    assert copied.values.total[0] != 0.0 == laid.values.total[0]


def test_tuples_of_another_type_have_a_layout_of_another_type():
    outer = example(2)
    other = outer._replace(numbers=outer.numbers.astype(float))
    assert Laid(outer).layout.dtype == Laid(example(3)).layout.dtype != Laid(other).layout.dtype
    with pytest.raises(TypeError):
        Laid(outer._replace(total=1.0))


def test_a_part_takes_one_pointer_for_all_fields(kernels):
    weighted, read = kernels
    read(example(1), 1.0)
    (signature,) = weighted.nopython_signatures
    assert isinstance(signature.args[0], Reference)
    assert len(str(signature.args[0])) < 40  # it stands in the name of every symbol


def test_this_numba_has_every_private_part():
    assert missing_parts() == ""


LAYOUT, ANOTHER = numba_private.layout, np.array([7.0])


class _OtherArray:
    _fields = ("data", "shape", "strides")


@pytest.mark.parametrize(("change", "words"), [
    (lambda patch: patch.setattr(numba_private.default_manager, "lookup", lambda kind: _OtherArray),
     "an array in memory is no longer meminfo, parent"),
    (lambda patch: patch.delattr(PassManager, "add_pass_after"), "AttributeError: .*add_pass_after"),
    (lambda patch: patch.setitem(numba_private._PART, "_no_such_option", True), "_no_such_option"),
    (lambda patch: patch.setattr(numba_private.serialize, "loads", lambda data: ()), "passes, options or cache"),
    (lambda patch: patch.setattr(numba_private, "stored", lambda dispatcher, store: dispatcher), "stored kernel"),
    (lambda patch: patch.setattr(numba_private, "layout", lambda values: LAYOUT(values._replace(total=ANOTHER))),
     "laid out in memory"),
])
def test_a_numba_that_has_changed_is_described(monkeypatch, change, words):
    with monkeypatch.context() as patch:
        change(patch)
        assert re.search(words, missing_parts())


def said(program: str, **environment: str) -> list[str]:
    """What a program prints, word by word."""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=900,
                          env={**os.environ, **environment})
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


CHANGED = """
import numba
numba.__version__ = "99.9"
{change}
from vibro_ros.solver import compilation
print(compilation.multiply_add(), compilation.PLAIN)
"""


def test_an_unknown_numba_takes_the_plain_road_if_the_check_fails(tmp_path):
    (tmp_path / "caches").mkdir()
    environment = {"NUMBA_CACHE_DIR": str(tmp_path / "caches")}
    (answer,) = said(CHANGED.format(change=""), **environment)
    for change, reason in (("import numba.core.compiler as c; del c.CompileResult._rebuild", "_rebuild"),
                           ("import numba.core.runtime as r; del r.rtsys", "rtsys")):
        same, *words = said(CHANGED.format(change=change), **environment)
        assert same == answer and words[1].startswith("99.9") and reason in " ".join(words)


RUN = """
import hashlib
import numpy as np
from vibro_ros import load_scene
from vibro_ros.model.tables import compile_scene
from vibro_ros.simulation.readout import Readout
from vibro_ros.simulation.samples import Trace
from vibro_ros.solver.segment import read_signals
from vibro_ros.solver.state import new_state

model, found = compile_scene(load_scene("unilateral")), []
channels, starts, random = model.forms.channels.count, model.system.signals.start, np.random.default_rng(0)
for cell in range(len(starts) - 1):
    state, sliders = new_state(model.system, 100.0, np.full(2, 0.06), model.initial_mode), np.zeros(2)
    state.now["drive"]["cell"] = cell
    state.now["drive"]["offset"] = random.uniform() * (starts[cell + 1] - starts[cell])
    read_signals(model.system, state, sliders)
    trace = Trace(random.normal(size=(1, channels)), np.zeros(1, np.int64), random.normal(size=(1, 3)))
    found.append(np.concatenate([sliders, state.z.ravel(), Readout(model).values(np.zeros(1), trace)]))
print(hashlib.sha256(np.array(found).tobytes()).hexdigest(), np.isfinite(found).all())
"""


def test_the_plain_road_computes_the_same_bits():
    """The forcing's polynomials over every cell, and samples. The plain road compiles these two kernels in some 15 s of
    a processor, once after each change of the solver; docs/numba.md has whole runs, whose kernels take minutes."""
    faulthandler.cancel_dump_traceback_later()  # `said` has a limit of its own, for a machine with other work
    usual = said(RUN)
    assert usual[1] == "True" and said(RUN, VIBRO_ROS_KERNELS="plain") == usual
