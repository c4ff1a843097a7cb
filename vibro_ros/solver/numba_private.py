"""All that relies on private parts of numba, and the check that a numba still has them.

docs/numba.md says what each part saves. `compilation` uses this module if `missing_parts` finds nothing; else kernels
take the plain road, which works without any of it.

- *References.* numba passes a named tuple of arrays field by field, and an array as seven numbers or more: a kernel of
  one line that reads one field took, stored and handed on 400 arguments, of which the compiler had to see one after the
  other that they are not used. A `Reference` points at the tuple, and a field is loaded where a kernel reads it. Once
  all kernels are inlined into one, nothing of this is left.
- *Layouts.* numba looks at every array of a tuple at every call from Python, 10 µs and more for the forty of a system
  and its state. `layout` lays the tuple out in memory once; an entry kernel takes the layout as one array.
- *Parts.* numba optimises every function that it compiles, with all that is inlined into it, and makes machine code of
  it: nine tenths of that would never run. A part is compiled to intermediate code alone; the kernel that Python calls
  is optimised once, as a whole.
- *Stored kernels.* numba's own cache looks at the file of the entry kernel alone, not at those of its parts, takes any
  file that it can unpickle for machine code, and gives the errors of a full disk to whoever calls the kernel.
"""

import functools
import hashlib
import inspect
import platform
from collections.abc import Callable
from typing import Any, NamedTuple

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, compiler, serialize, types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.datamodel import default_manager
from numba.core.runtime import rtsys
from numba.core.typed_passes import NativeLowering
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import intrinsic, lower_getattr_generic, models, register_model

from vibro_ros.solver.kernel_cache import KernelFolder, progress

#: Versions of numba with which all tests have passed. Any other is checked at every start.
TESTED = ("0.68.1",)


# References

class Reference(types.Type):
    """Numba's type of a reference to a named tuple; its fields that are named tuples are references, too."""

    def __init__(self, record: types.NamedTuple):
        self.record = record
        # The name stands in every symbol that takes the reference: the tuple's own name has thousands of characters.
        digest = hashlib.sha256(record.name.encode()).hexdigest()[:16]
        super().__init__(name=f"{record.instance_class.__name__}_{digest}")

    def field(self, name: str) -> types.Type:
        """The type of a field, as kernels see it."""
        return _referred(self.record.types[self.record.fields.index(name)])


def _referred(kind: types.Type) -> types.Type:
    """The type that kernels get in place of a type: a reference to a named tuple, be it given as such or as its layout
    in memory; everything else as it is."""
    if isinstance(kind, types.Array) and isinstance(kind.dtype, types.Record):
        return _laid_out.get(next(iter(kind.dtype.fields)), kind)
    return Reference(kind) if isinstance(kind, types.NamedTuple) else kind


@register_model(Reference)
class _ReferenceModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, manager.lookup(kind.record).get_value_type().as_pointer())


@infer_getattr
class _Fields(AttributeTemplate):
    key = Reference

    def generic_resolve(self, reference, name):
        return reference.field(name) if name in reference.record.fields else None


@lower_getattr_generic(Reference)
def _load_field(context, builder, reference, pointer, name):
    index = ir.Constant(ir.IntType(32), reference.record.fields.index(name))
    place = builder.gep(pointer, [ir.Constant(ir.IntType(32), 0), index], inbounds=True)
    return place if isinstance(reference.field(name), Reference) else builder.load(place)


@intrinsic
def references(_, values):
    """A tuple of values, with references in place of the named tuples."""
    results = [_referred(kind) for kind in values.types]

    def refer(context, builder, part, kind, result):
        if result is kind:
            return part
        if isinstance(kind, types.NamedTuple):
            return cgutils.alloca_once_value(builder, part)
        return builder.bitcast(context.make_array(kind)(context, builder, part).data, context.get_value_type(result))

    def generate(context, builder, sign, arguments):
        parts = cgutils.unpack_tuple(builder, arguments[0])
        return context.make_tuple(builder, sign.return_type, [
            refer(context, builder, *each) for each in zip(parts, values.types, results, strict=True)])

    return types.Tuple(results)(values), generate


