"""The compilation unit: all kernels as one Cython module, made of their modules' text when the package is built.

Kernels are written as plain Python with types, each in the module where a reader looks for it. One unit lets the
compiler inline across modules. Every part becomes a function of C without any Python object (`nogil`), so that text
that Cython could only translate to calls of the interpreter is an error of the build.

    python -m vibro_ros.solver.unit FOLDER

writes `core.pyx`, and `core.h` with constants and with the structures of records and named tuples, into the folder.
"""

import ast
import hashlib
import importlib
import inspect
import os
import sys
import typing
from pathlib import Path
from typing import Any

import numpy as np

if __name__ == "__main__":  # what is being built cannot be imported
    os.environ["VIBRO_ROS_PLAIN"] = "1"

from vibro_ros.solver.layout import kinds_of, parts_of  # noqa: E402
from vibro_ros.solver.typed import Kind  # noqa: E402

#: Modules with kernels.
MODULES = ("elementary", "channels", "system", "polynomial", "drive", "segment", "flow", "guards", "rest", "rotor",
           "taylor", "shock", "events", "energy", "lowpass", "event_loop", "right_hand_side", "fixed_step", "readout")
#: Named tuples that entries take by their layout.
_LAID = ("System", "State", "Step")

_HEAD = """\
# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, infer_types=True
# cython: initializedcheck=False, cpow=True
from cpython.buffer cimport Py_buffer, PyBUF_ND, PyBuffer_Release, PyObject_GetBuffer

cdef extern from "core.h" nogil:
    double INFINITY, NAN
    double fabs(double)
    double sqrt(double)
    double copysign(double, double)
    bint isfinite(double)
    long whole(double)
    bint wide "has_wide_registers"()
    enum: LENGTH
    ctypedef double Vector  # a number to Cython, so that it writes + - *, which C++ overloads
"""

_VECTORS = """\
    Vector vector(Row)
    void store(Row, Vector)
    double total(Vector)
    Vector raised(Vector)
    Vector lowered(Vector)
    Vector with_first(Vector, double)
    double last(Vector)
    Vector magnitudes(Vector)
    long indices_above(Vector, double)
    long first_index(long)
    Vector repeated(double)
    Vector powers(double)
    Rows as_column(Row)
"""

_ENTRIES = '''

cdef size_t address_of(array, long* lengths, int dimensions, Py_ssize_t size) except? 0:
    """Address of a contiguous array, which must outlive it, and its lengths."""
    cdef Py_buffer buffer
    PyObject_GetBuffer(array, &buffer, PyBUF_ND)
    cdef size_t address = <size_t> buffer.buf
    cdef bint fits = buffer.ndim == dimensions and buffer.itemsize == size
    if fits:
        for k in range(dimensions):
            lengths[k] = buffer.shape[k]
    PyBuffer_Release(&buffer)
    if not fits:
        raise TypeError("an array has another type or other dimensions than the kernel takes")
    return address


def address(array):
    """Return the address of a contiguous array."""
    cdef Py_buffer buffer
    PyObject_GetBuffer(array, &buffer, PyBUF_ND)
    cdef size_t result = <size_t> buffer.buf
    PyBuffer_Release(&buffer)
    return result


def has_wide_registers():
    """Return whether the processor can run `core_v3`."""
    return wide()
'''

_DIGEST = '''

def digest():
    """Return a digest of the text from which these kernels were made."""
    return "{}"
'''

_SCALARS = {"float": "double", "int": "long", "bool": "bint", "None": "void", "Vector": "Vector"}
_ELEMENTS = {np.dtype(np.float64): "double", np.dtype(np.int64): "long", np.dtype(np.bool_): "bint"}
_TEMPLATES = {1: "Array", 2: "Table", 3: "Table3", 4: "Table4"}


