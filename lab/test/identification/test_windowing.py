"""Where windows begin, and the states that measurements tell there."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from vibro_lab.identification.recording import Channel, Recording
from vibro_lab.identification.windowing import (
    REACHES,
    TURN,
    Stretch,
    arcs,
    chain,
    local_states,
    measured,
    measured_spans,
    positions_of,
    roughness,
    unmeasured,
)

TIMES = np.arange(1001) / 500.0
NAMES = ("body_position", "body_velocity", "upper_position", "upper_velocity")
STARTS = np.array([0.3001, 0.8, 1.2345])


def body(times):
    """Return position and speed of a smooth motion: 10 mm at 30 rad/s."""
    return 0.01 * np.sin(30.0 * times), 0.3 * np.cos(30.0 * times)


def recording(*channels, duration=2.0):
    return Recording(0.0, duration, channels, (), ())


def channel(field, values, sigma, sensor="odom", times=TIMES):
    return Channel(sensor, field, times, values, sigma, "given")


@pytest.mark.parametrize("reach", REACHES, ids=str)
def test_a_local_cubic_tells_position_and_speed_of_a_smooth_motion(reach):
    """Within 10 ms a cubic is off by the fourth derivative, 8100 m/s^4 * (10 ms)^4 / 24: 3.4 µm, and 1.4 mm/s."""
    position, speed = body(TIMES)
    made = recording(channel("body_position", position, 5e-5), channel("body_velocity", speed, 1e-3))
    otherwise = np.full((3, 4), 7.0)
    states = local_states(made, NAMES, STARTS, reach, otherwise)
    exact = np.column_stack(body(STARTS))
    assert_allclose(states[:, 0], exact[:, 0], rtol=0, atol=3.4e-6)
    assert_allclose(states[:, 1], exact[:, 1], rtol=0, atol=1.4e-3)
    assert (states[:, 2:] == 7.0).all()  # what is not measured is as given
    assert (otherwise == 7.0).all()


def test_a_position_alone_tells_the_speed_as_well_and_a_speed_alone_tells_nothing():
    position, speed = body(TIMES)
    states = local_states(recording(channel("body_position", position, 5e-5)), NAMES, STARTS, REACHES[0],
                          np.zeros((3, 4)))
    assert_allclose(states[:, 1], body(STARTS)[1], rtol=0, atol=1e-3)
    made = recording(channel("body_velocity", speed, 1e-3))
    assert (local_states(made, NAMES, STARTS, REACHES[0], np.zeros((3, 4))) == 0.0).all()
    assert unmeasured(made, NAMES) == list(NAMES)


def test_where_too_few_samples_are_near_the_state_is_as_given():
    position, _ = body(TIMES)
    states = local_states(recording(channel("body_position", position, 5e-5)), NAMES, np.array([5.0, 1.0]), REACHES[0],
                          np.full((2, 4), 7.0))
    assert states[0].tolist() == [7.0] * 4
    assert states[1, 0] == pytest.approx(body(1.0)[0], abs=3.4e-6)


def test_positions_that_are_ten_milliseconds_apart_tell_a_state_where_two_of_them_are_near():
    """A parabola through samples 10, 20 and 30 ms away is off by the third derivative, 270 m/s³: 270 m/s³ / 6 times
    10 ms * 20 ms * 30 ms, 0.27 mm, and times the sum of the products of two of them, 0.05 m/s."""
    times = TIMES[::5]
    made, names = recording(channel("body_position", body(times)[0], 5e-5, times=times)), NAMES[:2]
    starts = np.array([0.0, 0.3001, 1.2345])
    for reach in REACHES:
        states = local_states(made, names, starts, reach, np.full((3, 2), 7.0))
        measured_there = states[:, 0] != 7.0
        assert measured_there[1:].all() and (measured_there[0] or reach == REACHES[-1])
        exact = np.column_stack(body(starts[measured_there]))
        assert_allclose(states[measured_there, 0], exact[:, 0], rtol=0, atol=2.8e-4)
        assert_allclose(states[measured_there, 1], exact[:, 1], rtol=0, atol=0.055)


def test_of_two_channels_the_less_noisy_is_taken():
    position, _ = body(TIMES)
    rough, fine = channel("body_position", position + 1.0, 1e-3, "tracking"), channel("body_position", position, 5e-5)
    assert measured(recording(fine, rough)) == {"body_position": fine}
    assert measured(recording(rough, fine)) == {"body_position": fine}
    assert unmeasured(recording(fine), NAMES) == ["upper_position", "upper_velocity"]
    assert positions_of("body_vertical_velocity") == ("body_height", "body_vertical_velocity")
    assert positions_of("motor_speed") == ("crank_angle", "motor_speed")


def blows(times, every=0.05):
    """Return a speed that is smooth but for a jump at odd multiples of half of `every` [s]."""
    return np.cos(20.0 * times) + np.floor(times / every + 0.5)


def test_roughness_is_large_only_within_four_milliseconds_of_a_blow():
    rough = roughness(TIMES, [blows(TIMES)])
    away = np.abs((TIMES / 0.05) % 1.0 - 0.5) * 0.05  # s from the nearest blow
    assert rough[away < 0.002].min() > 0.5
    assert rough[(away > 0.0085) & (TIMES < 1.99)].max() < 0.01
    assert rough[-3:].max() > 0.01  # at the end there is no second difference


def test_arcs_start_where_it_is_calm_and_never_overlap():
    rough = roughness(TIMES, [blows(TIMES)])
    stretch = Stretch(TIMES, TIMES, rough, False)
    spans = arcs([stretch], 0.013, 30)
    assert 20 <= len(spans) <= 30
    assert_allclose(np.diff(spans, axis=1), 0.013)
    assert (spans[1:, 0] >= spans[:-1, 1]).all()
    assert spans[0, 0] > 0.0 and spans[-1, 1] <= TIMES[-1]
    assert (rough[np.searchsorted(TIMES, spans[:, 0])] < 0.01).all()
    assert spans[-1, 0] - spans[0, 0] > 1.7  # they are spread over the recording
    assert arcs([stretch], 3.0, 30).shape == (0, 2)  # a recording that is shorter than one
    later = arcs([stretch, stretch._replace(times=TIMES + 60.0)], 0.013, 30)  # after a pause
    assert 20 <= len(later) <= 30 and 10 <= (later[:, 0] > 60.0).sum() <= 15
    assert not ((later[:, 1] > TIMES[-1]) & (later[:, 0] < 60.0)).any()


@pytest.mark.parametrize("turns", [0.5, 2.0])
@pytest.mark.parametrize("rests", [True, False])
def test_a_chain_is_joined_covers_the_recording_and_starts_where_it_is_calm(turns, rests):
    rough = roughness(TIMES, [blows(TIMES)])
    spans = chain([Stretch(TIMES, 100.0 * TIMES, rough, rests)], turns)
    assert (spans[1:, 0] == spans[:-1, 1]).all()
    assert (spans[:, 1] > spans[:, 0]).all()
    assert spans[0, 0] == 0.0 if rests else 0.0 <= spans[0, 0] < 0.5 * turns * TURN / 100.0
    assert spans[-1, 1] > TIMES[-1] > spans[-1, 0]  # the last sample is in the last window
    length = np.diff(spans[:-1], axis=1) * 100.0 / (TURN * turns)
    assert (length > 0.69).all() and (length < 1.31).all()
    assert (rough[np.searchsorted(TIMES, spans[1:, 0])] < 0.01).all()


def test_no_window_starts_while_the_crank_rests():
    angle = 100.0 * np.where(TIMES < 0.5, TIMES, np.where(TIMES < 1.5, 0.5, TIMES - 1.0))
    stretch = Stretch(TIMES, angle, np.zeros(len(TIMES)), True)
    spans = chain([stretch], 1.0)
    assert (spans[1:, 0] == spans[:-1, 1]).all()
    assert not ((spans[:, 0] > 0.501) & (spans[:, 0] < 1.5)).any()
    assert len(chain([stretch._replace(angle=np.zeros(len(TIMES)))], 1.0)) == 1


def test_a_pause_of_the_recording_parts_stretches_and_a_lost_sample_does_not():
    position = body(TIMES)[0]
    times = np.concatenate([TIMES[:400], TIMES[420:] + 60.0, [100.0]])  # 20 samples are lost as well
    made = recording(channel("body_position", np.resize(position, len(times)), 5e-5, times=times), duration=100.0)
    assert_allclose(measured_spans(made), [[0.0, TIMES[399]], [TIMES[420] + 60.0, 62.0]])  # 1 sample is no stretch
    slow = channel("body_position", position[::250], 5e-5, times=TIMES[::250])
    lossy = channel("upper_position", np.delete(position, [500, 501]), 5e-5, times=np.delete(TIMES, [500, 501]))
    assert_allclose(measured_spans(recording(slow, lossy)), [[0.0, 2.0]])
    assert_allclose(measured_spans(recording(slow)), [[0.0, 2.0]])  # two samples a second are no pauses
