"""Results on their way to another process: arrays through memory that both processes see, all else through a pipe.

An array that is pickled into a pipe is copied six times, in parts for which the processes wait for each other. Through
shared memory each process copies it once.
"""

import io
import mmap
import pickle
from typing import Any

import numpy as np

#: Size [B] of the memory for one result. Arrays that do not fit go through the pipe; pages never used cost nothing.
ROOM = 2**23
_ALIGNMENT = 64


class Handover:
    """The way of results from a process to the one that forked it.

    Parameters
    ----------
    count : int
        Results that may be packed before the first of them is unpacked. They have rooms of their own, in turn, so that
        no lock is needed.
    """

    def __init__(self, count: int):
        self._memory = mmap.mmap(-1, count * ROOM)
        self._count, self._packed = count, 0

    def pack(self, result: object) -> bytes:
        """Put the arrays of `result` into the next room; return the message that is to be sent for `unpack`."""
        packer = _Packer(self._memory, self._packed % self._count * ROOM)
        self._packed += 1
        return packer.message(result)

    def unpack(self, message: bytes) -> tuple[Any, int]:
        """Return the result, whose arrays belong to the caller, and the bytes of the message and the arrays."""
        unpacker = _Unpacker(message, self._memory)
        return unpacker.load(), len(message) + unpacker.size

    def close(self) -> None:
        """Give the memory back."""
        self._memory.close()


class _Packer(pickle.Pickler):
    """Writes arrays into the shared memory, as far as there is room, and all else into a message.

    The message is where the arrays lie, and then the result with the arrays' numbers instead of them.
    """

    def __init__(self, memory: mmap.mmap, room: int):
        self._text = io.BytesIO()
        super().__init__(self._text, pickle.HIGHEST_PROTOCOL)
        self._memory, self._free, self._end = memory, room, room + ROOM
        self._numbers: dict[int, int] = {}  # by id, for an array that occurs twice
        self._arrays: list[np.ndarray] = []  # which keep their ids
        self._places: list[tuple] = []  # offset, dtype and shape of each

    def message(self, result: object) -> bytes:
        """Return the message for `result`."""
        self.dump(result)
        return pickle.dumps(self._places, pickle.HIGHEST_PROTOCOL) + self._text.getbuffer()

    def persistent_id(self, obj: Any) -> int | None:
        """Number of an array that is in the memory; None for what the message holds."""
        if type(obj) is not np.ndarray or obj.dtype.hasobject or not obj.flags.c_contiguous or obj.size == 0:
            return None
        if id(obj) not in self._numbers and self._free + obj.nbytes <= self._end:
            self._numbers[id(obj)] = len(self._arrays)
            self._arrays.append(obj)
            self._places.append((self._free, obj.dtype, obj.shape))
            _array_at(self._memory, *self._places[-1])[...] = obj
            self._free += -(-obj.nbytes // _ALIGNMENT) * _ALIGNMENT
        return self._numbers.get(id(obj))


class _Unpacker(pickle.Unpickler):
    """Reads what a `_Packer` has written."""

    def __init__(self, message: bytes, memory: mmap.mmap):
        text = io.BytesIO(message)
        self._arrays = [_array_at(memory, *place).copy() for place in pickle.load(text)]
        self.size = sum(array.nbytes for array in self._arrays)
        super().__init__(text)

    def persistent_load(self, pid: int) -> np.ndarray:
        """Return an array by its number."""
        return self._arrays[pid]


def _array_at(memory: mmap.mmap, offset: int, dtype: np.dtype, shape: tuple[int, ...]) -> np.ndarray:
    return np.ndarray(shape, dtype, memory, offset)
