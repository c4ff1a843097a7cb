"""`make bench` prints its table, from a short run."""

import math
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
    values = [[float(cell.split()[0]) for cell in row[1:]] for row in table[2:]]
    for exact, set_up, heyoka, rk4, segments, event, tick in values:
        # A cost is a difference of two times: over 0.05 s on a busy computer it may have either sign.
        assert all(map(math.isfinite, (exact, set_up, rk4, event)))
        assert math.isfinite(heyoka) is bool(find_spec("heyoka"))
        assert segments > 0.0 and tick > 0.0
