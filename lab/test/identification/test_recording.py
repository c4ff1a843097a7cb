"""A bag comes in; channels, their noise and the commands go out, or one line says why not."""

import math
import re

import numpy as np
import pytest
from laboratory_messages import (
    START,
    imu,
    joint_states,
    numbers,
    odometry,
    stamp,
    tracking,
    written,
)
from robot_bag import holding, robot_bag

import vibro_ros
from vibro_lab.identification.noise import noise_of
from vibro_lab.identification.recording import LARGEST_SPREAD, read_recording
from vibro_ros.bag.stream import BagError
from vibro_ros.messages.codec import deserialised, serialised
from vibro_ros.messages.topics import TOPICS

DAMPED = vibro_ros.load_scene("damped")
TIMES = 1.0 + np.arange(1000) / 500.0
X = 0.01 * np.sin(7.0 * TIMES)
V = 0.07 * np.cos(7.0 * TIMES)
RANDOM = np.random.default_rng(38)


def noise(sigma, count=1000):
    return sigma * RANDOM.standard_normal(count)


def channel_of(recording, name):
    return next(channel for channel in recording.channels if f"{channel.sensor}.{channel.field}" == name)


def test_channels_have_the_measured_values_at_the_stamps_of_the_headers(tmp_path):
    late = [(topic, at + 30_000_000, data) for topic, at, data in tracking(TIMES[::5], 2.0 * X[::5], 1e-6)]
    bag = written(tmp_path / "bag", odometry(TIMES + 0.1, X, V, (1e-8, 1e-6)), late)
    recording = read_recording(bag, DAMPED)
    assert [f"{channel.sensor}.{channel.field}" for channel in recording.channels] == [
        "odom.body_position", "odom.body_velocity", "tracking.body_position"]
    position, velocity, tracked = recording.channels
    np.testing.assert_array_equal(position.values, X)
    np.testing.assert_array_equal(velocity.values, V)
    np.testing.assert_array_equal(tracked.values, 2.0 * X[::5])
    np.testing.assert_allclose(position.times, TIMES - 0.9, rtol=0, atol=1e-9)  # a stamp is rounded to 1e-9 s
    np.testing.assert_allclose(tracked.times, TIMES[::5] - 1.0, rtol=0, atol=1e-9)
    assert (position.sigma, velocity.sigma, tracked.sigma) == pytest.approx((1e-4, 1e-3, 1e-3))
    assert {channel.sigma_from for channel in recording.channels} == {"covariance"}
    assert recording.start == pytest.approx(START * 1e-9 + 1.0, abs=1e-6)
    assert recording.duration == pytest.approx(2.098, abs=1e-9)


def test_a_body_that_hops_has_a_height_with_variances_of_its_own(tmp_path):
    def widened(rows):
        for topic, at, data in rows:
            message = deserialised(data, TOPICS["odom"].type)
            for part, variance in ((message.pose, 4e-8), (message.twist, 9e-6)):
                part.covariance = np.where(np.arange(36) == 14, variance, part.covariance)
            yield topic, at, serialised(message, TOPICS["odom"].type)

    rows = odometry(TIMES, np.array([X, X**2]), np.array([V, 2.0 * X * V]), (1e-8, 1e-6))
    bag = written(tmp_path / "bag", widened(rows))
    channels = {channel.field: channel for channel in read_recording(
        bag, DAMPED.with_parameters({"effects.normal_force": "hop"})).channels}
    np.testing.assert_array_equal(channels["body_height"].values, X**2)
    np.testing.assert_array_equal(channels["body_vertical_velocity"].values, 2.0 * X * V)
    assert [channel.sigma for channel in channels.values()] == pytest.approx([1e-4, 2e-4, 1e-3, 3e-3])


