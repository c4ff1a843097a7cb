"""Helpers for the tests of all studies: written files, and the line with which bad arguments are refused."""

from collections.abc import Callable
from pathlib import Path

import pytest
from browser_pages import browser, open_page, session, watch  # noqa: F401


@pytest.fixture
def refusal(tmp_path, capsys) -> Callable[..., str]:
    """Return the line with which a study's `main` refuses its arguments, with exit code 2 and nothing written."""
    def call(main: Callable[[list[str]], int], *words: str) -> str:
        assert main([*words, "--output", str(tmp_path / "none")]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert not (tmp_path / "none").exists()
        return line
    return call


@pytest.fixture
def bytes_of() -> Callable[[Path], dict[str, bytes]]:
    """Return names and bytes of all files that a study has written into a folder."""
    return lambda folder: {str(file.relative_to(folder)): file.read_bytes()
                           for file in sorted(folder.rglob("*")) if file.is_file()}
