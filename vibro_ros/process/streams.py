"""Standard streams that no terminal, pipe or encoding can break.

A reader that has gone, be it `head` or a closed terminal, must not end a robot that seals its bag, nor a `recover` at
the first of its bags: what nobody reads is dropped. What an encoding lacks is written as `\\u03c6`.
"""

import errno
import io
import os
import sys
from typing import Any

NOBODY_READS = {errno.EPIPE, errno.EIO, errno.ECONNRESET}
"""Errors of a pipe without reader, a terminal that was closed, and a connection that broke."""
NAMES = ("standard input", "standard output", "standard error")


class Forgiving(io.FileIO):
    """A file descriptor to which writing succeeds also when nobody reads any more.

    Any other error, such as that of a full disk, is raised once; what comes later is dropped.
    """

    def __init__(self, descriptor: int):
        super().__init__(descriptor, "w", closefd=False)
        self._dropping = False

    def write(self, data: Any) -> int:
        """Write `data`; the number of bytes written, or dropped."""
        try:
            return memoryview(data).nbytes if self._dropping else super().write(data)
        except OSError as error:
            self._dropping = True
            if error.errno in NOBODY_READS:
                return memoryview(data).nbytes
            raise OSError(error.errno, error.strerror, NAMES[self.fileno()]) from None


def open_streams() -> None:
    """Set `sys.stdout` and `sys.stderr` anew, and take every closed standard descriptor.

    A descriptor below 3 that is left closed goes to the next file that is opened: a log line would land in a bag.
    """
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest free number, which is this one
    sys.stdout = _stream(1, sys.stdout)
    sys.stderr = _stream(2, sys.stderr)


def _stream(descriptor: int, before: Any) -> io.TextIOWrapper:
    file = io.BufferedWriter(Forgiving(descriptor))
    encoding = before.encoding if before else "utf-8"
    return io.TextIOWrapper(file, encoding, errors="backslashreplace",
                            line_buffering=descriptor == 2 or os.isatty(descriptor))
