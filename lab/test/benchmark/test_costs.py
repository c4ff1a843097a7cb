"""`make bench` prints its table, from a short run."""

import re
from importlib.util import find_spec

from benchmark import costs


def test_the_table_has_a_row_a_scene_and_a_cell_a_column(monkeypatch, capsys):
    monkeypatch.setattr(costs, "SCENES", ("no_impact", "machine"))
    costs.main(["--duration", "0.05", "--repeats", "1", "--many", "4"])
    lines = capsys.readouterr().out.splitlines()
    table = [re.split(r" *\| *", line.strip("|")) for line in lines if line.startswith("|")]
    assert [row[0].strip() for row in table] == ["scene", "---", "`no_impact`", "`machine`"]
    assert {len(row) for row in table} == {len(costs.COLUMNS)}
    heyoka, set_ups = ([row.pop(place) for row in table[2:]] for place in (3, 2))
    assert all(float(cell.split()[0]) > 0.0 for row in table[2:] for cell in row[1:])
    assert all(float(cell) >= 0.0 for cell in set_ups)
    assert all(float(cell) > 0.0 for cell in heyoka) if find_spec("heyoka") else set(heyoka) == {"nan"}
