"""`study paper` as its users have it: done, stopped, gone on with, and given what it cannot use."""

import os
import sys

import pytest

from research.paper import command
from research.paper.readings import Reading
from research.paper.runs import Effort
from vibro_ros.study.study import main

SMALL = Effort(tuple(Reading("rkfixed", 1e-3, "misprint", "printed", start, "eq5") for start in ("zero", "rest")), 2, 3)


@pytest.fixture
def small(monkeypatch):
    """A study of a second, whose page and pictures are not made: they need readings by `exact`."""
    monkeypatch.setattr(command, "quick_effort", lambda: SMALL)
    monkeypatch.setattr(command, "written", lambda *_: "text\n")
    monkeypatch.setattr(command, "draw_figures", lambda folder: iter(()))


def run(tmp_path):
    return main(["paper", "--quick", "--output", str(tmp_path / "out")])


def test_a_study_leaves_rows_verdicts_and_text(small, tmp_path, capsys):
    assert run(tmp_path) == 0
    files = capsys.readouterr().out.split()
    assert [name.rpartition("/")[2] for name in files] == ["rows.csv", "verdicts.csv", "paper.md"]
    assert (tmp_path / "out" / "paper.md").read_text() == "text\n"


def test_a_stopped_study_keeps_its_rows_and_goes_on_to_the_same_bytes(small, tmp_path, monkeypatch, capsys):
    """Stopped after each number of batches in turn."""
    assert run(tmp_path / "whole") == 0
    computed = command.run_batches

    def stopped_after(count):
        def some(wanted):
            for number, found in enumerate(computed(wanted)):
                if number == count:
                    raise KeyboardInterrupt
                yield found

        return some

    for count in (0, 1, 7):
        monkeypatch.setattr(command, "run_batches", stopped_after(count))
        assert run(tmp_path) == 130
        assert "the same command goes on from" in capsys.readouterr().err
    assert len((tmp_path / "out" / "rows.csv").read_text().splitlines()) == 2 + 3 * 8
    monkeypatch.setattr(command, "run_batches", computed)
    assert run(tmp_path) == 0
    for name in ("rows.csv", "verdicts.csv"):
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "whole" / "out" / name).read_bytes()


def test_a_finished_study_computes_nothing_again(small, tmp_path, monkeypatch):
    assert run(tmp_path) == 0
    monkeypatch.setattr(command, "run_batches", lambda wanted: pytest.fail("computed again"))
    assert run(tmp_path) == 0


def test_rows_of_another_study_are_refused_in_one_line(small, tmp_path, capsys):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "rows.csv").write_text("mine\n")
    assert run(tmp_path) == 2
    assert capsys.readouterr().err.splitlines()[-1].endswith("remove the file, or give another --output")
    assert (tmp_path / "out" / "rows.csv").read_text() == "mine\n"


@pytest.mark.parametrize("what", ["file", "under a file", "not writable", "rows are a folder",
                                  "rows are a pipe", "rows are a broken link"])
def test_an_output_that_cannot_be_written_is_refused_in_one_line(small, tmp_path, capsys, what):
    folder = tmp_path / "out"
    if what == "not writable":
        if os.geteuid() == 0:
            pytest.skip("root may write anywhere")
        folder.mkdir(mode=0o500)
    elif what == "rows are a folder":
        (folder / "rows.csv").mkdir(parents=True)
    elif what == "rows are a pipe":
        folder.mkdir()
        os.mkfifo(folder / "rows.csv")
    elif what == "rows are a broken link":
        folder.mkdir()
        (folder / "rows.csv").symlink_to(tmp_path / "nowhere")
    else:
        folder.write_text("a file")
        folder = folder / "below" if what == "under a file" else folder
    code = main(["paper", "--quick", "--output", str(folder)])
    lines = capsys.readouterr().err.splitlines()
    assert code in (1, 2) and len(lines) == 1 and lines[0].startswith("study: ") and str(folder) in lines[0]


@pytest.mark.parametrize("words", [["--slow"], ["--quick", "1"], ["--output"]])
def test_wrong_words_are_refused(words, capsys):
    assert main(["paper", *words]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_the_study_needs_no_package_of_the_extra(monkeypatch):
    """None of requirements-study.txt is imported."""
    for package in ("pyarrow", "cma", "SALib", "distributed", "pandas"):
        monkeypatch.setitem(sys.modules, package, None)
    for name in [name for name in sys.modules if name.startswith("research.paper")]:
        monkeypatch.delitem(sys.modules, name)
    from research.paper import command as anew

    assert anew.full_effort().exact_starts > 1