def test_joints_in_any_order_without_velocities_and_unknown_ones(tmp_path):
    joints = {"gripper": [X], "inclined_mass": [0.03 + X + noise(1e-4)], "crank": [9.0 * TIMES + noise(1e-3)]}
    recording = read_recording(written(tmp_path / "bag", joint_states(TIMES, joints)), DAMPED)
    assert [channel.field for channel in recording.channels] == ["inclined_position", "crank_angle"]
    np.testing.assert_array_equal(recording.channels[0].values, joints["inclined_mass"][0])
    assert any("gripper" in sentence for sentence in recording.said)
    velocities = {"upper_mass": [X, V], "crank": [TIMES, np.full(len(TIMES), math.nan)]}
    recording = read_recording(written(tmp_path / "other", joint_states(TIMES, velocities)), DAMPED)
    assert [channel.field for channel in recording.channels] == ["upper_position", "crank_angle", "upper_velocity"]
    assert any("crank.velocity" in sentence for sentence in recording.said)


def test_an_encoder_has_the_resolution_of_its_ticks_and_no_speed(tmp_path):
    tick = math.tau / 4096
    angle = tick * np.round(31.0 * TIMES / tick)
    bag = written(tmp_path / "bag", joint_states(TIMES, {"crank": [angle, V]}, "encoder"))
    (crank,) = read_recording(bag, DAMPED).channels
    assert (crank.field, crank.sigma_from) == ("crank_angle", "resolution")
    assert (crank.resolution, crank.sigma) == pytest.approx((tick, tick / math.sqrt(12.0)))
    other = read_recording(bag, DAMPED.with_parameters({"sensors.encoder.ticks": 1000.0})).channels[0]
    assert (other.resolution, other.sigma_from) == (0.0, "neighbours")
    assert 0.5 < other.sigma / crank.sigma < 2.0  # at a constant speed the rounding is no white noise


def test_an_imu_measures_along_x_and_up_only_where_the_body_hops(tmp_path):
    bag = written(tmp_path / "bag", imu(TIMES, X + noise(0.3), 9.81 + noise(0.3), 0.09))
    scene = DAMPED.with_parameters({"sensors.imu.bandwidth": 260.0})
    assert [channel.field for channel in read_recording(bag, scene).channels] == ["acceleration_x"]
    hop = scene.with_parameters({"effects.normal_force": "hop"})
    assert [channel.field for channel in read_recording(bag, hop).channels] == ["acceleration_x", "acceleration_z"]
    assert channel_of(read_recording(bag, hop), "imu/data_raw.acceleration_z").sigma == pytest.approx(0.3)


def test_an_imu_clips_and_is_off_by_a_constant_as_the_scene_says(tmp_path):
    """The variance of an IMU has that of its constant error in it, which is no noise from sample to sample."""
    bag = written(tmp_path / "bag", imu(TIMES, X + noise(0.3), 9.81 + noise(0.3), 0.3**2 + 0.4**2))
    scene = DAMPED.with_parameters({"sensors.imu.bandwidth": 260.0, "sensors.imu.accelerometer.range": 20.0,
                                    "sensors.imu.accelerometer.turn_on_bias": 0.4})
    acceleration = channel_of(read_recording(bag, scene), "imu/data_raw.acceleration_x")
    assert (acceleration.sigma, acceleration.bias, acceleration.bandwidth) == (pytest.approx(0.3), 0.4, 260.0)
    assert acceleration.limit == pytest.approx(20.0 - 3.0 * 0.5)
    faint = written(tmp_path / "faint", imu(TIMES, noise(0.05), noise(0.05), 0.05**2 + 0.4**2))
    least = read_recording(faint, scene.with_parameters({"sensors.imu.accelerometer.range": 1.0}))
    assert channel_of(least, "imu/data_raw.acceleration_x").limit == 0.0  # such an IMU says nothing
    both = written(tmp_path / "both", imu(TIMES, X, X, 1.0), odometry(TIMES, X, V, (1e-8, 1e-6)))
    for machine, given, why in ((DAMPED, {}, "does not say which low-pass the IMU has.*give sensors.imu.bandwidth"),
                                (scene, {"imu/data_raw": math.inf}, "as its noise says")):
        recording = read_recording(both, machine, given)
        assert {channel.sensor for channel in recording.channels} == {"odom"}
        assert re.search(f"imu/data_raw is left out.*{why}", "\n".join(recording.said))
    with pytest.raises(BagError, match="sensors.imu.accelerometer.range: 0.1 m/s² in the scene, acceleration_x is up"):
        read_recording(bag, scene.with_parameters({"sensors.imu.accelerometer.range": 0.1}))