class _Names:
    """All modules, and what their names mean in the unit.

    Attributes
    ----------
    modules : dict of str to module
        The modules, imported as plain Python.
    trees : dict of str to ast.Module
        Their text.
    kernels : dict of str to dict of str to ast.FunctionDef
        Parts and entries of each module.
    kinds : dict of str to Kind
        Types of arrays and records, by name.
    tuples : dict of str to type
        Classes of named tuples of arrays, innermost first.
    constants : dict of str to object
        Numbers and arrays that kernels use, by their names in the unit.
    """

    def __init__(self) -> None:
        self.modules = {name: importlib.import_module(f"vibro_ros.solver.{name}")
                        for name in (*MODULES, "state", "typed", "vector")}
        self.trees = {name: ast.parse(inspect.getsource(module)) for name, module in self.modules.items()}
        self.kernels = {name: {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)
                               and any(ast.unparse(mark) in ("part", "entry") for mark in node.decorator_list)}
                        for name, tree in self.trees.items()}
        self.kinds: dict[str, Kind] = {}
        self.tuples: dict[str, type] = {}
        for module in self.modules.values():
            for name, value in vars(module).items():
                marks = [mark for mark in getattr(value, "__metadata__", ()) if isinstance(mark, Kind)]
                if marks:
                    self.kinds[name] = marks[0]
        for name in _LAID:
            self._add_tuple(next(vars(module)[name] for module in self.modules.values() if name in vars(module)))
        self.constants: dict[str, Any] = {}
        self._homes = {name: {entity: (name, entity) for entity in (*self.kernels[name], *_assigned(tree))}
                       | _imported(tree) for name, tree in self.trees.items()}

    def _add_tuple(self, record: Any) -> None:
        for name, kind in kinds_of(record).items():
            if kind is None:
                self._add_tuple(record.__annotations__[name])
        self.tuples[record.__name__] = record

    def in_unit(self, module: str, name: str) -> str:
        """Return the name in the unit of what `name` means in a module."""
        home, entity = self._homes[module].get(name, ("", name))
        if home in ("", "vector"):
            return name
        home, entity = self._homes[home].get(entity, (home, entity))
        result = f"{home}_{entity}" + "_" * (entity in self.kernels[home] and _is_entry(self.kernels[home][entity]))
        if entity not in self.kernels[home]:
            value = getattr(self.modules[home], entity)
            if not isinstance(value, (int, float, np.ndarray)):
                raise TypeError(f"{home}.{entity}: {type(value).__name__} is no constant that kernels can read")
            self.constants[result] = value
        return result

    def type_of(self, annotation: ast.expr | None) -> str:
        """Return the C type of an annotation."""
        text = "None" if annotation is None else ast.unparse(annotation)
        if text.startswith("tuple["):
            assert isinstance(annotation, ast.Subscript) and isinstance(annotation.slice, ast.Tuple)
            return f"({', '.join(map(self.type_of, annotation.slice.elts))})"
        if text not in _SCALARS and text not in self.kinds and text not in _LAID:
            raise TypeError(f"{text} is no type of a kernel's argument")
        return _SCALARS.get(text, text)


def _assigned(tree: ast.Module) -> list[str]:
    """Return the names of a module's variables."""
    return [name.id for node in tree.body if isinstance(node, ast.Assign) for target in node.targets
            for name in ast.walk(target) if isinstance(name, ast.Name)]


def _imported(tree: ast.Module) -> dict[str, tuple[str, str]]:
    """Return module and name of each name that a module imports from the solver."""
    return {alias.asname or alias.name: (home.rpartition(".")[2], alias.name) for node in tree.body
            if isinstance(node, ast.ImportFrom) and (home := node.module or "").startswith("vibro_ros.solver.")
            for alias in node.names}


