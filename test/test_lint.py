"""`make lint` finds what ruff does not look for."""

import subprocess
from pathlib import Path

import pytest

MAKEFILE = Path(__file__).resolve().parents[1] / "Makefile"


def looked_for_marks(folder: Path) -> subprocess.CompletedProcess:
    return subprocess.run(["make", "--no-print-directory", "-f", str(MAKEFILE), "conflict-markers"], cwd=folder,
                          capture_output=True, text=True, timeout=60)


def test_no_merge_has_left_its_marks():
    done = looked_for_marks(MAKEFILE.parent)
    assert (done.returncode, done.stdout) == (0, "")


@pytest.mark.parametrize("line", ["<" * 7 + " HEAD", "=" * 7, ">" * 7 + " a branch", "|" * 7 + " 1d3b5", "<" * 7])
@pytest.mark.parametrize("name", ["docs/page.md", "code.py", "words", ".hidden/robot.yaml"])
def test_the_marks_of_a_merge_are_found(tmp_path, name, line):
    file = tmp_path / name
    file.parent.mkdir(exist_ok=True)
    file.write_text(f"before\n{line}\nafter\n")
    done = looked_for_marks(tmp_path)
    assert done.returncode != 0
    assert f"{name}:2:{line}" in done.stdout


@pytest.mark.parametrize("line", ["=" * 8, "<" * 8, " " + "<" * 7, "a " + "=" * 7, "<" * 7 + "<!-- a comment -->"])
def test_other_lines_are_none(tmp_path, line):
    (tmp_path / "page.md").write_text(f"{line}\n")
    assert looked_for_marks(tmp_path).returncode == 0
