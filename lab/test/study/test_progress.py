"""Progress of a study: one remaining time at a time."""

from vibro_lab.study import command
from vibro_lab.study.command import Progress


def test_progress_within_another_one_is_silent(monkeypatch, capsys):
    """A search counts robots while the tables of its groups count points; two remaining times would contradict."""
    monkeypatch.setattr(command, "_LINE_PERIOD", 0.0)
    for _ in range(2):
        with Progress("search", "robot", 4) as outer:
            for _ in range(2):
                with Progress("robots", "point", 3) as inner:
                    inner.add(3)
                outer.add(1)
        with Progress("choice", "robot", 1) as alone:
            alone.add(1)
    lines = capsys.readouterr().err.splitlines()
    assert [line.partition(" of ")[0].removeprefix("study: ") for line in lines] == 2 * [
        "search: 1", "search: 2", "choice: 1"]