class _Body(ast.NodeTransformer):
    """Rewrites the body of a kernel from Python with numpy to Cython with the arrays of vectors.h."""

    def __init__(self, names: _Names, module: str, kernel: ast.FunctionDef):
        self._names, self._module = names, module
        self.declared: dict[str, str] = {}
        self._own = {node.id for node in ast.walk(kernel)
                     if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}
        self._own |= {argument.arg for argument in kernel.args.args}
        self._loops = 0

    def visit_Name(self, node: ast.Name) -> ast.expr:  # noqa: N802
        if node.id not in self._own:
            node.id = self._names.in_unit(self._module, node.id)
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:  # noqa: N802
        if isinstance(node.value, ast.Name) and node.value.id == "math":
            value = getattr(self._names.modules["drive"].math, node.attr)
            if isinstance(value, float) and np.isfinite(value):
                return ast.Constant(value)
            return ast.Name({"inf": "INFINITY", "nan": "NAN"}.get(node.attr, node.attr), ast.Load())
        return self.generic_visit(node)  # type: ignore[return-value]

    def visit_Call(self, node: ast.Call) -> ast.expr:  # noqa: N802
        function = node.func.id if isinstance(node.func, ast.Name) else ""
        arguments = [self.visit(argument) for argument in node.args]
        if function == "len":
            return ast.Attribute(arguments[0], "n0", ast.Load())
        if function in ("abs", "int"):
            return ast.Call(ast.Name({"abs": "fabs", "int": "whole"}[function], ast.Load()), arguments, [])
        return ast.Call(self.visit(node.func), arguments, [])

    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:  # noqa: N802
        if isinstance(node.value, ast.Attribute) and node.value.attr == "shape":
            return ast.Attribute(self.visit(node.value.value), f"n{ast.unparse(node.slice)}", ast.Load())
        value = self.visit(node.value)
        for index in node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]:
            if not isinstance(index, ast.Slice):
                value = ast.Subscript(value, self.visit(index), node.ctx)
            elif index.upper is not None:
                first = self.visit(index.lower) if index.lower is not None else ast.Constant(0)
                value = _method(value, "part", first, self.visit(index.upper))
            elif index.lower is not None:
                value = _method(value, "tail", self.visit(index.lower))
        return value

    def visit_Assign(self, node: ast.Assign) -> ast.stmt:  # noqa: N802
        target = node.targets[0]
        if isinstance(target, ast.Subscript):
            index = target.slice.elts[-1] if isinstance(target.slice, ast.Tuple) else target.slice
            if isinstance(index, ast.Slice):
                return ast.Expr(_method(self.visit(target), "fill", self.visit(node.value)))
        return self.generic_visit(node)  # type: ignore[return-value]

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.stmt:  # noqa: N802
        assert isinstance(node.target, ast.Name) and node.value is not None
        self.declared[node.target.id] = self._names.type_of(node.annotation)
        return ast.Assign([node.target], self.visit(node.value))

    def visit_For(self, node: ast.For) -> ast.stmt:  # noqa: N802
        if isinstance(node.iter, ast.Call):
            return self.generic_visit(node)  # type: ignore[return-value]
        self._loops += 1
        count, items = ast.Name(f"_{self._loops}", ast.Load()), self.visit(node.iter)
        first = ast.Assign([node.target], ast.Subscript(items, count, ast.Load()))
        body = [first, *(self.visit(statement) for statement in node.body)]
        return ast.For(ast.Name(f"_{self._loops}", ast.Store()), ast.Call(ast.Name("range", ast.Load()), [
            ast.Attribute(items, "n0", ast.Load())], []), body, [])


def _method(value: ast.expr, name: str, *arguments: ast.expr) -> ast.expr:
    return ast.Call(ast.Attribute(value, name, ast.Load()), list(arguments), [])


def _kernel(names: _Names, module: str, kernel: ast.FunctionDef) -> str:
    """Return a part or an entry in Cython."""
    arguments = [(argument.arg, names.type_of(argument.annotation)) for argument in kernel.args.args]
    result, body = names.type_of(kernel.returns), _Body(names, module, kernel)
    statements = [body.visit(statement) for statement in kernel.body if not _is_docstring(statement)]
    text = ast.unparse(ast.fix_missing_locations(ast.Module([*statements], [])))
    lines = [f"cdef {kind} {name}" for name, kind in body.declared.items()] + text.splitlines()
    signature = ", ".join(f"{kind} {name}" for name, kind in arguments)
    # The hint `inline` lets the compiler copy more parts into their callers, which saves an eighth of a run's time.
    code = "\n    ".join([f"cdef inline {result} {module}_{kernel.name}({signature}) noexcept nogil:", *lines])
    if _is_entry(kernel):
        code = code.replace(f"{module}_{kernel.name}(", f"{module}_{kernel.name}_(", 1)
        code += _entry(names, module, kernel.name, arguments)
    return code


