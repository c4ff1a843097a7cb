"""What `make bench` prints."""

import re
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from tools import bench, bench_runs
from vibro_ros import load_scene
from vibro_ros.accuracy.timing import typical_seconds


def test_the_table_has_a_row_a_scene_and_a_cell_a_column(monkeypatch, capsys):
    monkeypatch.setattr(bench, "_MANY", 4)
    bench.main(["--duration", "0.05", "--repeats", "1"])
    lines = capsys.readouterr().out.splitlines()
    table = [re.split(r" *\| *", line.strip("|")) for line in lines if line.startswith("|")]
    assert [row[0].strip() for row in table] == ["scene", "---", *(f"`{name}`" for name in bench.SCENES)]
    assert {len(row) for row in table} == {len(bench.COLUMNS)}
    peer = [row.pop(2) for row in table[2:]]
    assert all(float(cell.split()[0]) > 0.0 for row in table[2:] for cell in row[1:])
    assert all(float(cell) > 0.0 for cell in peer) if find_spec("heyoka") else set(peer) == {"-"}
    compiled = r"A scene with another guide angle is compiled in \d+\.\d\d ms \(`no_impact`\), .*\(`device`\)\."
    assert re.fullmatch(compiled, lines[-4])
    shares = (r"The first 0\.2 s of `device` cost \d\.\d{3} of RK4's\. With the energy audit `device` costs \d+\.\d\d "
              r"of what it costs without, with the energy accounts \d+\.\d\d\. Of a run, -?\d+ % \(`no_impact`\), .* "
              r"goes into its samples\.")
    assert re.fullmatch(shares, lines[-6])
    unequal = (r"If every tenth run takes ten times as long, two workers of `simulate_many` are \d+\.\d\d times as "
               r"fast as one; two processes that share nothing, \d+\.\d\d times\.")
    assert re.fullmatch(unequal, lines[-2])
    last = (r"`simulate_many`, 4 scenes of 0\.05 s: two workers are \d+\.\d\d times as fast as one; "
            r"two processes that share nothing, \d+\.\d\d times\.")
    assert re.fullmatch(last, lines[-1])


def test_the_numbers_come_with_versions_and_cores(capsys, monkeypatch):
    monkeypatch.setattr(bench, "SCENES", ())
    monkeypatch.setattr(bench, "measure_many", lambda *_: (1.0, 1.0))
    monkeypatch.setattr(bench, "about_shares", lambda *_: "")
    bench.main([])
    version = r"\d+\.\d+\.\d+"
    assert re.fullmatch(rf"Python {version}, numpy {version}, numba {version}, (heyoka {version}|no heyoka); "
                        r"\w+, \d+ cores", capsys.readouterr().out.splitlines()[1])


def test_the_baselines_own_error_is_told():
    """The least and the largest of the scenes; against the positions of exact, with the motor running."""
    off = {name: bench_runs.baseline_error(load_scene(name)) for name in bench.SCENES}
    assert 1e-9 < min(off.values()) < max(off.values()) < 1e-3
    least, worst = min(off, key=off.get), max(off, key=off.get)
    assert f"off by {off[least]:.1e} m ({least}) to {off[worst]:.1e} m ({worst}) within" in bench.about_the_baseline()


def test_exact_costs_more_where_it_is_sampled_more_often():
    """Why the diagrams' costs differ from this table's: five times as many samples, at least a fifth more time."""
    scene = load_scene("no_impact")
    costs = [typical_seconds(lambda rate=rate: bench_runs.run_exact(scene, np.arange(round(2 * rate)) / rate))
             for rate in (200.0, 1000.0)]
    assert costs[1] > 1.2 * costs[0]


def test_without_heyoka_its_cell_is_a_dash_and_the_others_are_there(monkeypatch, capsys):
    for module in [name for name in sys.modules if name.startswith("vibro_ros.peer")]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "heyoka", None)  # as if it were not installed
    values = bench.measure("no_impact", 0.05, 1)
    assert values["heyoka"] == "-"
    assert values["ratio"] > 0.0
    assert re.match("bench: no_impact without heyoka: .*heyoka", capsys.readouterr().err)


def test_a_scene_that_heyoka_fails_at_has_a_dash(monkeypatch, capsys):
    def failing(scene):
        raise RuntimeError("heyoka missed the upper plate")

    monkeypatch.setattr(bench, "compiled_peer", failing)
    assert bench.measure("no_impact", 0.05, 1)["heyoka"] == "-"
    assert capsys.readouterr().err == "bench: no_impact without heyoka: heyoka missed the upper plate\n"


@pytest.mark.parametrize("name", bench.SCENES)
def test_heyoka_runs_the_same(name):
    """Within 1e-9 m over 0.3 s: a step is right to 1e-9 of some cm, 1e-11 m, and some ten impacts magnify that."""
    pytest.importorskip("heyoka", reason="heyoka, the extra `bench`, has no wheel for Python 3.10")
    times = np.arange(61) / 200.0
    exact, _ = bench_runs.run_exact(load_scene(name), times)
    places = np.array([exact.upper_position, exact.inclined_position, exact.body_position]).T
    found = bench.compiled_peer(load_scene(name))(times)[:, [0, 2, 4]]
    assert np.abs(found - places).max() < 1e-9
    assert np.ptp(places, axis=0).max() > 1e-3  # m: it moves


@pytest.mark.parametrize("name", bench.SCENES)
def test_every_scene_is_driven(name):
    """A bench of a machine at rest would measure nothing."""
    samples, events = bench_runs.run_exact(load_scene(name), np.linspace(0.0, 1.0, 201))
    assert samples.motor_speed[-1] == 100.0
    assert samples.crank_angle[-1] > 70.0
    assert len(events) > 30


def test_readme_has_what_the_bench_prints():
    """The same columns, and a line for `simulate_many`, as copied."""
    text = (Path(__file__).resolve().parents[2] / "README.md").read_text(encoding="utf-8")
    table = text.partition("<!-- bench: copied from `make bench` -->\n")[2].partition("<!-- end of bench")[0]
    assert table.startswith(bench.heading() + "\n| `unilateral` |")
    many = rf"^`simulate_many`, {bench._MANY} scenes of 10 s: two workers are \d\.\d\d times"
    assert re.search(many, table, re.MULTILINE)
