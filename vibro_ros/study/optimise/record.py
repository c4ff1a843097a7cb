"""What a search has evaluated, in a file from which the search goes on as if it had never been stopped.

A search proposes candidates in groups; which ones depends on its seed and on the scores of those before. So the file
holds no state of the search: whoever goes on with a search runs it from the beginning and gives it the recorded values
for as long as there are some. The file is JSON Lines: the first line says of what search it is, each other one holds a
group, on disk before the search goes on. What a kill leaves of a last line is cut off.
"""

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vibro_ros.process.untrusted import content, opened, replace_file, write_all
from vibro_ros.study.locked_folder import lock

#: Largest file that is read [B]: a million candidates with 17 coordinates and 4 starts.
LARGEST = 10**9


class Record:
    """The groups of one search.

    Parameters
    ----------
    path : Path
        The file; made if there is none.
    search : mapping
        What the search depends on, of numbers, texts, and lists and mappings of these.

    Raises
    ------
    ValueError
        If the file is another search's, no record at all, damaged before its end, or in use.
    OSError
        If it cannot be read or written.
    """

    def __init__(self, path: Path, search: Mapping[str, object]):
        self._path, self._head = path, _line({"search": search})
        if not os.path.lexists(path):
            replace_file(path, self._head)
        self._descriptor = opened(path, os.O_RDWR | os.O_APPEND, follow=False)
        try:
            lock(self._descriptor, path)
            self._groups = self._read()
        except BaseException:
            os.close(self._descriptor)
            raise

    @property
    def evaluations(self) -> int:
        """Number of candidates in the groups that it held when it was opened."""
        return sum(len(points) for points, _ in self._groups)

    def recorded(self, number: int, points: np.ndarray) -> np.ndarray | None:
        """Values of the group `number`, from 0, which has to be of `points`; None if there is no such group.

        Raises
        ------
        ValueError
            If the group is of other candidates.
        """
        if number >= len(self._groups):
            return None
        known, values = self._groups[number]
        if not np.array_equal(known, points):
            raise ValueError(f"{self._path}: its group {number} is of other candidates than this version proposes on "
                             "this machine; give another --output")
        return values

    def append(self, points: np.ndarray, values: np.ndarray) -> None:
        """Write a group: shape (n, dimension) and (n, starts, measures); on disk before it returns (OSError)."""
        rows = [[[number if math.isfinite(number) else None for number in start] for start in one]
                for one in values.tolist()]
        write_all(self._descriptor, _line({"points": points.tolist(), "values": rows}))
        os.fdatasync(self._descriptor)

    def close(self) -> None:
        """Let another search have the file."""
        os.close(self._descriptor)

    def _read(self) -> list[tuple[np.ndarray, np.ndarray]]:
        data = content(self._path, LARGEST, follow=False)
        whole = data[:data.rfind(b"\n") + 1]
        head, *lines = whole.splitlines(keepends=True) or [b""]
        if head != self._head:
            raise ValueError(f"{self._path}: is not the record of this search, but of one with other options, another "
                             "scene or another version; give another --output, or delete it")
        if len(whole) < len(data):
            os.ftruncate(self._descriptor, len(whole))
        return [self._group(number, line) for number, line in enumerate(lines)]

    def _group(self, number: int, line: bytes) -> tuple[np.ndarray, np.ndarray]:
        try:
            group: Any = json.loads(line)
            points = np.array(group["points"], dtype=float)
            values = np.array(group["values"], dtype=float)  # None becomes NaN
        except (ValueError, TypeError, KeyError, RecursionError, OverflowError):
            points = values = np.empty(0)
        if points.ndim != 2 or values.ndim != 3 or len(points) != len(values) or not np.isfinite(points).all():
            raise ValueError(f"{self._path}: line {number + 2} is no group of candidates; delete this line and all "
                             "after it, or give another --output")
        return points, values


def _line(content: Mapping[str, object]) -> bytes:
    return (json.dumps(content, allow_nan=False, sort_keys=True, ensure_ascii=True) + "\n").encode()
