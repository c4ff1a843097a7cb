"""The picture shows the recording's own numbers."""

import numpy as np
import pytest

from vibro_ros.bag.reader import read_bag
from vibro_ros.study import plots
from vibro_ros.study.plots import MOMENT, plot_run


@pytest.fixture
def bag(record_run):
    return read_bag(record_run(gap=(1.0, 1.2)))


@pytest.fixture
def axes(bag):
    return np.array(plot_run(bag).axes).reshape(4, 2)


def lines(axes):
    return {line.get_label(): line for line in axes.get_lines()}


def test_every_axis_has_its_unit_and_both_columns_share_time(axes):
    for column in (0, 1):
        assert [axis.get_ylabel() for axis in axes[:, column]] == [
            "body displacement [mm]", "position on guide [mm]", "motor speed [rad/s]", "motor power [W]"]
        assert axes[-1, column].get_xlabel() == "time from start of recording [s]"
        assert len({axis.get_xlim() for axis in axes[:, column]}) == 1
    assert axes[0, 0].get_xlim() == (0.0, pytest.approx(4.0))
    assert np.ptp(axes[0, 1].get_xlim()) == pytest.approx(MOMENT)


def test_body_moves_in_millimetres_from_its_first_sample(axes, bag):
    time, shown = axes[0, 0].get_lines()[0].get_data()
    kept = np.isfinite(time)
    np.testing.assert_array_equal(time[kept], bag["odom"]["time"])
    np.testing.assert_allclose(shown[kept], -250.0 * time[kept], rtol=0, atol=1e-9)


def test_curves_break_at_the_gap_and_only_there(axes):
    time = axes[0, 0].get_lines()[0].get_xdata()
    [broken] = np.flatnonzero(np.isnan(time))
    assert (time[broken - 1], time[broken + 1]) == (pytest.approx(1.0), pytest.approx(1.2))
    band = lines(axes[3, 0])["power (mean, range)"].get_xdata()
    assert np.isnan(band).sum() == 1


def test_band_holds_the_swing_and_the_mean_follows_it(axes):
    mean = lines(axes[1, 0])["upper mass (mean, range)"].get_ydata()
    assert np.nanmin(mean) > 20.0 and np.nanmax(mean) < 60.0
    extents = [path.vertices for path in axes[1, 0].collections[0].get_paths()]
    heights = np.concatenate(extents)[:, 1]
    assert (heights.min(), heights.max()) == (pytest.approx(20.0, abs=0.1), pytest.approx(60.0, abs=0.1))


def test_mean_power_in_the_band_is_exact(axes):
    time, mean = lines(axes[3, 0])["power (mean, range)"].get_data()
    kept = np.isfinite(time)
    np.testing.assert_allclose(mean[kept], 2.0 + time[kept], rtol=1e-12)


def test_impacts_of_the_close_up_stand_on_their_plates(axes, bag):
    begin, end = axes[1, 1].get_xlim()
    for guide, plate in (("upper", 60.0), ("inclined", 61.0)):
        marks, heights = lines(axes[1, 1])[f"{guide} impact"].get_data()
        stamps = bag["impacts"]["stamp"][bag["impacts"]["frame"] == f"{guide}_plate"]
        np.testing.assert_array_equal(marks, stamps[(stamps >= begin) & (stamps <= end)])
        assert len(marks) > 0
        np.testing.assert_allclose(heights, plate, rtol=1e-12)
    assert not [label for label in lines(axes[1, 0]) if "impact" in label]


def test_command_is_a_step_line_to_the_end(axes):
    time, speed = lines(axes[2, 0])["command"].get_data()
    assert (time[0], time[-1]) == (0.0, pytest.approx(4.0))
    np.testing.assert_allclose(speed, 20 * np.pi)


def test_recording_without_commands_or_of_one_sample_is_drawn(record_run):
    for name, options in (("no commands", {"without": ("motor_speed",)}), ("one sample", {"count": 1})):
        figure = plot_run(read_bag(record_run(name, **options)))
        figure.canvas.draw()
        assert len(figure.axes) == 8


def test_dense_recording_is_drawn_with_a_bounded_number_of_points(record_run):
    figure = plot_run(read_bag(record_run(count=4001)))
    power = lines(np.array(figure.axes).reshape(4, 2)[3, 0])["power (mean, range)"]
    assert len(power.get_xdata()) == 120


def test_a_robot_without_one_mass_or_plate_is_drawn_without_it(record_run):
    bag = read_bag(record_run(joints=["crank", "inclined_mass", "inclined_plate", "upper_mass"]))
    labels = lines(np.array(plot_run(bag).axes).reshape(4, 2)[1, 0])
    assert "inclined plate" in labels and "upper mass (mean, range)" in labels
    assert "upper plate" not in labels


def test_a_long_line_keeps_its_ends_and_extremes():
    values = np.random.default_rng(0).normal(size=100_003)
    samples = np.arange(3, len(values))
    seen = plots._visible(samples, values)
    assert len(seen) < 5 * plots.POINTS
    assert (np.diff(seen) > 0).all()
    assert (seen[0], seen[-1]) == (3, len(values) - 1)
    size = len(samples) // plots.POINTS
    for first in range(3, 3 + size * plots.POINTS, size):
        block, kept = values[first:first + size], values[seen[(seen >= first) & (seen < first + size)]]
        assert (kept.min(), kept.max()) == (block.min(), block.max())
