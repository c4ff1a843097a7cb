"""Shares and entropies against closed forms and published numbers."""

import math

import numpy as np
import pytest

from vibro_ros.study.basins.attractors import basin_entropy, wilson


@pytest.mark.parametrize(("found", "of", "low", "high"), [
    (81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)])
def test_intervals_are_those_of_a_published_table(found, of, low, high):
    """A50. R. G. Newcombe, Stat. Med. 17 (1998) 857, table I, method 3."""
    share = wilson(found, of)
    assert share.share == found / of
    assert (share.low, share.high) == pytest.approx((low, high), abs=5e-5)


def test_an_interval_holds_the_truth_as_often_as_it_says():
    draw = np.random.default_rng(3)
    shares = [wilson(int(found), 300) for found in draw.binomial(300, 8 / 300, size=2000)]
    assert 0.93 < np.mean([share.low <= 8 / 300 <= share.high for share in shares]) < 0.98


def test_one_motion_has_no_entropy():
    entropy = basin_entropy(np.ones((20, 20), dtype=int), -1)
    assert entropy.entropy == 0.0 and entropy.mixed == 0 and math.isnan(entropy.boundary) and not entropy.fractal


def test_a_straight_boundary_has_the_entropy_of_its_boxes():
    """A51. Columns 0 to 6 lead to 1, the others to 2: of the boxes 5 to 9, two fifths are of one motion."""
    numbers = np.where(np.arange(20)[None, :] < 7, 1, 2) * np.ones((10, 1), dtype=int)
    entropy, mixed = basin_entropy(numbers, -1), -0.4 * math.log(0.4) - 0.6 * math.log(0.6)
    assert (entropy.boxes, entropy.mixed) == (8, 2)
    assert entropy.boundary == pytest.approx(mixed) and entropy.entropy == pytest.approx(mixed / 4.0)
    assert not entropy.fractal


def test_three_motions_in_every_box_are_more_than_log_2_and_so_fractal():
    numbers = np.random.default_rng(1).integers(1, 4, size=(100, 100))
    entropy = basin_entropy(numbers, -1)
    assert entropy.mixed == entropy.boxes == 400 and entropy.fractal
    assert math.log(2.0) < entropy.boundary < math.log(3.0)


def test_what_is_left_over_at_the_ends_is_left_out_and_a_small_grid_has_none():
    numbers = np.ones((12, 7), dtype=int)
    numbers[10:], numbers[:, 5:] = 2, 3
    assert basin_entropy(numbers, -1).entropy == 0.0 and basin_entropy(numbers, -1).boxes == 2
    assert basin_entropy(numbers[:4], -1) is None


def test_a_box_in_which_something_cannot_start_is_left_out():
    numbers = np.ones((5, 15), dtype=int)
    numbers[:, 3:7], numbers[2, 12] = -1, 2
    entropy = basin_entropy(numbers, -1)
    assert (entropy.boxes, entropy.mixed) == (1, 1) and entropy.entropy == entropy.boundary > 0.0
    assert basin_entropy(numbers[:, :10], -1) is None
