"""Generated text in a document, between two marks."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def given_file(path: Path) -> Iterator[None]:
    """Context manager that turns an OSError of the file that the command line names into a ValueError (bad input)."""
    try:
        yield
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror or error}") from error


def replaced(document: str, begin: str, end: str, text: str) -> str:
    """Replace the text between the lines `begin` and `end` (ValueError unless each occurs once, in this order)."""
    head, found_begin, rest = document.partition(begin)
    _, found_end, tail = rest.partition(end)
    if not (found_begin and found_end) or begin in rest or end in tail:
        raise ValueError(f"the table's place is not marked; write '{begin}' and '{end}' once each")
    return f"{head}{begin}\n{text}\n{end}{tail}"


def write_between(file: Path, begin: str, end: str, text: Callable[[], str]) -> None:
    """Write the result of `text` between the marks of `file`; `text` is called after the marks were found.

    ValueError if the file cannot be read or written, or lacks the marks; the message names the file.
    """
    with given_file(file):
        document = file.read_text(encoding="utf-8")
        try:
            replaced(document, begin, end, "")
        except ValueError as error:
            raise ValueError(f"{file}: {error}") from error
        file.write_text(replaced(document, begin, end, text()), encoding="utf-8")