# Layouts

# Reference by the name of the only field of a layout's type.
_laid_out: dict[str, Reference] = {}
_dtypes: dict[tuple, np.dtype] = {}
# What numba keeps of an array, in this order.
_ARRAY = ("meminfo", "parent", "nitems", "itemsize", "data", "shape", "strides")


def layout(values: NamedTuple) -> np.ndarray:
    """A named tuple of arrays, and of such tuples, as kernels see it in memory; shape (numbers,).

    Entry kernels take it in place of the tuple, while the tuple keeps its arrays.
    """
    numbers: list[int] = []
    _add_numbers(values, numbers)
    return np.array(numbers, dtype=np.int64).view(_layout_type(values))


def _layout_type(values: NamedTuple) -> np.dtype:
    """The type of a layout names that of the tuple, which takes numba a third of a millisecond to find: too long for
    a sweep."""
    keys: list[Any] = []
    _add_keys(values, keys)
    key = tuple(keys)
    if key not in _dtypes:
        reference = Reference(numba.typeof(values))
        _laid_out[reference.name] = reference
        _dtypes[key] = np.dtype([(reference.name, np.int64)])
    return _dtypes[key]


def _add_keys(values: Any, keys: list[Any]) -> None:
    keys.append(type(values))
    for value in values:
        if isinstance(value, np.ndarray):
            keys += value.dtype, value.ndim, value.flags.num
        else:
            _add_keys(value, keys)


def _add_numbers(values: Any, numbers: list[int]) -> None:
    """Add what `_ARRAY` names of each array; no kernel reads the first two."""
    for value in values:
        if isinstance(value, np.ndarray):
            # Not by the array interface, which takes 20 µs to describe the fields of a record.
            numbers += 0, 0, value.size, value.itemsize, value.ctypes.data, *value.shape, *value.strides
        else:
            _add_numbers(value, numbers)


# Parts

class _PartLibrary(JITCodeLibrary):
    """The intermediate code of a part, together with that of the parts which it calls."""

    def finalize(self):
        """Link in the parts that this part calls; leave optimisation and machine code to the entry kernel."""
        for library in dict.fromkeys(self._linking_libraries):
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)
class _OfferToCallers(LoweringPass):
    """Let other kernels call the part, which numba itself does once there is machine code."""

    _name = "offer_to_callers"

    def __init__(self):
        super().__init__()

    def run_pass(self, state):
        """Register the part."""
        # numba wants a built-in function here, for Python to call. Whatever it is called with, this one raises.
        state.cr = state.cr._replace(cfunc=[].remove)
        state.targetctx.insert_user_function(state.cr.cfunc, state.cr.fndesc, [state.library])
        return True


class _PartCompiler(CompilerBase):
    """What numba's option `pipeline_class` takes, for a kernel that is part of others."""

    def define_pipelines(self):
        """numba's passes, but for the last: no machine code."""
        state = self.state
        state.flags.no_compile = True
        state.library = _PartLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        passes = DefaultPassBuilder.define_nopython_pipeline(state)
        passes.add_pass_after(_OfferToCallers, NativeLowering)
        passes.finalize()
        return [passes]


