"""What the command lines of all executables share."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line, said by `front_door.exit_code`."""

    def error(self, message: str) -> NoReturn:
        """Raise `message` as the ValueError that bad input is everywhere else."""
        raise ValueError(f"{message}; `{self.prog} --help` shows what there is")


@contextmanager
def given_file(path: Path) -> Iterator[None]:
    """Raise an OSError about the file that the command line names as the ValueError that bad input is."""
    try:
        yield
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror or error}") from error
