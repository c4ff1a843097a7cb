"""The picture shows the recording's own numbers."""

import dataclasses

import numpy as np
import pytest

from vibro_ros.bag.reader import read_bag
from vibro_ros.recordings import report
from vibro_ros.recordings.report import CLOSE_UP, plot_run

ROWS = ["body displacement [mm]", "upper mass [mm]", "inclined mass [mm]", "peak force [N]", "ground force N [N]",
        "motor [rad/s]", "motor power [W]"]


@pytest.fixture(scope="module")
def bag(known_run):
    return read_bag(known_run(gap=(1.0, 1.2)))


def panels(figure):
    """Return the axes of the whole run and of the moment, by the label of the row."""
    plotted = [axes for axes in figure.axes if not axes.get_ylabel().endswith("[%]")]
    assert [axes.get_ylabel() for axes in plotted[::2]] == [axes.get_ylabel() for axes in plotted[1::2]]
    return {left.get_ylabel(): (left, right) for left, right in zip(plotted[::2], plotted[1::2], strict=True)}


@pytest.fixture(scope="module")
def shown(bag):
    """The panels of a figure that tests read and do not change."""
    return panels(plot_run(bag))


def lines(axes):
    return {line.get_label(): line for line in axes.get_lines()}


def changed(bag, topic, **arrays):
    """Return the same recording with other numbers in one topic."""
    name = bag.full_name(topic)
    return dataclasses.replace(bag, arrays={**bag.arrays, name: {**bag.arrays[name], **arrays}})


def test_every_axis_has_its_unit_and_both_columns_share_time(shown):
    assert list(shown) == ROWS
    for column in (0, 1):
        assert shown[ROWS[-1]][column].get_xlabel() == "time from start of recording [s]"
        assert len({axes[column].get_xlim() for axes in shown.values()}) == 1
    left, right = shown[ROWS[0]]
    assert left.get_xlim() == (0.0, pytest.approx(4.0))
    assert np.ptp(right.get_xlim()) == pytest.approx(CLOSE_UP)


def test_body_moves_in_millimetres_from_its_first_sample(shown, bag):
    time, drawn = shown[ROWS[0]][0].get_lines()[0].get_data()
    kept = np.isfinite(time)
    np.testing.assert_array_equal(time[kept], bag["odom"]["time"])
    np.testing.assert_allclose(drawn[kept], -250.0 * time[kept], rtol=0, atol=1e-9)


def test_curves_break_at_the_gap_and_only_there(shown):
    time = shown[ROWS[0]][0].get_lines()[0].get_xdata()
    [broken] = np.flatnonzero(np.isnan(time))
    assert (time[broken - 1], time[broken + 1]) == (pytest.approx(1.0), pytest.approx(1.2))
    mean, power = lines(shown["motor power [W]"][0])["mean over whole turns"].get_data()
    lost = np.isnan(power)
    assert 0.9 < mean[lost].min() and mean[lost].max() < 1.3
    assert (~lost).sum() > 10
    np.testing.assert_allclose(power[~lost], 2.0 + mean[~lost], rtol=1e-12)  # 2 W + 1 W/s · t


def test_a_mass_is_at_its_plate_at_the_instant_of_every_impact(shown, bag):
    """Samples reach 60 mm at t = 0, 0.1, ... s only; the inclined mass stays below 60 mm, its impacts are at 61 mm."""
    begin, end = shown[ROWS[0]][1].get_xlim()
    for guide, plate in (("upper", 60.0), ("inclined", 61.0)):
        drawn = lines(shown[f"{guide} mass [mm]"][1])
        marks, heights = drawn["impact, at the plate"].get_data()
        stamps = bag["impacts"]["stamp"][bag["impacts"]["frame"] == f"{guide}_plate"]
        np.testing.assert_array_equal(marks, stamps[(stamps >= begin) & (stamps <= end)])
        assert len(marks) > 0
        np.testing.assert_allclose(heights, plate, rtol=1e-12)
        time, position = drawn[f"{guide} mass"].get_data()
        np.testing.assert_allclose(position[np.isin(time, marks)], plate, rtol=1e-12)
        assert np.isin(marks, time).all()
        whole = lines(shown[f"{guide} mass [mm]"][0])[f"{guide} mass"].get_ydata()
        assert (np.nanmin(whole), np.nanmax(whole)) == (pytest.approx(20.0, abs=0.1), pytest.approx(plate, abs=1e-9))


def test_a_mean_over_turns_does_not_swing_with_the_crank():
    time = np.linspace(0.0, 10.0, 5001)
    angle = 2.0 * np.pi * 3.7 * time
    middle, mean = report.mean_over_turns(time, 1.0 + np.cos(angle), time, angle)
    assert len(middle) == 37
    np.testing.assert_allclose(mean, 1.0, atol=1e-4)


def test_every_impact_is_drawn_at_its_peak_force(shown, bag):
    drawn = lines(shown["peak force [N]"][0])
    for guide, count in (("upper", 60), ("inclined", 30)):
        time, force = drawn[f"{guide} impacts"].get_data()
        assert len(time) == count
        np.testing.assert_array_equal(force, 1000.0)


def test_a_force_far_beyond_the_others_hides_none_of_them(bag):
    force = bag["ground_contact"]["force"].copy()
    force[100, 2] = -1e4
    left, _ = panels(plot_run(changed(bag, "ground_contact", force=force)))["ground force N [N]"]
    assert left.get_yscale() == "symlog"
    low, high = left.transData.transform([[0.0, 0.0], [0.0, 11.6]])[:, 1]
    assert high - low > 10.0  # pixels


@pytest.mark.parametrize("value", [1e308, np.nan])
def test_a_refused_command_does_not_flatten_the_motor(bag, value):
    figure = plot_run(changed(bag, "motor_speed", value=np.array([value])))
    figure.canvas.draw()
    low, high = panels(figure)["motor [rad/s]"][0].get_ylim()
    assert low == 0.0 and 20 * np.pi < high < 3 * 20 * np.pi


@pytest.mark.parametrize(("options", "rows"), [
    ({"without": ("motor_speed",)}, ROWS), ({"count": 1}, ROWS),
    ({"without": ("motor_power",)}, ROWS[:-1]), ({"without": ("impacts",)}, [*ROWS[:3], *ROWS[4:]]),
    ({"joints": ["crank", "inclined_mass", "inclined_plate"]}, [ROWS[0], *ROWS[2:]]),
    ({"joints": ["crank"]}, [ROWS[0], *ROWS[3:]])], ids=str)
def test_panels_without_data_are_left_out(known_run, options, rows):
    figure = plot_run(read_bag(known_run(**options)))
    figure.canvas.draw()
    assert list(panels(figure)) == rows
