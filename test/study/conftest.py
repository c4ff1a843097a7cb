"""What the tests of all studies ask: what was written, and the one line with which bad words are refused."""

from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture
def refusal(tmp_path, capsys) -> Callable[..., str]:
    """The one line with which a study's `main` refuses its words, with exit code 2 and nothing written."""
    def call(main: Callable[[list[str]], int], *words: str) -> str:
        assert main([*words, "--output", str(tmp_path / "none")]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert not (tmp_path / "none").exists()
        return line
    return call


@pytest.fixture
def bytes_of() -> Callable[[Path], dict[str, bytes]]:
    """Names and bytes of all that a study has written into a folder."""
    return lambda folder: {str(file.relative_to(folder)): file.read_bytes()
                           for file in sorted(folder.rglob("*")) if file.is_file()}
