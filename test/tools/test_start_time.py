"""The measurement of starts: real processes are heard, and medians shown."""

from pathlib import Path

import pytest

from tools.start_time import BARE, PYTHON, ROBOT, Starts, table
from vibro_ros.ros.node import process


@pytest.mark.parametrize("what", [ROBOT, BARE, PYTHON])
def test_a_start_is_timed_until_its_end(what, compiled, domain_id, tmp_path):
    with process.node_running("start_time", []) as (node, executor):
        starts = Starts(node, executor, tmp_path)
        first, second = starts.seconds(what), starts.seconds(what)
    assert min(first, second) > 0.02  # [s] an interpreter alone takes as long; the second does not hear the first
    assert len(list(tmp_path.glob("vibro_robot_*"))) == (2 if what == ROBOT else 0)


def test_a_process_that_ends_instead_is_an_error(compiled, domain_id, tmp_path):
    with process.node_running("start_time", []) as (node, executor), \
            pytest.raises(RuntimeError, match="the robot, until its first odometry: it has ended, and says why above"):
        Starts(node, executor, Path("/proc/none")).seconds(ROBOT)


def test_a_bad_argument_is_one_line(start):
    measuring = start("start_time", "--rounds", "0")
    assert measuring.end() == 2
    assert measuring.lines == ["start_time: --rounds: 0 is too few; give 1 or more"]


def test_medians_are_shown():
    shown = table({"the robot": ([14.0, 30.0, 13.0], [1.0, 1.04, 5.0]), "a node": ([], [0.2])})
    assert shown.splitlines()[2:] == ["| the robot | 14.0 s | 1.0 s |", "| a node | - | 0.2 s |"]