def test_commands_come_from_all_topics_and_those_before_the_first_measurement_hold_at_0(tmp_path):
    message = joint_states(np.array([2.5]), {"upper_plate": [np.array([DAMPED["crank.upper_rod"] + 0.001])]},
                           "joint_commands")
    bag = written(tmp_path / "bag", odometry(TIMES, X, V, (1e-8, 1e-6)), message,
                  numbers("motor_speed", [(0.2, 40.0), (0.7, 60.0), (2.25, 90.0), (2.6, 1e9), (2.7, math.nan)]),
                  numbers("inclined_gap", [(0.5, 0.002), (2.25, 0.003)]))
    recording = read_recording(bag, DAMPED)
    times, given = zip(*recording.commands, strict=True)
    assert times == pytest.approx((0.0, 1.25, 1.5), abs=1e-9)
    assert given[:2] == ({"motor_speed": 60.0, "inclined_gap": 0.002}, {"motor_speed": 90.0, "inclined_gap": 0.003})
    assert given[2] == {"upper_gap": pytest.approx(0.001)}
    assert sum("would be refused" in sentence for sentence in recording.said) == 2
    assert any("no command of upper_gap was recorded before" in sentence for sentence in recording.said)
    vibro_ros.simulate(DAMPED.with_parameters({"effects.motor": "ramp"}), recording.duration, 10.0,
                       commands=recording.commands)


def test_our_own_robot_is_read_in_its_namespace_and_its_truth_has_a_floor_for_noise(tmp_path):
    bag = robot_bag(tmp_path / "bag", DAMPED, 200, {0: {"motor_speed": 100.0}, 50: "timeout"})
    recording = read_recording(bag, DAMPED)
    assert {channel.sensor for channel in recording.channels} == {"odom", "joint_states"}
    assert recording.commands == ((0.0, {"motor_speed": 100.0}), (pytest.approx(0.25), {"motor_speed": 0.0}))
    plate = channel_of(recording, "joint_states.upper_plate_position")
    assert (plate.sigma, plate.sigma_from) == (1e-6, "neighbours")
    assert any("upper_plate_position" in line and "hardly any noise" in line for line in recording.said)
    run = vibro_ros.simulate(DAMPED, 199 / 200, 200.0, commands=recording.commands)
    np.testing.assert_allclose(channel_of(recording, "odom.body_position").values, run.body_position, rtol=0,
                               atol=1e-12)


@pytest.mark.parametrize(("scene", "rate", "worst"), [("damped", 500.0, 1.25), ("damped", 1000.0, 1.15),
                                                      ("device", 500.0, 1.25), ("device", 1000.0, 1.15)])
def test_noise_of_neighbours_is_that_of_a_laboratory_on_a_motion_with_blows(scene, rate, worst):
    """Bounds: 4000 samples give a standard deviation to 4 %; the rest is what blows and starts of sliding leave."""
    random = np.random.default_rng(38)
    commands = [] if scene == "damped" else [(0.1, {"motor_speed": 100.0}), (2.0, {"upper_gap": 0.0005}),
                                             (2.5, {"motor_speed": 40.0})]
    run = vibro_ros.simulate(vibro_ros.load_scene(scene), 2000 / rate * 2.0, rate, commands=commands)
    for body in ("body", "upper", "inclined"):
        for field, sigma in ((f"{body}_position", 5e-5), (f"{body}_velocity", 1e-3)):
            values = getattr(run, field)
            estimate, spread = noise_of(run.time, values + sigma * random.standard_normal(len(values)))
            assert 0.88 < estimate / sigma < worst, field
            assert spread < LARGEST_SPREAD, field