_ENTRY = {"error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True}
_PART = {**_ENTRY, "no_cpython_wrapper": True, "pipeline_class": _PartCompiler}


def compiled_part(function: Callable, fastmath, inlined: bool):
    """A kernel that is part of others, without reference counts, so that it cannot allocate."""
    return numba.njit(fastmath=fastmath, forceinline=inlined, **_PART)(function)


# Stored kernels

class _StoredKernel:
    """The cache of one kernel; what numba's dispatcher calls."""

    cache_path = None

    def __init__(self, function: Callable, store: KernelFolder):
        self._function, self._store = function, store

    def load_overload(self, signature, target):
        """The compiled kernel for a signature; None when it must be compiled."""
        if (data := self._store.read(self.name(signature, target.codegen()))) is not None:
            # All that machine code needs of a target; `refresh`, which numba calls here, gets ready to compile and
            # takes three times as long as everything else, scipy's import included.
            rtsys.initialize(target)
            progress.loaded.append(self._function.__name__)
            return compiler.CompileResult._rebuild(target, *serialize.loads(data))
        progress.under_way.append(self._function.__name__)
        return None

    def save_overload(self, signature, compiled):
        """Keep a compiled kernel, if there is room for it."""
        progress.under_way.remove(self._function.__name__)
        progress.done.append(self._function.__name__)
        if not compiled.library.has_dynamic_globals:  # which hold addresses of this process
            data = serialize.dumps(compiled._reduce())
            progress.unwritable = self._store.write(self.name(signature, compiled.codegen), data)

    def name(self, signature, codegen) -> str:
        """Name of the kernel's file: of all that the machine code depends on but the sources of the solver."""
        source = inspect.getsource(inspect.getmodule(self._function))
        key = (numba.__version__, platform.python_version(), source, str(signature), codegen.magic_tuple())
        name = f"{self._function.__module__.rpartition('.')[2]}.{self._function.__qualname__}"
        return f"{name}-{hashlib.sha256(repr(key).encode()).hexdigest()[:32]}.kernel"


def stored(dispatcher, store: KernelFolder):
    """Store what numba's `dispatcher` compiles."""
    dispatcher._cache = _StoredKernel(dispatcher.py_func, store)
    return dispatcher


def is_stored(dispatcher, kinds: tuple) -> bool:
    """Whether there is a stored kernel for arguments of these types."""
    cache = dispatcher._cache
    return cache._store.has(cache.name(kinds, dispatcher.targetctx.codegen()))


def compiled_entry(function: Callable, fastmath, store: KernelFolder):
    """A kernel that Python calls, stored with all that is inlined into it; inside, named tuples are references."""
    part = compiled_part(function, fastmath, inlined=True)

    @functools.wraps(function)
    def entry(*arguments):
        return part(*references(arguments))

    del entry.__wrapped__  # numba would look for the arguments there
    return stored(numba.njit(fastmath=fastmath, **_ENTRY)(entry), store)


def entry_types(entry, arguments: tuple) -> tuple:
    """The types for which an entry kernel is compiled when it is called with these arguments."""
    return (entry.typeof_pyval(arguments),)  # they arrive in one tuple


# The check

class _Inner(NamedTuple):
    table: np.ndarray


class _Outer(NamedTuple):
    total: np.ndarray
    inner: _Inner


class _Memory(KernelFolder):
    def __init__(self):
        super().__init__(None)
        self.kernels: dict[str, bytes] = {}

    def read(self, name):
        return self.kernels.get(name)

    def write(self, name, data):
        self.kernels[name] = data
        return ""


def missing_parts() -> str:
    """What of this numba is no longer as this module relies on, in words; empty if all is as it was.

    It compiles a small kernel, which takes a second.
    """
    try:
        return _first_difference()
    except Exception as error:
        progress.under_way.clear()
        return f"the compiler's passes, options or cache have changed ({type(error).__name__}: {str(error)[:200]})"


def _first_difference() -> str:
    # First of all: a kernel that reads memory that is laid out in another way would end the process.
    if default_manager.lookup(types.float64[:, ::1])._fields != _ARRAY:
        return f"an array in memory is no longer {', '.join(_ARRAY)}"

    def cell(inner, row):
        return 0.5 * inner.table[row, 1]

    half = compiled_part(cell, {"contract"}, inlined=True)

    def add(outer, row):
        outer.total[0] += half(outer.inner, row)
        return outer.total[0]

    memory = _Memory()
    outer = _Outer(np.array([1.0]), _Inner(np.array([[1.0, 2.0], [3.0, 4.0]])))
    first, again = (compiled_entry(add, {"contract"}, memory) for _ in range(2))
    if first(outer, 1) != 3.0 or outer.total[0] != 3.0:
        return "a kernel no longer reads a named tuple by reference"
    if first(layout(outer), 0) != 4.0:
        return "a kernel no longer reads a named tuple that is laid out in memory"
    if len(memory.kernels) != 2 or again(outer, 1) != 6.0 or not again.stats.cache_hits:
        return "a stored kernel can no longer be loaded"
    return ""
