"""Starts that differ, and a file of rows that can be cut anywhere."""

import random

import numpy as np
import pytest

import vibro_ros
from research.paper import runs, worksheet
from research.paper.readings import Point, Reading, exact_readings, instants, points, worksheet_readings
from research.paper.runs import NEAR, Batch, Effort, RowFile, advance, batches, displacements, run_batches

REST = Reading("exact", 0.0, "corrected", "printed", "rest", "eq5")
COARSE = Reading("rkfixed", 1e-3, "misprint", "printed", "zero", "eq5")
SMALL = Effort((COARSE, COARSE._replace(start="rest")), 2, 3)


def test_the_first_start_is_the_named_one_and_the_others_are_near_it():
    assert advance("zero", 0) == advance("rest", 0) == 0.0
    ahead = [advance("rest", number) for number in range(1, 200)]
    assert 0.0 < min(ahead) and max(ahead) < NEAR and len(set(ahead)) == len(ahead)
    scene = REST.scene(Point("angle", 80.0))
    named = vibro_ros.Simulator(scene).sample(np.array(instants(REST))).body_position
    np.testing.assert_array_equal(displacements(Batch(REST, Point("angle", 80.0), 1))[0], named)


def test_a_phase_is_where_the_upper_slider_moves():
    phases = np.array([advance("phase", number) for number in range(400)])
    assert (np.cos(phases) > 0.0).all() and (np.sin(phases) > 0.9).any() and (np.sin(phases) < -0.9).any()


@pytest.mark.parametrize("start", ["zero", "rest", "phase"])
def test_starts_of_a_crank_as_long_as_its_rods_differ(start):
    """From the first second on."""
    found = displacements(Batch(REST._replace(start=start), Point("crank", 0.06), 6))[:, 0]
    assert np.min(np.abs(np.subtract.outer(found, found)) + np.eye(6)) > 1e-6


def test_masses_at_rest_on_a_slider_that_stands_still_make_copies():
    """With φ = 80° both sliders stand at 0 from 170° to 270°: a robot 0.3 rad on does the same 3 ms sooner."""
    scene, times = REST._replace(start="zero").scene(Point("crank", 0.06)), np.array([0.05, 0.06])
    first = worksheet.rkfixed(scene, "eq5", 3.3, 1e-5, times + 0.003)
    np.testing.assert_allclose(worksheet.rkfixed(scene, "eq5", 3.6, 1e-5, times), first, rtol=1e-6)
    assert np.abs(worksheet.rkfixed(scene, "eq5", 0.3, 1e-5, times) - first).max() > 1e-4


def test_every_reading_is_there_once():
    readings = [*exact_readings(), *worksheet_readings()]
    assert len(set(readings)) == len(readings)
    assert {reading.normal_force for reading in readings} == {"printed", "unilateral", "weight", "hop"}
    assert len(batches(runs.full_effort())) == len(readings) * len(list(points()))


def written(path, effort, stop=None):
    """Run a study into `path`, from what is there; `stop` batches at most."""
    rows = RowFile(path, effort)
    first = len(rows.done())
    wanted = batches(effort)[first:]
    found = rows.append(run_batches(wanted), first)
    for _ in range(len(wanted) if stop is None else stop):
        next(found)
    found.close()


def test_a_file_cut_anywhere_is_completed_to_the_same_bytes(tmp_path):
    written(tmp_path / "whole.csv", SMALL)
    whole = (tmp_path / "whole.csv").read_bytes()
    draw = random.Random(1)
    for cut in [0, 5, *(draw.randrange(len(whole)) for _ in range(4)), len(whole) - 1]:
        path = tmp_path / "cut.csv"
        path.write_bytes(whole[:cut])
        written(path, SMALL)
        assert path.read_bytes() == whole, cut


def test_garbage_after_whole_batches_is_computed_anew(tmp_path):
    path = tmp_path / "rows.csv"
    written(path, SMALL, stop=4)
    kept = path.read_bytes()
    path.write_bytes(kept + b"rkfixed,0.001,misprint,printed,zero,eq5,angle,85.0,7,nonsense\n\xff\xfe")
    assert len(RowFile(path, SMALL).done()) == 4
    assert path.read_bytes() == kept


@pytest.mark.parametrize("text", ["someone's diary\n", "# study paper, 3 batches, 0123\n", "\x00"])
def test_a_file_of_another_study_is_refused_and_left_alone(tmp_path, text):
    path = tmp_path / "rows.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"rows of another study.* remove the file, or give another --output$"):
        RowFile(path, SMALL)
    assert path.read_text() == text
