"""Types of the kernels' arguments, and the marks `part` and `entry`.

Kernels are plain, typed Python. When the package is built, `unit` makes one C++ module of their text, and `entry` gives
Python the compiled function in place of its text. With `VIBRO_ROS_PLAIN=1` nothing compiled is used: a debugger steps
from `simulate` into every kernel, and every run has the same bits.

Types of arrays say how many dimensions an array has and what it contains, so that the same annotations are the fields
of structures in C++. An annotation `int`, `float` or `bool` is a number of 64 bits or a flag there.
"""

import os
from collections.abc import Callable
from importlib import import_module
from typing import Annotated, Any, NamedTuple, TypeAlias, TypeVar

import numpy as np

#: Whether kernels run as plain Python.
PLAIN = bool(os.environ.get("VIBRO_ROS_PLAIN"))


class Kind(NamedTuple):
    """What an array contains.

    Attributes
    ----------
    dtype : dtype
        Type of its elements.
    dimensions : int
        Number of its dimensions; 0 for one record.
    """

    dtype: np.dtype
    dimensions: int


_FLOAT, _INDEX, _FLAG = np.dtype(np.float64), np.dtype(np.int64), np.dtype(np.bool_)

Row: TypeAlias = Annotated[np.ndarray, Kind(_FLOAT, 1)]
Rows: TypeAlias = Annotated[np.ndarray, Kind(_FLOAT, 2)]
Rows3: TypeAlias = Annotated[np.ndarray, Kind(_FLOAT, 3)]
Rows4: TypeAlias = Annotated[np.ndarray, Kind(_FLOAT, 4)]
Indices: TypeAlias = Annotated[np.ndarray, Kind(_INDEX, 1)]
Indices2: TypeAlias = Annotated[np.ndarray, Kind(_INDEX, 2)]
Indices3: TypeAlias = Annotated[np.ndarray, Kind(_INDEX, 3)]
Indices4: TypeAlias = Annotated[np.ndarray, Kind(_INDEX, 4)]
Flags: TypeAlias = Annotated[np.ndarray, Kind(_FLAG, 1)]
Flags2: TypeAlias = Annotated[np.ndarray, Kind(_FLAG, 2)]


def record(fields: list[tuple]) -> np.dtype:
    """Return the dtype of records with these fields, which Python, as kernels do, reads as `one.field`."""
    return np.dtype((np.record, np.dtype(fields, align=True)))


Function = TypeVar("Function", bound=Callable[..., Any])

if not PLAIN:
    try:
        _core: Any = import_module("vibro_ros.solver.core")
        if _core.has_wide_registers():
            _core = import_module("vibro_ros.solver.core_v3")
    except ModuleNotFoundError as error:
        raise ImportError(
            f"{error.name}: the compiled kernels are missing; build them by `make setup` or `pip install .`, which "
            "need a C++ compiler and Python's headers (Debian, Ubuntu: apt install g++ python3-dev), or set "
            "VIBRO_ROS_PLAIN=1, with which kernels run as plain Python, about a thousand times slower") from None

#: Returns the address of a contiguous array's first element; numpy's own way, `ctypes.data`, takes five times as long.
address_of: Callable[[np.ndarray], int] = (lambda array: array.ctypes.data) if PLAIN else _core.address


def part(function: Function) -> Function:
    """Declare a function that kernels may call; it becomes a part of them."""
    return function


def entry(function: Function) -> Function:
    """Declare a part that Python calls, too, and return it compiled.

    In place of a named tuple the compiled function takes its `layout.Laid.layout`.
    """
    return function if PLAIN else getattr(_core, f"{function.__module__.rpartition('.')[2]}_{function.__name__}")
