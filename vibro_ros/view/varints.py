"""Integers of very different sizes as few bytes: seven bits a byte, the lowest first, the eighth says that more follow.

A sign goes into the lowest bit: 0, -1, 1, -2, 2 ... become 0, 1, 2, 3, 4 ...
"""

import numpy as np

#: Bits that a byte carries, and bytes of the longest integer that is read.
_BITS, _LONGEST = 7, 8
#: Magnitudes of integers stay below this number: twice as much, with the sign, a browser's numbers count exactly.
LIMIT = 2**52


def encoded(numbers: np.ndarray) -> bytes:
    """The bytes of integers, shape (n,), of magnitudes below `LIMIT`."""
    if len(numbers) == 0:
        return b""
    folded = (numbers.astype(np.int64) << 1 ^ numbers.astype(np.int64) >> 63).astype(np.uint64)
    sizes = np.ones(len(folded), dtype=np.int64)
    for more in range(1, _LONGEST):
        sizes += folded >= np.uint64(1 << _BITS * more)
    ends = np.cumsum(sizes)
    place = np.arange(ends[-1]) - np.repeat(ends - sizes, sizes)  # of a byte in its integer
    parts = np.repeat(folded, sizes) >> (_BITS * place).astype(np.uint64) & np.uint64(0x7F)
    parts |= np.uint64(0x80)
    parts[ends - 1] &= np.uint64(0x7F)
    return parts.astype(np.uint8).tobytes()


def decoded(data: bytes | memoryview, count: int) -> np.ndarray:
    """The first `count` integers in some bytes, shape (count,).

    Raises
    ------
    ValueError
        If there are fewer, or one is longer than any that `encoded` writes.
    """
    parts = np.frombuffer(data, dtype=np.uint8)
    ends = np.flatnonzero(parts < 0x80)[:count]
    if len(ends) < count:
        raise ValueError(f"the bytes hold {len(ends)} integers, not {count}")
    if count == 0:
        return np.empty(0, dtype=np.int64)
    parts, starts = parts[:ends[-1] + 1], np.concatenate([[0], ends[:-1] + 1])
    sizes = ends + 1 - starts
    if sizes.max() > _LONGEST:
        raise ValueError(f"an integer is {sizes.max()} bytes long; there are none of more than {_LONGEST}")
    place = np.arange(len(parts)) - np.repeat(starts, sizes)
    folded = np.add.reduceat((parts & 0x7F).astype(np.int64) << _BITS * place, starts)
    return folded >> 1 ^ -(folded & 1)
