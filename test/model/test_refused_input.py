"""What the simulator refuses: one line that names the value, the limit and the remedy; nothing changes."""

import math

import pytest

import vibro_ros


@pytest.fixture
def device():
    made = vibro_ros.Simulator(vibro_ros.load_scene("unilateral"))
    made.advance_to(0.03)
    return made


@pytest.mark.parametrize(("command", "named"), [
    ({"motor_speed": math.nan}, "nan"), ({"motor_speed": math.inf}, "inf"),
    ({"motor_speed": -501.0}, "-501"), ({"motor_speed": 501.0}, "501"), ({"motor_speed": "fast"}, "fast"),
    ({"motor_speed": True}, "True"), ({"upper_gap": math.nan}, "nan"),
    ({"upper_gap": -math.inf}, "-inf"),
    ({"inclined_gap": 0.07}, "0.07"), ({"upper_gap": -0.061}, "-0.061"),
    ({"inclined_gap": 1e6}, "1e+06"), ({"upper_gap": 0.001, "motor_speed": -1e6}, "-1e+06"),
    ({"motor_speed": 50.0, "upper_gap": 0.001, "inclined_gap": math.nan}, "nan")])
def test_a_refused_command_changes_nothing(device, command, named):
    before = device.checkpoint().tobytes()
    with pytest.raises(ValueError, match=".") as caught:
        device.command(**command)
    message = str(caught.value)
    assert named in message and "\n" not in message
    assert device.checkpoint().tobytes() == before


@pytest.mark.parametrize("time", [0.01, math.nan, -1.0, math.inf])
def test_time_runs_forwards_only(device, time):
    with pytest.raises(ValueError, match=".") as caught:
        device.advance_to(time)
    assert "\n" not in str(caught.value)
    assert device.time == 0.03


@pytest.mark.parametrize("arguments", [
    {"duration": -1.0}, {"duration": math.nan}, {"duration": 1.0, "rate": 0.0}, {"duration": 1.0, "rate": math.nan},
    {"times": [0.2, 0.1]}, {"times": [-0.1, 0.1]}, {"times": [0.0, math.nan]}])
def test_impossible_sample_times_are_refused(arguments):
    with pytest.raises(ValueError, match=".") as caught:
        vibro_ros.simulate(vibro_ros.load_scene("paper"), **arguments)
    assert "\n" not in str(caught.value)