def _is_entry(kernel: ast.FunctionDef) -> bool:
    return any(ast.unparse(mark) == "entry" for mark in kernel.decorator_list)


def _is_docstring(statement: ast.stmt) -> bool:
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)


def _entry(names: _Names, module: str, name: str, arguments: list[tuple[str, str]]) -> str:
    """Return the function of Python that calls an entry."""
    taken, lines = [], []
    for argument, kind in arguments:
        if kind in _LAID:
            lines.append(f"cdef long[1] {argument}_n")
            taken.append(f"<{kind}> address_of({argument}, {argument}_n, 1, 8)")
        elif kind in names.kinds:
            what = names.kinds[kind]
            lines += [f"cdef {kind} {argument}_", f"{argument}_.data = <{_element(what)}*> address_of("
                      f"{argument}, &{argument}_.n0, {what.dimensions}, {what.dtype.itemsize})"]
            taken.append(f"{argument}_")
        else:
            taken.append(argument)
    head = ", ".join(f"{kind} {argument}" if kind in ("double", "long", "bint") else argument
                     for argument, kind in arguments)
    result = f"return {module}_{name}_({', '.join(taken)})"
    return "\n    ".join([f"\n\n\ndef {module}_{name}({head}):", *lines, result])


# The structures of C++


def _element(kind: Kind) -> str:
    """Return the C type of an array's elements; of records, the name of their structure."""
    return _ELEMENTS.get(kind.dtype) or _RECORDS[kind.dtype]


_RECORDS: dict[np.dtype, str] = {}


def _c_type(kind: Kind) -> str:
    element = _element(kind).replace("bint", "bool")
    return f"Records<{element}>" if kind.dtype.names else f"{_TEMPLATES[kind.dimensions]}<{element}>"


def _record(dtype: np.dtype, name: str) -> tuple[list[str], list[str]]:
    """Return the structure of a record in C++, checked against numpy's, and in Cython."""
    header, cython, checks = [f"struct {name} {{"], [f"    cdef struct {name}:"], []
    assert dtype.fields is not None
    for field, (of_field, offset, *_) in dtype.fields.items():
        base, shape = (of_field.subdtype or (of_field, ()))
        kind = _ELEMENTS.get(base) or _RECORDS[base]
        lengths = "".join(f"[{length}]" for length in shape)
        header.append(f"    {kind.replace('bint', 'bool')} {field}_{lengths};")
        cython.append(f'        {kind} {field} "{field}_"{lengths}')  # a name with _ is no keyword of C++
        checks.append(f'static_assert(offsetof({name}, {field}_) == {offset}, "{name}.{field}");')
    return [*header, "};", *checks, f'static_assert(sizeof({name}) == {dtype.itemsize}, "{name}");'], cython


def _tuple(record: type, names: _Names) -> tuple[list[str], list[str]]:
    """Return the structure of a named tuple in C++ and in Cython, with the fields that `layout.Laid` lists."""
    header, cython = [], []
    for field, kind in kinds_of(record).items():
        if kind is None:
            of_field = typing.get_type_hints(record)[field].__name__
            header.append(f"    {of_field} {field};")
            cython.append(f"        {of_field} {field}")
            continue
        parts = {part: _RECORDS[kind.dtype.fields[part][0]] for part in parts_of(kind)} if kind.dtype.fields else {}
        header += [f"    {part_kind} *{part};" for part, part_kind in parts.items()]
        cython += [f"        {part_kind} *{part}" for part, part_kind in parts.items()]
        if not parts:
            header.append(f"    {_c_type(kind)} {field};")
            alias = next(name for name, other in names.kinds.items() if other == kind)
            cython.append(f"        {alias} {field}")
    name = record.__name__
    tables = f"{name}Tables" if name in _LAID else name
    tail = [f"typedef {tables} *{name};"] if name in _LAID else []
    return ([f"struct {tables} {{", *header, "};", *tail],
            [f"    cdef cppclass {tables}:", *cython, *[f"    ctypedef {tables}* {name}" for _ in tail]])


