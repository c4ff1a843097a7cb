"""Between the samples the motion of a recording is that of `simulate`; where it is not, it is marked as interpolated.
"""

import itertools
import json
import zlib

import numpy as np
import pytest
from motion_reader import NEAR, PART, MotionDocument, assert_is_run
from robot_bag import START, edit_each, edit_topic, offset_times, rewritten, robot_bag, without_earlier, without_topics

import vibro_ros
from vibro_ros.bag.stream import BagError
from vibro_ros.configuration.scene_file import shipped_scenes
from vibro_ros.simulation.samples import Samples
from vibro_ros.view.view import bag_motion

RATE = 200.0
COMMANDS = {5: {"motor_speed": 100.0}, 120: {"upper_gap": 0.0005}, 150: {"motor_speed": 130.0, "inclined_gap": -0.0003},
            230: {"motor_speed": 40.0}}


def read(folder, scene=None):
    """Return the motion, its header as a browser gets it, and the parts of the setting."""
    setting, header, payload = bag_motion(folder, scene=scene)
    json.dumps(setting, allow_nan=False)
    return MotionDocument(json.loads(json.dumps(header, allow_nan=False)), payload), setting


def run_of(times, scene="device", inputs=COMMANDS):
    """Return the run of a scene with these commands, by the number of the sample."""
    scene = vibro_ros.load_scene(scene) if isinstance(scene, str) else scene
    return vibro_ros.simulate(scene, times=times, commands=[(tick / RATE, command) for tick, command in inputs.items()])


def run_with(last, *acts):
    """Return the samples up to number `last` of a `device` that is given each (number, method, arguments)."""
    device, times, parts = vibro_ros.Simulator(vibro_ros.load_scene("device")), offset_times(0.0, last / RATE, 6000), []
    for (begin, act, given), (end, *_) in itertools.pairwise([*acts, (last,)]):
        device.advance_to(begin / RATE)
        getattr(device, act)(**given)
        parts.append(device.sample(times[(times >= begin / RATE) & (times < end / RATE)]))
    return Samples(**{name: np.concatenate([vars(part)[name] for part in parts]) for name in vars(parts[0])})


def test_a_page_says_that_a_controller_samples_too_fast_to_be_shown(tmp_path):
    scene = vibro_ros.load_scene("machine").with_parameters({
        "motor.control_rate": 25_000.0, "motor.proportional_gain": 1.0})
    motion, _ = read(robot_bag(tmp_path / "bag", scene, 121, COMMANDS, RATE))
    assert motion.header["why"] == "the motion changes too often to be drawn as finely as it was computed"
    assert not motion.header["exact"]


@pytest.mark.parametrize("name", shipped_scenes())
def test_every_instant_of_every_shipped_scene(name, tmp_path):
    motion, setting = read(robot_bag(tmp_path / "bag", name, 301, COMMANDS, RATE))
    assert (motion.header["exact"], motion.header["why"], setting["notes"]) == (True, "", [])
    assert (setting["title"], setting["robot"], setting["machine"]["name"]) == ("bag", name, name)
    assert_is_run(motion, run_of(offset_times(0.0, 300 / RATE), name))
    assert (motion.header["begin"], motion.header["end"]) == (0.0, 300 / RATE)


@pytest.mark.parametrize("name", ["device", "damped", "rigid"])
def test_the_impacts_are_those_of_the_run_and_around_each_the_motion_is_exact(name, tmp_path):
    inputs = {0: {"motor_speed": 100.0}}
    motion, _ = read(robot_bag(tmp_path / "bag", name, 201, inputs, RATE))
    impacts, run = motion.header["impacts"], run_of(np.array([1.0]), name, inputs)
    contacts = run.events[np.char.endswith(run.events["kind"], "contact")]
    assert [impact["time"] for impact in impacts] == contacts["time"].tolist()
    assert [impact["side"] for impact in impacts] == [kind.partition("_")[0] for kind in contacts["kind"].tolist()]
    force = [np.inf if impact["peak_force"] is None else impact["peak_force"] for impact in impacts]
    assert force == contacts["peak_force"].tolist()
    around = np.unique(np.concatenate([
        np.linspace(impact["time"] - 2e-5, impact["end"] + 2e-5, 40) for impact in impacts]))
    around = around[(around >= 0.0) & (around <= 1.0)]
    assert_is_run(motion, run_of(around, name, inputs))