def test_where_the_motion_is_larger_than_the_noise_the_estimate_is_called_a_bound(tmp_path):
    run = vibro_ros.simulate(DAMPED, 4.0, 100.0)
    moved = {"upper_mass": [run.upper_position + noise(5e-5, len(run.time))]}
    recording = read_recording(written(tmp_path / "bag", joint_states(run.time, moved)), DAMPED)
    assert recording.channels[0].sigma > 1e-4
    assert any("at most, because the motion" in sentence for sentence in recording.said)


def test_noise_is_given_by_sensor_or_channel_and_infinity_leaves_out(tmp_path):
    bag = written(tmp_path / "bag", odometry(TIMES, X, V, (1e-8, 1e-6)), tracking(TIMES, X, 1e-6))
    given = {"odom": 0.5, "odom.body_velocity": 0.25, "tracking": math.inf}
    recording = read_recording(bag, DAMPED, given)
    assert [(channel.field, channel.sigma, channel.sigma_from) for channel in recording.channels] == [
        ("body_position", 0.5, "given"), ("body_velocity", 0.25, "given")]
    for wrong, why in (({"odometry": 1.0}, "no such channel"), ({"odom": 0.0}, "above 0"),
                       ({"odom": math.nan}, "above 0")):
        with pytest.raises(ValueError, match=why):
            read_recording(bag, DAMPED, wrong)


def test_a_variance_of_0_is_not_known_and_the_noise_is_estimated(tmp_path):
    bag = written(tmp_path / "bag", tracking(TIMES, X + noise(1e-3), 0.0))
    (position,) = read_recording(bag, DAMPED).channels
    assert position.sigma_from == "neighbours"
    assert position.sigma == pytest.approx(1e-3, rel=0.12)


@pytest.mark.parametrize("variance", [-1.0, math.nan, math.inf, np.finfo(float).max])
def test_a_variance_that_says_not_measured_drops_that_number_and_no_other(tmp_path, variance):
    """Every second position; then no speed at all."""
    def unmeasured(message):
        message.pose.covariance = np.where(np.arange(36) == 0, variance, message.pose.covariance)

    rows = list(odometry(TIMES, np.where(np.arange(1000) % 2, X, math.nan), V, (1e-8, 1e-6)))
    for k in range(0, 1000, 2):
        rows[k] = changed(rows[k], "odom", unmeasured)
    recording = read_recording(written(tmp_path / "bag", rows), DAMPED)
    position, velocity = recording.channels
    np.testing.assert_array_equal(position.values, X[1::2])
    np.testing.assert_allclose(position.times, TIMES[1::2] - TIMES[0], rtol=0, atol=1e-9)
    np.testing.assert_array_equal(velocity.values, V)
    assert (position.sigma, position.sigma_from) == (pytest.approx(1e-4), "covariance")
    assert any("body_position: 500 samples" in line and "500 others not measured" in line for line in recording.said)
    bag = written(tmp_path / "other", odometry(TIMES, X, V, (1e-8, variance)))
    recording = read_recording(bag, DAMPED)
    assert [channel.field for channel in recording.channels] == ["body_position"]
    assert any("odom: body_velocity is left out" in line and "not measured" in line for line in recording.said)
    with pytest.raises(BagError, match="measures nothing .* its variance, or NaN, says of 1000 of 1000 numbers"):
        read_recording(written(tmp_path / "none", tracking(TIMES, X, variance)), DAMPED)


def changed(row, topic, change):
    """Return a row of a bag with its message changed in place."""
    message = deserialised(row[2], TOPICS[topic].type)
    change(message)
    return row[0], row[1], serialised(message, TOPICS[topic].type)


