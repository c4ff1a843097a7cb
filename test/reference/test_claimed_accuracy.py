"""README's number of the simulator's accuracy is true."""

import json
import re
from pathlib import Path

from comparison import FOLDER, errors

README = Path(__file__).resolve().parents[2] / "README.md"


def test_no_stored_run_is_missed_by_more_than_the_readme_says():
    text = " ".join(README.read_text(encoding="utf-8").split())
    claimed = re.search(r"Against (\d+) stored runs .* no position is off by more than (\S+) m", text)
    tables = [json.loads(path.read_text()) for path in FOLDER.glob("*.json")]
    assert len(tables) == int(claimed[1])
    assert max(max(errors(table).values()) for table in tables) <= float(claimed[2])