def test_a_reset_begins_another_motion(tmp_path):
    inputs = {0: {"motor_speed": 80.0}, 100: "reset", 101: {"motor_speed": 120.0}, 200: "reset"}
    motion, _ = read(robot_bag(tmp_path / "bag", "device", 260, inputs, RATE))
    assert motion.header["exact"] and motion.header["resets"] == [101 / RATE, 201 / RATE]
    for begin, end, speed in ((0, 100, 80.0), (101, 200, 120.0)):
        expected = run_of(offset_times(0.0, (end - begin) / RATE, 5000), inputs={0: {"motor_speed": speed}})
        assert_is_run(motion, expected, begin / RATE)
    assert np.isnan(motion.at(np.array([100.5 / RATE]))["body_position"]).all()


def test_changed_parameters_a_command_timeout_and_refused_commands_are_exact(tmp_path):
    inputs = {0: {"motor_speed": 90.0}, 60: 'set {"ground.friction": 0.05, "motor.acceleration": 50.0}',
              80: {"motor_speed": 130.0}, 120: {"motor_speed": 1e9}, 150: "timeout", 160: "pause", 170: "nonsense"}
    motion, _ = read(robot_bag(tmp_path / "bag", "device", 260, inputs, RATE))
    assert motion.header["exact"]
    assert_is_run(motion, run_with(
        259, (0, "command", {"motor_speed": 90.0}),
        (60, "set_parameters", {"changes": {"ground.friction": 0.05, "motor.acceleration": 50.0}}),
        (80, "command", {"motor_speed": 130.0}), (150, "command", {"motor_speed": 0.0})))


def test_a_push_a_fault_and_another_state_are_part_of_the_motion(tmp_path):
    """The third push replaces the second, and a duration of 0 ends it."""
    inputs = {0: {"motor_speed": 90.0}, 60: 'push {"duration": 0.103, "force_x": 20.0, "force_z": -3.0}',
              110: 'push {"duration": 9.0, "force_x": -8.0, "force_z": 0.0}',
              120: 'push {"duration": 9.0, "force_x": 0.0, "force_z": 2.0}',
              130: 'push {"duration": 0.0, "force_x": 0.0, "force_z": 0.0}',
              150: 'fault {"fault": "plate_stuck", "of": "upper", "value": 0.0, "duration": 0.2, '
              '"from_x": 0.0, "to_x": 0.0}',
              155: {"upper_gap": 0.001}, 210: 'state {"body_velocity": 0.3}', 220: 'push {"duration": NaN}'}
    motion, setting = read(robot_bag(tmp_path / "bag", "device", 241, inputs, RATE))
    assert (motion.header["exact"], setting["notes"]) == (True, [])
    assert motion.header["pushes"] == [
        {"begin": begin, "end": end, "force_x": along, "force_z": up} for begin, end, along, up in (
            (0.3, 0.3 + 0.103, 20.0, -3.0), (0.55, 0.6, -8.0, 0.0), (0.6, 0.65, 0.0, 2.0))]
    assert_is_run(motion, run_with(
        240, (0, "command", {"motor_speed": 90.0}), (60, "push", {"duration": 0.103, "force_x": 20.0, "force_z": -3.0}),
        (110, "push", {"duration": 9.0, "force_x": -8.0}), (120, "push", {"duration": 9.0, "force_z": 2.0}),
        (130, "push", {"duration": 0.0}), (150, "fail", {"fault": "plate_stuck", "duration": 0.2, "of": "upper"}),
        (155, "command", {"upper_gap": 0.001}), (210, "set_state", {"body_velocity": 0.3})))


def test_a_late_recording_of_a_dc_motor_has_its_current_and_no_voltage(tmp_path):
    """It is interpolated, because without a checkpoint the controller's integral is unknown."""
    whole = robot_bag(tmp_path / "whole", "machine", 121, COMMANDS, RATE)
    motion, _ = read(rewritten(whole, tmp_path / "late", without_earlier(20 / RATE)))
    assert motion.header["exact_spans"] == [] and "interpolated" in motion.header["why"]
    times = np.arange(20, 120) / RATE
    run = run_of(times, "machine")
    current = motion.at(times)["motor_current"]
    assert np.abs(current - run.motor_current).max() <= PART * np.abs(run.motor_current).max()
    assert np.isnan(motion.at(times)["motor_voltage"]).all()  # it is not recorded


