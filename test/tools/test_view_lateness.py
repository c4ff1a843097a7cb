"""The measurement of what the live view costs: a real robot, a real view, and pages that read."""

import pytest


@pytest.mark.quiet
def test_a_view_with_pages_is_started_and_ended_and_both_are_told(start, domain_id, tmp_path):
    measurement = start("view_lateness", "--rounds", "1", "--length", "1", "--pages", "2")
    assert measurement.end(120.0) == 0, measurement.text
    rows = [line.split("|")[1:5] for line in measurement.lines if line.startswith("|")]
    assert [row[1].strip() for row in rows[:1]] == ["without 2 pages"]
    assert [row[0].strip() for row in rows[2:]] == ["median [µs]", "p99 [µs]", "max [µs]"]
    assert all(float(cell) > 0.0 for row in rows[2:] for cell in row[1:])
    assert list(tmp_path.iterdir()) == []
