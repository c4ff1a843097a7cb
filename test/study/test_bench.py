"""What `make bench` prints."""

import re
from pathlib import Path

import numpy as np
import pytest

from vibro_ros import load_scene
from vibro_ros.study import bench


def test_the_table_has_a_row_a_scene_and_a_cell_a_column(monkeypatch, capsys):
    monkeypatch.setattr(bench, "_MANY", 4)
    bench.main(["--duration", "0.05", "--repeats", "1"])
    lines = capsys.readouterr().out.splitlines()
    table = [re.split(r" *\| *", line.strip("|")) for line in lines if line.startswith("|")]
    assert [row[0].strip() for row in table] == ["scene", "---", *(f"`{name}`" for name in bench.SCENES)]
    assert {len(row) for row in table} == {len(bench.COLUMNS)}
    assert all(float(cell.split()[0]) > 0.0 for row in table[2:] for cell in row[1:])
    last = r"`simulate_many`, 4 scenes of 2 s: two workers are \d+\.\d\d times as fast as one\."
    assert re.fullmatch(last, lines[-1])


@pytest.mark.parametrize("name", bench.SCENES)
def test_every_scene_is_driven(name):
    """A bench of a machine at rest would measure nothing."""
    samples, events = bench.run_exact(load_scene(name), np.linspace(0.0, 1.0, 201))
    assert samples.motor_speed[-1] == 100.0
    assert samples.crank_angle[-1] > 70.0
    assert len(events) > 30


def test_readme_has_what_the_bench_prints():
    """The same columns, and a line for `simulate_many`, as copied."""
    text = (Path(__file__).resolve().parents[2] / "README.md").read_text(encoding="utf-8")
    table = text.partition("<!-- bench: copied from `make bench` -->\n")[2].partition("<!-- end of bench")[0]
    assert table.startswith(bench.heading() + "\n| `unilateral` |")
    assert re.search(r"^`simulate_many`, 200 scenes of 2 s: two workers are \d\.\d\d times", table, re.MULTILINE)