def test_a_recording_begun_late_is_exact_from_its_checkpoint_on(tmp_path):
    """The friction was changed before the recording begins."""
    acts = {5: {"motor_speed": 100.0}, 60: 'set {"ground.friction": 0.1}'}
    whole = robot_bag(tmp_path / "whole", "device", 301, acts, RATE, checkpoints=(0, 110, 200))
    motion, _ = read(rewritten(whole, tmp_path / "late", without_earlier(110 / RATE)))
    assert motion.header["exact"] and motion.header["begin"] == 110 / RATE
    run = run_with(300, (5, "command", {"motor_speed": 100.0}),
                   (60, "set_parameters", {"changes": {"ground.friction": 0.1}}))
    assert_is_run(motion, Samples(**{name: values[run.time >= 110 / RATE] for name, values in vars(run).items()}))


def test_motion_before_the_first_checkpoint_and_after_a_lost_command_is_interpolated(tmp_path):
    whole = robot_bag(tmp_path / "whole", "device", 301, COMMANDS, RATE, checkpoints=(200,))
    motion, _ = read(rewritten(whole, tmp_path / "late", lambda messages: edit_each(
        lambda message: None if message[:2] == ("/motor_speed", START + round(230 / RATE * 1e9)) else message)(
            without_earlier(110 / RATE)(messages))))
    header = motion.header
    assert header["begin"] == 110 / RATE and header["exact_spans"] == [[200 / RATE, 230 / RATE]]
    assert not header["exact"] and "begins 0.55 s after the robot's start" in header["why"]
    assert "after 1.15 s" in header["why"] and "not what was recorded" in header["why"]
    assert header["why"].endswith("there the motion is interpolated between the samples")
    ticks = np.arange(110, 301) / RATE
    run = run_of(ticks)
    for name in ("body_position", "upper_position", "crank_angle"):
        assert np.abs(motion.at(ticks)[name] - getattr(run, name)).max() <= NEAR


def moved(stamps, distance):
    """Return a change of messages: the body is `distance` [m] further in the odometry of some stamps [s]."""
    def move(odometry):
        odometry.pose.pose.position.x += distance

    return edit_topic("odom", move, lambda stamp: round((stamp - START) * 1e-9, 6) in stamps)


def test_one_recorded_position_that_differs_ends_the_exact_motion(tmp_path):
    whole = robot_bag(tmp_path / "bag", "device", 121, COMMANDS, RATE)
    header = read(rewritten(whole, tmp_path / "other", moved({90 / RATE}, 2e-9)))[0].header
    assert header["exact_spans"] == [[0.0, 89 / RATE]] and not header["exact"]
    assert "body_position" in header["why"] and "interpolated" in header["why"]


@pytest.mark.parametrize("without", ["/odom", "/joint_states"])
def test_either_topic_of_the_state_is_enough(without, tmp_path):
    whole = robot_bag(tmp_path / "bag", "device", 121, COMMANDS, RATE)
    motion, _ = read(rewritten(whole, tmp_path / "other", without_topics(without)))
    assert motion.header["exact"]
    assert_is_run(motion, run_of(offset_times(0.0, 120 / RATE, 3000)))


def test_the_bag_of_another_recorder_is_interpolated_and_drawn_as_the_scene_that_is_named(tmp_path):
    whole = robot_bag(tmp_path / "bag", "damped", 241, {0: {"motor_speed": 60.0}, 120: "reset"}, RATE)
    bag, scene = rewritten(whole, tmp_path / "other", known=False), vibro_ros.load_scene("damped")
    motion, setting = read(bag, scene)
    assert (motion.header["exact_spans"], setting["robot"], setting["notes"]) == ([], "damped", [])
    with pytest.raises(BagError, match="says which scene its robot simulated; leave --scene out"):
        bag_motion(whole, scene=scene)
    assert motion.header["resets"] == [121 / RATE]