def test_each_joint_has_the_instants_at_which_it_was_measured(tmp_path):
    """Three publishers, one of which is another robot's and comes first; and NaN of one joint drops that number only.
    """
    y, z = 0.03 + X + noise(1e-4), 0.02 + X + noise(1e-4)
    holed = np.where(np.arange(1000) == 7, math.nan, z)
    bag = written(tmp_path / "bag", joint_states(TIMES[:3] - 1e-6, {"wheel": [X]}),
                  joint_states(TIMES[::2], {"upper_mass": [y[::2]]}),
                  joint_states(TIMES[1::2], {"crank": [TIMES[1::2], TIMES[1::2]], "upper_mass": [y[1::2], V[1::2]]}),
                  joint_states(TIMES + 3e-4, {"inclined_mass": [holed]}))
    recording = read_recording(bag, DAMPED)
    assert not any("unreadable" in line for line in recording.said)
    upper = channel_of(recording, "joint_states.upper_position")
    np.testing.assert_array_equal(upper.values, y)
    np.testing.assert_allclose(upper.times, TIMES - TIMES[0], rtol=0, atol=1e-9)
    speed = channel_of(recording, "joint_states.upper_velocity")
    np.testing.assert_array_equal(speed.values, V[1::2])
    np.testing.assert_allclose(speed.times, TIMES[1::2] - TIMES[0], rtol=0, atol=1e-9)
    inclined = channel_of(recording, "joint_states.inclined_position")
    np.testing.assert_array_equal(inclined.values, np.delete(z, 7))
    np.testing.assert_allclose(inclined.times, np.delete(TIMES, 7) + 3e-4 - TIMES[0], rtol=0, atol=1e-9)


def encoder(times, speed, lowest=None):
    """Return rows of an encoder at this speed [rad/s]; `lowest` is the least angle of one that is within a turn."""
    angle = speed * (times - times[0])
    angle = angle if lowest is None else (angle - lowest) % math.tau + lowest
    return joint_states(times, {"crank": [math.tau / 4096 * np.round(angle / (math.tau / 4096))]}, "encoder")


@pytest.mark.parametrize("lowest", [-math.pi, 0.0])
def test_an_angle_within_one_turn_is_unwrapped_where_samples_are_dense_enough(tmp_path, lowest):
    scene, command = DAMPED.with_parameters({"motor.speed": 60.0}), numbers("motor_speed", [(1.0, 60.0)])
    bag = written(tmp_path / "bag", encoder(TIMES, 60.0, lowest), list(command))
    recording = read_recording(bag, scene)
    (unwrapped,) = recording.channels
    counted = read_recording(written(tmp_path / "counted", encoder(TIMES, 60.0)), scene).channels[0]
    np.testing.assert_allclose(unwrapped.values - unwrapped.values[0], counted.values, rtol=0, atol=1e-9)
    assert (unwrapped.resolution, unwrapped.sigma) == (counted.resolution, counted.sigma)
    assert any("crank_angle: is given within one turn, and is unwrapped" in line for line in recording.said)
    sparse = TIMES[::35]  # 14.3 Hz: 4.2 rad between two samples
    bag = written(tmp_path / "sparse", encoder(sparse, 60.0, lowest))
    with pytest.raises(BagError, match="/encoder: crank_angle is within one turn, and the crank turns by 4.2 rad in "
                       "0.07 s between two samples, so that turns are not known; record at 22 Hz at least"):
        read_recording(bag, scene)
    paused = np.concatenate([TIMES, TIMES + 60.0])
    with pytest.raises(BagError, match="without a pause while it turns, or count the angle on"):
        read_recording(written(tmp_path / "paused", encoder(paused, 60.0, lowest)), scene)
    both = joint_states(TIMES[100:], {"crank": [60.0 * (TIMES[100:] - TIMES[0]) + noise(1e-3, 900)]})
    encoded, measured = read_recording(written(tmp_path / "both", encoder(TIMES, 60.0, lowest), both), scene).channels[
        ::-1]
    assert np.abs(encoded.values[100:] - measured.values).max() < 0.01  # both count from the same turn


