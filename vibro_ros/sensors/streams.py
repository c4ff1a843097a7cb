"""Random numbers by counting: the k-th number of a stream is a function of the seed, the stream's name and k alone.

So no stream depends on another, on the instants at which somebody asks, or on how time is cut up. The generator is
Philox 4x64 (J. Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", 2011), as numpy has it.
"""

import hashlib
from collections.abc import Callable

import numpy as np

BLOCK = 128
"""Samples whose numbers are made together: a call of numpy costs as much as some hundred of them."""
LANES = 4
"""Numbers of a sample: those that Philox makes of one counter."""
_WHOLE = 1 << 256


def philox(key: int, counter: int, count: int) -> np.ndarray:
    """What Philox 4x64-10 makes of `counter` and of those that follow it, shape (count, 4) of uint64.

    Parameters
    ----------
    key : int
        128 bits, the first word lowest.
    counter : int
        256 bits, the first word lowest.
    count : int
        Number of counters.
    """
    generator = np.random.Philox(key=key, counter=(counter - 1) % _WHOLE)  # which counts first
    return generator.random_raw(LANES * count).reshape(count, LANES)


class Stream:
    """Random numbers of one kind, by blocks of samples.

    Parameters
    ----------
    seed : int
        Of all streams.
    name : str
        Of this one.
    """

    def __init__(self, seed: int, name: str):
        self._key = int.from_bytes(hashlib.blake2b(f"{seed}/{name}".encode(), digest_size=16).digest(), "little")
        self._walked, self._walk = 0, np.zeros(LANES)  # the sum of all normal numbers before this block

    def uniform(self, block: int) -> np.ndarray:
        """Numbers between 0 and 1, neither of them included, shape (BLOCK, LANES): row k of sample block BLOCK + k."""
        return ((philox(self._key, block * BLOCK, BLOCK) >> np.uint64(11)) + 0.5) * 2.0**-53

    def normal(self, block: int) -> np.ndarray:
        """Numbers of the standard normal distribution, made of the uniform ones; shape (BLOCK, LANES)."""
        from scipy.special import ndtri  # a tenth of a second, which a robot without sensors need not wait

        return ndtri(self.uniform(block))

    def walk(self, block: int) -> np.ndarray:
        """The sum of the normal numbers of all earlier samples, none left out; shape (BLOCK, LANES)."""
        if block < self._walked:
            self._walked, self._walk = 0, np.zeros(LANES)
        while True:
            sums = np.cumsum(np.vstack([self._walk, self.normal(self._walked)]), axis=0)
            if self._walked == block:
                return sums[:-1]
            self._walked, self._walk = self._walked + 1, sums[-1]


class Rows:
    """Numbers of one sample after the other, of blocks that are made when they are needed.

    Parameters
    ----------
    made : callable
        Makes the block of a number, shape (BLOCK, n).
    """

    def __init__(self, made: Callable[[int], np.ndarray]):
        self._made, self._block, self._rows = made, -1, [[0.0]]

    def __getitem__(self, index: int) -> list[float]:
        """Those of a sample."""
        block, place = divmod(index, BLOCK)
        if block != self._block:
            self._block, self._rows = block, self._made(block).tolist()
        return self._rows[place]