@pytest.fixture
def unknown(tmp_path):
    """Return the bag of another recorder, of a robot with a scene of the user's own."""
    scene = vibro_ros.load_scene("device").with_parameters({"ground.friction": 0.21, "upper.spring.damping": 2.5})
    whole = robot_bag(tmp_path / "bag", scene, 241, {0: {"motor_speed": 60.0}, 120: "reset"}, RATE)
    return scene, lambda change=list: rewritten(whole, tmp_path / "other", change, known=False)


def test_the_robot_of_another_recorder_may_be_unknown_and_its_motion_interpolated(unknown):
    scene, bag = unknown
    motion, setting = read(bag())
    header = motion.header
    assert not header["exact"] and header["exact_spans"] == []
    assert "says nothing of scene, parameters, start" in header["why"] and "interpolated" in header["why"]
    assert header["resets"] == [121 / RATE] and setting["machine"]["name"] == "device"
    assert "name the robot's scene with --scene" in setting["notes"][0]
    first = run_of(np.arange(121) / RATE, scene, {0: {"motor_speed": 60.0}})
    assert {"body_position", "motor_power", "normal_force", "upper_plate_force"} <= set(motion.quantities)
    assert_is_run(motion, first)
    assert len(header["impacts"]) > 10 and all(impact["peak_force"] > 0.0 for impact in header["impacts"])
    between = run_of(offset_times(0.0, 0.6), scene, {0: {"motor_speed": 60.0}})
    far = np.abs(motion.at(between.time)["crank_angle"] - between.crank_angle).max()
    assert far < 1e-3  # rad, by a cubic over the motor's ramp and its end


def test_a_gap_is_not_interpolated(unknown):
    _, bag = unknown
    motion, _ = read(bag(edit_each(lambda message: None if 0.3 < (message[1] - START) * 1e-9 < 0.5 else message)))
    x = motion.at(np.array([0.2, 0.29, 0.4, 0.49, 0.51]))["upper_position"]
    assert np.isnan(x).tolist() == [False, False, True, True, False]


def test_a_bag_without_state_is_refused_in_one_line(tmp_path):
    whole = robot_bag(tmp_path / "bag", "device", 11, {}, RATE)
    other = rewritten(whole, tmp_path / "other", edit_each(
        lambda message: message if message[0] == "/motor_power" else None))
    with pytest.raises(BagError, match="holds no state to draw; give a bag with odom or joint_states"):
        bag_motion(other)


def test_a_minute_of_the_device_is_small_and_progress_is_reported(tmp_path):
    """The page of a minute of chaos, the most eventful of the shipped scenes, is smaller than 10 MB."""
    folder, shares = robot_bag(tmp_path / "bag", "unilateral", 60 * 50 + 1, {}, 50.0), []
    _, header, payload = bag_motion(folder, shares.append)
    assert header["exact"] and header["end"] == 60.0
    assert len(zlib.compress(payload)) * 4 / 3 < 9e6
    assert shares == sorted(shares) and shares[-1] == 1.0 and len(shares) > 20


def test_motion_beyond_the_limit_of_a_page_is_left_out_with_a_note(tmp_path, monkeypatch):
    monkeypatch.setattr("vibro_ros.view.view.LARGEST", 30_000)
    motion, setting = read(robot_bag(tmp_path / "bag", "device", 1001, {0: {"motor_speed": 100.0}}, RATE))
    header = motion.header
    assert header["exact"] and header["end"] in (1.0, 2.0) and header["exact_spans"] == [[0.0, header["end"]]]
    assert setting["notes"] == [f"the motion after {header['end']:g} s is left out: it would not fit into a page"]
    assert all(impact["time"] <= header["end"] for impact in header["impacts"])


def test_the_longest_recording_that_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr("vibro_ros.view.recorded.MOST_SAMPLES", 100)
    motion, setting = read(robot_bag(tmp_path / "bag", "device", 201, {0: {"motor_speed": 100.0}}, RATE))
    assert motion.header["exact"] and motion.header["end"] == 99 / RATE
    assert setting["notes"] == ["the end of the recording is left out: it is too long for a page"]