@pytest.mark.parametrize("recorded", [True, False], ids=["header alone", "recorded as well"])
def test_a_stamp_that_was_never_set_and_copies_of_two_recorders_are_left_out_and_counted(tmp_path, recorded):
    def unset(message):
        message.header.stamp.sec = message.header.stamp.nanosec = 0

    rows = list(odometry(TIMES, X, V, (1e-8, 1e-6)))
    plain = read_recording(written(tmp_path / "plain", rows), DAMPED)
    for k in (0, 500):
        topic, at, data = changed(rows[k], "odom", unset)
        rows[k] = topic, at if recorded else 0, data
    copies = [(topic, at + 3_000_000, data) for topic, at, data in rows[100:400]]  # between later ones of the other
    recording = read_recording(written(tmp_path / "bag", rows, copies), DAMPED)
    kept = np.delete(np.arange(1000), [0, 500])
    for channel, whole in zip(recording.channels, plain.channels, strict=True):
        np.testing.assert_array_equal(channel.values, whole.values[kept])
        np.testing.assert_allclose(channel.times, whole.times[kept] - whole.times[1], rtol=0, atol=1e-6)
        assert channel.sigma == whole.sigma
    assert "/odom: 2 of 1300 messages left out, because the stamp was never set" in recording.said
    assert any(line.startswith("/odom: 300 of 1300 messages left out, because it is a copy") for line in recording.said)


def swapped(rows):
    """The stamps of two headers are exchanged."""
    rows = list(rows)
    rows[20], rows[21] = ((rows[20][0], rows[20][1], rows[21][2]), (rows[21][0], rows[21][1], rows[20][2]))
    return rows


def hole(values):
    values = values.copy()
    values[7] = math.nan
    return values


RESET = holding(TOPICS["operations"].type, "reset")
HOSTILE = {
    "no sensor": (lambda: [numbers("motor_speed", [(1.0, 50.0)])], "measures nothing of a robot; record one of odom"),
    "few": (lambda: [tracking(TIMES[:9], X[:9])], "/tracking: has 9 messages; record at least 10"),
    "nan": (lambda: [odometry(TIMES, hole(X), V)], "/odom: body_position is not finite"),
    "backwards": (lambda: [swapped(tracking(TIMES, X))], "/tracking: its stamps do not increase at message 22"),
    "clock": (lambda: [[(topic, at + 2 * 10**9, data) for topic, at, data in tracking(TIMES, X)]],
              "stamps are more than 1 s away"),
    "two robots": (lambda: [odometry(TIMES, X, V, topic="/a/odom"), odometry(TIMES, X, V, topic="/b/odom")],
                   "measures two robots, /a/odom and /b/odom; record one of them: ros2 bag record --regex '/b/"),
    "no such mass": (lambda: [joint_states(TIMES, {"upper_mass": [X]})], "upper_mass, which the scene does not have"),
    "no dc motor": (lambda: [numbers("motor_current", zip(TIMES, X, strict=True))], "choose effects.motor dc"),
    "reset": (lambda: [tracking(TIMES, X), [("/robot/operations", stamp(1.5), RESET)]],
              "0.500 s after its first message the robot had the operation reset"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_bag_that_cannot_be_used_is_refused_in_one_line(tmp_path, name):
    rows, why = HOSTILE[name]
    scene = DAMPED.with_parameters({"effects.upper_mass": False}) if name == "no such mass" else DAMPED
    with pytest.raises(BagError) as refused:
        read_recording(written(tmp_path / "bag", *rows()), scene)
    assert why in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_folder_without_a_bag_is_refused(tmp_path):
    with pytest.raises(BagError):
        read_recording(tmp_path / "none", DAMPED)


def test_what_a_twin_has_computed_is_no_measurement_and_stamps_may_be_missing(tmp_path):
    rows = [*odometry(TIMES, X, V, (1e-8, 1e-6)), *odometry(TIMES, 2.0 * X, V, topic="/twin/odom")]
    recording = read_recording(written(tmp_path / "bag", rows), DAMPED)
    np.testing.assert_array_equal(recording.channels[0].values, X)
    unstamped = [(topic, stamp(time), data) for time, (topic, _, data) in zip(
        TIMES, tracking(np.full(len(TIMES), 1.0), X), strict=True)]
    recording = read_recording(written(tmp_path / "unstamped", unstamped), DAMPED)
    np.testing.assert_allclose(recording.channels[0].times, TIMES - 1.0, rtol=0, atol=1e-9)
    assert any("no stamps" in sentence for sentence in recording.said)
