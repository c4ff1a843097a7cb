"""Text in a document that a program writes, between two marks."""

from collections.abc import Callable
from pathlib import Path

from vibro_ros.process.front_door import given_file


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