def _declarations(names: _Names) -> tuple[list[str], list[str]]:
    """Return all structures in C++ and in Cython."""
    header: list[str] = []
    cython: list[str] = []
    for name, kind in names.kinds.items():  # records first, those of records after their parts
        if kind.dimensions == 0:
            _RECORDS[kind.dtype] = f"{name}Record"
    for name, kind in names.kinds.items():
        if kind.dimensions == 0:
            for lines, more in zip((header, cython), _record(kind.dtype, f"{name}Record"), strict=True):
                lines += more
            header.append(f"typedef {name}Record *{name};")
            cython.append(f"    ctypedef {name}Record* {name}")
    for name, kind in names.kinds.items():
        if kind.dimensions == 0 or (kind.dtype.names and kind.dtype not in _RECORDS):
            continue
        element, below = _element(kind), {alias: other for alias, other in names.kinds.items()
                                          if other == Kind(kind.dtype, kind.dimensions - 1)}
        header.append(f"typedef {_c_type(kind)} {name};")
        cython += [f"    cdef cppclass {name}:", f"        {element}* data",
                   f"        long {', '.join(f'n{k}' for k in range(kind.dimensions))}"]
        if kind.dtype.names:
            cython.append(f"        {element}* operator[](long)")
            continue
        cython.append(f"        {next(iter(below))} operator[](long)" if kind.dimensions > 1
                      else f"        {element}& operator[](long)")
        if kind.dimensions <= 2:
            cython += [f"        {name} part(long, long)", f"        {name} tail(long)",
                       f"        void fill({element})"]
    for record in names.tuples.values():
        for lines, more in zip((header, cython), _tuple(record, names), strict=True):
            lines += more
    return header, cython


def _constant(name: str, value: Any) -> tuple[list[str], str]:
    """Return a constant in C++ and in Cython."""
    if isinstance(value, np.ndarray):
        kind = {np.dtype(np.float64): "double", np.dtype(np.int64): "long"}[value.dtype]
        alias = {("double", 1): "Row", ("double", 2): "Rows", ("long", 1): "Indices"}[kind, value.ndim]
        numbers = ", ".join(map(_literal, value.ravel().tolist()))
        lengths = ", ".join(map(str, value.shape))
        return [f"alignas(32) static {kind} {name}_[] = {{{numbers}}};",
                f"static const {alias} {name} = {{{name}_, {lengths}}};"], f"    {alias} {name}"
    kind = "double" if isinstance(value, float) else "long"
    return [f"static const {kind} {name} = {_literal(value)};"], f"    {kind} {name}"


def _literal(value: float) -> str:
    return str(int(value)) if isinstance(value, int) else "INFINITY" if value == float("inf") else float(value).hex()


def unit() -> tuple[str, str]:
    """Return the texts of `core.pyx` and `core.h`."""
    names = _Names()
    header, cython = _declarations(names)
    kernels = [_kernel(names, module, kernel) for module in MODULES for kernel in names.kernels[module].values()]
    constants = [_constant(name, value) for name, value in sorted(names.constants.items())]
    text = "\n".join([_HEAD + "\n".join(cython), _VECTORS + "\n".join(line for _, line in constants) + _ENTRIES,
                      *(f"\n{kernel}\n" for kernel in kernels)])
    top = ["// Made from the solver's modules by unit.py.", "#pragma once", '#include "vectors.h"',
           f"static_assert(LENGTH == {names.modules['vector'].LENGTH}, \"length of a vector\");"]
    structures = "\n".join([*top, *header, *(line for lines, _ in constants for line in lines)]) + "\n"
    vectors = (Path(__file__).parent / "vectors.h").read_text()
    digest = hashlib.sha256((text + structures + vectors).encode()).hexdigest()
    return text + _DIGEST.format(digest), structures


def write(folder: Path) -> None:
    """Write the unit into a folder; a file that would stay the same is left alone, so that it is not compiled again."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in zip(("core.pyx", "core.h"), unit(), strict=True):
        path = folder / name
        if not path.exists() or path.read_text() != text:
            path.write_text(text)


if __name__ == "__main__":
    write(Path(sys.argv[1]))
