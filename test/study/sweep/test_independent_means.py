"""Means and spreads of a sweep beside those of an independent implementation, for guide angle, mass and crank."""

import math

import numpy as np
import pandas
import pytest
from independent_robot import speeds_of_starts

from vibro_ros.study.sweep.command import main

POINTS = [(50.0, 0.02, 0.08), (80.0, 0.02, 0.02), (80.0, 0.04, 0.08)]  # degrees, m, kg
STARTS, SETTLING, TURNS = 12, 4.0, 96


@pytest.mark.parametrize("rule", ["printed", "unilateral"])
@pytest.mark.parametrize("point", POINTS)
def test_means_are_within_two_standard_errors_and_spreads_within_a_factor(tmp_path, rule, point):
    """The same starts, chaotic: single runs differ, means and spreads do not. By chance one in twenty would be off."""
    guide, crank, mass = point
    words = ["--scene", "paper", "--vary", f"guide.angle={math.radians(guide)!r}", "--set", f"crank.radius={crank}",
             "--set", f"mass.inclined={mass}", "--set", f"effects.normal_force={rule}", "--starts", "48",
             "--settling", str(SETTLING), "--duration", str(TURNS * 2.0 * math.pi / 100.0 + 1e-3)]
    assert main([*words, "--output", str(tmp_path)]) == 0
    ours = pandas.read_parquet(tmp_path / "blocks")["mean_speed"].to_numpy()
    theirs = speeds_of_starts(math.radians(guide), crank, mass, rule == "printed", STARTS, SETTLING, TURNS)
    error = math.hypot(*(np.std(one, ddof=1) / math.sqrt(len(one)) for one in (ours, theirs)))
    assert abs(ours.mean() - theirs.mean()) < 2.0 * error
    assert 0.4 < np.std(theirs, ddof=1) / np.std(ours, ddof=1) < 2.5
