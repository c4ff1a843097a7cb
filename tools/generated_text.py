"""Text in a document that a program writes, between two marks."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def given_file(path: Path) -> Iterator[None]:
    """Raise an OSError about the file that the command line names as the ValueError that bad input is."""
    try:
        yield
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror or error}") from error


def replaced(document: str, begin: str, end: str, text: str) -> str:
    """`document` with what stands between the lines `begin` and `end` replaced by `text`.

    Raises
    ------
    ValueError
        If the marks are not there, once each and in order.
    """
    head, found_begin, rest = document.partition(begin)
    _, found_end, tail = rest.partition(end)
    if not (found_begin and found_end) or begin in rest or end in tail:
        raise ValueError(f"the table's place is not marked; write '{begin}' and '{end}' once each")
    return f"{head}{begin}\n{text}\n{end}{tail}"


def write_between(file: Path, begin: str, end: str, text: Callable[[], str]) -> None:
    """Write what `text` returns between the marks of `file`; it is called when the file is known to have them.

    Raises
    ------
    ValueError
        Naming the file, if it cannot be read or written or has no such marks.
    """
    with given_file(file):
        document = file.read_text(encoding="utf-8")
        try:
            replaced(document, begin, end, "")
        except ValueError as error:
            raise ValueError(f"{file}: {error}") from error
        file.write_text(replaced(document, begin, end, text()), encoding="utf-8")
