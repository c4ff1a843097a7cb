"""A bag comes in; the measured channels with their noise, and the commands, go out.

A channel is one measured number over time, under the name of the field of `Samples` that it measures. The topics are
those of the robot, so that a recording of a laboratory and one of the virtual device are read alike. The standard
deviation of a channel's noise is the one that is given, or that of the covariances in the messages, or is estimated
from neighbouring values by `noise_of`; `Recording.said` says which.
"""

import math
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from vibro_lab.identification.noise import is_measured, noise_of, resolution_of
from vibro_ros import (
    COMMANDS,
    JOINTS,
    PARAMETERS,
    TOPICS,
    BagError,
    BagStream,
    Scene,
    check_scene,
    commands_in,
    deserialised,
    joints_of,
    of_imu,
    quoted,
    read_bag,
    read_operation,
    robot_topics,
    simulate,
)

FEWEST = 10
"""Fewest samples of a channel."""
LARGEST = 1e9
"""Largest magnitude of a measured number."""
LARGEST_SPREAD = 1.3
"""Largest spread of the estimates of noise, beyond which the motion is larger than the noise."""
AT_MOST = "at most"
_MOST_OF_MOTION = 0.25  # share of a channel's standard deviation up to which neighbours may tell its noise
LATEST = 1.0
"""Longest time [s] between a message's stamp and its recording; beyond it, two clocks disagree."""
_CLOSE, _BEYOND = 3.0, 1.1  # standard deviations before an IMU's range where it may clip; and times it, never reached
_NEVER_SET = 1e-6  # s from 0 in ROS time
ONE_TURN = 1.01 * math.tau
"""Largest range [rad] of an angle that is given within one turn, with a sensor's noise."""
_MOST_TURNED = 0.9 * math.pi  # between two samples of such an angle: from half a turn on the direction is not known
IMU, OPERATIONS = "imu/data_raw", "operations"
Arrays = dict[str, np.ndarray]
SENSORS: Mapping[str, tuple[str, ...]] = {
    "odom": ("stamp", "position", "linear_velocity", "position_variance", "linear_velocity_variance"),
    "tracking": ("stamp", "position", "variance"), "joint_states": ("stamp", "*.position", "*.velocity"),
    "encoder": ("stamp", "*.position"), IMU: ("stamp", "acceleration", "acceleration_variance"),
    "motor_current": ("value",)}
"""Topics that measure, with the columns of `read_bag` that are used."""


@dataclass(frozen=True)
class Channel:
    """One measured number over time.

    Attributes
    ----------
    sensor : str
        The topic without its namespace: a key of `SENSORS`.
    field : str
        The field of `Samples` that it measures; or `acceleration_x` or `acceleration_z`, the specific force [m/s²]
        that the low-pass of an IMU lets pass.
    times : ndarray, shape (n,)
        Instants of measurement [s] since `Recording.start`, ascending.
    values : ndarray, shape (n,)
    sigma : float
        Standard deviation of the noise.
    sigma_from : str
        Where it comes from: `given`, `covariance`, `resolution` or `neighbours`; `AT_MOST` if neighbours tell only a
        bound, because the motion between two samples is larger than the noise.
    resolution : float
        Step of a quantised channel, such as an encoder's tick; 0 without one.
    bandwidth, limit, bias : float
        Of an IMU: bandwidth [Hz] of its low-pass; magnitude from which on a value only says that the force is not
        smaller, because the sensor clips; and standard deviation of a constant error, which differs from start to
        start. The noise does not include that error.
    """

    sensor: str
    field: str
    times: np.ndarray
    values: np.ndarray
    sigma: float
    sigma_from: str
    resolution: float = 0.0
    bandwidth: float = 0.0
    limit: float = math.inf
    bias: float = 0.0


@dataclass(frozen=True)
class Recording:
    """The measured channels of a bag, and the commands.

    Attributes
    ----------
    start : float
        ROS time [s] of time 0, the first measurement.
    duration : float
        Time [s] from the first measurement to the last.
    channels : tuple of Channel
    commands : tuple of (float, dict)
        As `simulate` takes them; those before the first measurement are at 0.
    said : tuple of str
        Sentences: what was read, what was left out and why, and where each noise comes from.
    """

    start: float
    duration: float
    channels: tuple[Channel, ...]
    commands: tuple[tuple[float, dict[str, float]], ...]
    said: tuple[str, ...]


def read_recording(bag: str | Path, scene: Scene, noise: Mapping[str, float] | None = None) -> Recording:
    """Read what a bag has measured of a robot, and what the robot was commanded.

    Parameters
    ----------
    bag : str or Path
        A bag folder, of the robot's recorder or of ``ros2 bag record``, in any one namespace.
    scene : Scene
        The scene that is to move as the recording does.
    noise : mapping of str to float, optional
        Standard deviations by sensor (``tracking``) or by channel (``odom.body_velocity``), in the channel's unit;
        infinity leaves the sensor or the channel out.

    Raises
    ------
    BagError
        When the bag cannot be read, measures nothing, measures two robots, or does not fit the scene.
    ValueError
        For a noise that is not above 0, or of a channel that the recording does not have.

    Examples
    --------
    >>> recording = read_recording("laboratory_bag", vibro_ros.load_scene("damped"), noise={"tracking": 0.001})
    >>> for sentence in recording.said:
    ...     print(sentence)
    """
    check_scene(scene)
    noise, said = dict(noise or {}), list[str]()
    if wrong := [key for key, sigma in noise.items() if not (isinstance(sigma, int | float) and sigma > 0.0)]:
        raise ValueError(f"noise of {wrong[0]}: {quoted(noise[wrong[0]])} is no standard deviation; give a number "
                         "above 0, or inf to leave it out")
    with BagStream(bag) as stream:
        topics = _topics(stream)
        commands = _commands(stream, topics, scene, said)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the flaws are in `said`
        read = read_bag(bag, {topics[name].rpartition("/")[2]: SENSORS[name] for name in SENSORS if name in topics})
    said += [f"{read.path}: {flaw}" for flaw in read.flaws[:3]]
    channels, known, within_a_turn = list[Channel](), set(), set[str]()
    for sensor in (name for name in SENSORS if name in topics and topics[name] in read.arrays):
        arrays, topic = read.arrays[topics[sensor]], f"{read.path}: {topics[sensor]}"
        known.add(sensor)
        if not len(arrays["time"]) or noise.get(sensor) == math.inf:
            said.append(f"{sensor} is left out: it has no message" if not len(arrays["time"]) else
                        f"{sensor} is left out, as its noise says")
            continue
        try:
            for part in read.series(topics[sensor]):
                instants: tuple[np.ndarray, np.ndarray] | None = None
                for field, values, variances in _measured(sensor, part, scene, said):
                    known.add(name := f"{sensor}.{field}")
                    given = noise.get(name, noise.get(sensor))
                    if given == math.inf:
                        said.append(f"{name} is left out, as its noise says")
                        continue
                    if len(part["time"]) < min(FEWEST, len(arrays["time"])):  # one joint of many
                        said.append(f"{name} is left out: {len(part['time'])} messages name it; record at least "
                                    f"{FEWEST}")
                        continue
                    times, rows = instants = instants or _times(topics[sensor], part, read.start_ns, said)
                    values, variances = values[rows], variances if variances is None else variances[rows]
                    if field == "crank_angle" and _is_within_a_turn(values[np.isfinite(values)]):
                        within_a_turn.add(name)
                    if channel := _channel(sensor, field, times, values, variances, given, scene, said):
                        channels.append(channel)
        except ValueError as error:
            raise BagError(f"{topic}: {error}") from None
    if unknown := noise.keys() - known:
        raise ValueError(f"noise of {min(unknown)}: the recording has no such channel; give {', '.join(sorted(known))}")
    if not channels:
        raise BagError(f"{read.path}: measures nothing of a robot; record one of {', '.join(SENSORS)} with "
                       f"the types of docs/guide/node.md (topics in the bag: {', '.join(read.topics) or 'none'})"
                       + "".join(f"; {line}" for line in said if "left out" in line))
    first = min(float(channel.times[0]) for channel in channels)
    last = max(float(channel.times[-1]) for channel in channels)
    begin = read.start_ns + round(first * 1e9)
    since = _since(begin, commands, scene, said)
    moved = [replace(channel, times=channel.times - first) for channel in channels]
    for channel in moved:
        if f"{channel.sensor}.{channel.field}" in within_a_turn:
            _check_turns(f"{read.path}: {topics[channel.sensor]}", channel, scene, since)
    return Recording(begin * 1e-9, last - first, tuple(_with_one_zero(moved)), since, tuple(dict.fromkeys(said)))


def _topics(stream: BagStream) -> dict[str, str]:
    """Return the full names of the topics that are read, by their keys in `TOPICS` (BagError: of two robots)."""
    wanted, topics = {*SENSORS, *COMMANDS, OPERATIONS}, dict[str, str]()
    if "topics" in stream.metadata:
        return {name: topic for name, topic in robot_topics(stream).items()
                if name in wanted and topic in stream.topics}
    for topic, recorded in stream.topics.items():
        for name in (key for key in wanted if topic.endswith(f"/{key}") and recorded.type_name == TOPICS[key].type):
            if "/twin/" in topic:  # what the executable `twin` has computed is no measurement
                continue
            if name in topics:
                other = topic.removesuffix(name)
                raise BagError(f"{stream.folder}: measures two robots, {topics[name]} and {topic}; record one of them: "
                               f"ros2 bag record --regex '{other}.*'")
            topics[name] = topic
    return topics


def _commands(stream: BagStream, topics: Mapping[str, str], scene: Scene,
              said: list[str]) -> list[tuple[int, dict[str, float]]]:
    """Return the commands that the robot has taken, with their recorded stamps [ns]."""
    names = {topics[name]: name for name in (*COMMANDS, OPERATIONS) if name in topics}
    commands, refused = [], Counter[str]()
    for topic, stamp, data in stream.messages(frozenset(names)):
        given: Mapping[str, float] = {}
        try:
            message = deserialised(data, TOPICS[names[topic]].type)
            if names[topic] != OPERATIONS:
                given, _ = commands_in(names[topic], message, scene)
            elif (operation := read_operation(message.data)).name == "timeout":
                given = {scene.motor_command: 0.0}
            elif operation.name not in ("pause", "resume", "step"):
                raise BagError(f"{stream.folder}: {(stamp - stream.start) * 1e-9:.3f} s after its first message the "
                               f"robot had the operation {operation.name}, and is another one from there on; record "
                               "without it")
            commands.append((stamp, {name: scene.checked_command(name, value) for name, value in given.items()}))
        except ValueError as error:  # a robot refuses them as well
            refused[f"{topic}: {error}"] += 1
    said += [f"{count} of the commands would be refused: {why}" for why, count in refused.most_common(3)]
    return [(stamp, given) for stamp, given in commands if given]


def _since(begin: int, commands: list[tuple[int, dict[str, float]]], scene: Scene,
           said: list[str]) -> tuple[tuple[float, dict[str, float]], ...]:
    """Return the commands by their time [s] since the stamp `begin` [ns], those of one instant together."""
    by_time: dict[float, dict[str, float]] = {}
    for stamp, given in commands:
        by_time.setdefault(max(0, stamp - begin) * 1e-9, {}).update(given)
    wanted = (scene.motor_command, *(f"{side}_gap" for side in scene.plates))
    if missing := [name for name in wanted if name not in by_time.get(0.0, {})]:
        said.append(f"no command of {', '.join(missing)} was recorded before the first measurement: until one "
                    "comes, a motor turns as the encoder says, and else the scene's values hold")
    return tuple(sorted(by_time.items()))


def _times(topic: str, arrays: Arrays, start: int, said: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return the instants [s] of a topic's measurements, the stamps in the headers if there are any; and the rows of
    the messages that count. Times in `arrays` count from the ROS time `start` [ns]."""
    recorded = arrays["time"]
    times = arrays.get("stamp", recorded)
    if times is recorded or (len(times) > 1 and np.ptp(times) == 0.0):
        said.append(f"{topic}: its messages have no stamps; the instants of recording are taken")
        times = recorded
    was_set = np.ones((2, len(times)), bool)
    if np.median(recorded) + start * 1e-9 > LATEST:  # else time itself began at 0, as a simulation's does
        was_set = np.abs(np.array([times, recorded]) + start * 1e-9) > _NEVER_SET
    counts = was_set[0] & ~(copies := _copies(times, arrays))
    for left_out, why in ((~was_set[0], "the stamp was never set"), (was_set[0] & copies, "it is a copy of another, as "
                                                                     "of two recorders")):
        if number := np.count_nonzero(left_out):
            said.append(f"{topic}: {number} of {len(times)} messages left out, because {why}")
    if counts.sum() < FEWEST:
        raise ValueError(f"has {counts.sum()} messages; record at least {FEWEST}, or give the noise inf to leave it "
                         "out")
    if late := np.count_nonzero((np.abs(recorded - times) > LATEST) & counts & was_set[1]):
        raise ValueError(f"{late} stamps are more than {LATEST:g} s away from their recording; set the clocks of both "
                         "computers, or use simulated time in both")
    rows = np.flatnonzero(counts)
    if not (steps := np.diff(times[rows]) > 0.0).all():
        raise ValueError(f"its stamps do not increase at message {rows[int(np.argmin(steps)) + 1] + 1}; record one "
                         "sensor a topic")
    return times[rows], rows


def _copies(times: np.ndarray, arrays: Arrays) -> np.ndarray:
    """Return which messages have the stamp and the numbers of an earlier one, shape (n,)."""
    _, first, of = np.unique(times, return_index=True, return_inverse=True)
    earlier = first[of]
    copies = earlier < np.arange(len(times))
    for name, column in arrays.items():
        if name != "time":
            same = (column == column[earlier]) | (np.isnan(column) & np.isnan(column[earlier]))
            copies &= same.reshape(len(times), -1).all(axis=1)
    return copies


def _measured(sensor: str, arrays: Arrays, scene: Scene,
              said: list[str]) -> Iterator[tuple[str, np.ndarray, np.ndarray | None]]:
    """Yield field, values and variances of what a sensor measures of the robot of the scene."""
    axes = [(0, "position", "x"), (2, "height", "z")][:1 + scene.body_hops]  # by the other rules z does not change
    if sensor in ("odom", "tracking"):
        variance = "variance" if sensor == "tracking" else "position_variance"
        for i, name, _ in axes:
            yield f"body_{name}", arrays["position"][:, i], arrays[variance][:, i]
        if sensor == "odom":
            for i, name in ((0, "body_velocity"), (2, "body_vertical_velocity"))[:len(axes)]:
                yield name, arrays["linear_velocity"][:, i], arrays["linear_velocity_variance"][:, i]
    elif sensor == IMU:
        bandwidth = "sensors.imu.bandwidth"
        if scene["sensors.preset"] == "ideal" and scene[bandwidth] == PARAMETERS[bandwidth].default:
            said.append(f"{sensor} is left out: the scene does not say which low-pass the IMU has, and so not what it "
                        "measures of a blow; give sensors.imu.bandwidth, or sensors.preset")
            return
        constant, first = of_imu(scene, "accelerometer.turn_on_bias"), arrays["acceleration_variance"][:, 0]
        for i, _, axis in axes:
            variances = np.where(first < 0.0, first, arrays["acceleration_variance"][:, i])  # the first is for all
            yield f"acceleration_{axis}", arrays["acceleration"][:, i], np.where(
                variances > constant**2, variances - constant**2, variances)
    elif sensor == "motor_current":
        if not scene.has_rotor:
            raise ValueError("is of a dc motor, and the scene has none; choose effects.motor dc, or give the noise "
                             "inf to leave it out")
        yield sensor, arrays["value"], None
    else:
        for name in (column for column in arrays if column not in ("time", "stamp")):
            joint, _, quantity = name.rpartition(".")
            if joint not in JOINTS or (sensor == "encoder" and joint != "crank"):
                said.append(f"{sensor}: {name} is left out: the robot has no such joint")
            elif joint not in joints_of(scene):
                raise ValueError(f"measures {joint}, which the scene does not have; choose a scene with it")
            elif quantity == "velocity" and np.isnan(arrays[name]).all():
                said.append(f"{sensor}: {name} is left out: it is never filled")
            else:
                yield JOINTS[joint][quantity == "velocity"], arrays[name], None


def _channel(sensor: str, field: str, times: np.ndarray, values: np.ndarray, variances: np.ndarray | None,
             given: float | None, scene: Scene, said: list[str]) -> Channel | None:
    """Return the channel of the numbers that were measured; None if these are too few, or were never filled."""
    name = f"{sensor}: {field}"
    known = np.ones(len(values), bool) if sensor in ("odom", "tracking", IMU) else ~np.isnan(values)
    if variances is not None:
        known &= is_measured(variances)
        variances = variances[known]
    times, values = times[known], values[known]
    if len(values) < FEWEST:
        said.append(f"{name} is left out: its variance, or NaN, says of {len(known) - len(values)} of {len(known)} "
                    "numbers that they are not measured")
        return None
    if field == "crank_angle" and _is_within_a_turn(values) and (np.abs(np.diff(values)) > math.pi).any():
        values = np.unwrap(values)
        said.append(f"{name}: is given within one turn, and is unwrapped")
    if not (np.abs(values) <= LARGEST).all():
        raise ValueError(f"{field} is not finite, or above {LARGEST:g}, {int((~(np.abs(values) <= LARGEST)).sum())} "
                         "times; leave such messages out, or give the noise inf")
    if not values.any():
        said.append(f"{name} is left out: it is always 0")
        return None
    resolution, source, more = resolution_of(field, values, scene), "given", ""
    if len(values) < len(known):
        more = f", {len(known) - len(values)} others not measured"
    if given is not None:
        sigma = given
    elif variances is not None and (stated := variances[variances > 0.0]).size:
        sigma, source = math.sqrt(float(np.median(stated))), "covariance"
        if stated.max() > 4.0 * stated.min():
            more += f", the median of {math.sqrt(stated.min()):.3g} to {math.sqrt(stated.max()):.3g}"
    elif resolution:
        sigma, source = resolution / math.sqrt(12.0), "resolution"
    else:
        (sigma, spread), source = noise_of(times, values), "neighbours"
        floor = 1e-4 if field.endswith(("velocity", "speed")) else 1e-6
        if sigma < floor:
            sigma, more = floor, f"{more}: it has hardly any noise, and what a fit resolves is taken"
        elif spread > LARGEST_SPREAD or sigma > _MOST_OF_MOTION * float(np.std(values)):
            source = AT_MOST
            more += ": at most, because the motion between two samples is larger; the fit takes it from its residuals"
    rate = 1.0 / np.median(np.diff(times))
    said.append(f"{name}: {len(times)} samples at {rate:.4g} Hz, noise {sigma:.3g} "
                f"({'neighbours' if source == AT_MOST else source}){more}"
                + (f", steps of {resolution:.4g}" if resolution else ""))
    if sensor != IMU:
        return Channel(sensor, field, times, values, sigma, source, resolution)
    reach, bias = of_imu(scene, "accelerometer.range") or math.inf, of_imu(scene, "accelerometer.turn_on_bias")
    if np.abs(values).max() > _BEYOND * reach:
        raise ValueError(f"sensors.imu.accelerometer.range: {reach:g} m/s² in the scene, {field} is up to "
                         f"{np.abs(values).max():g}; give the IMU's")
    return Channel(sensor, field, times, values, sigma, source, resolution, of_imu(scene, "bandwidth"),
                   max(reach - _CLOSE * math.hypot(sigma, bias), 0.0), bias)


def _is_within_a_turn(angles: np.ndarray) -> bool:
    """Return whether all angles [rad] lie within one turn, as those of a sensor that does not count turns."""
    return len(angles) > 0 and float(np.ptp(angles)) <= ONE_TURN


def _check_turns(topic: str, channel: Channel, scene: Scene,
                 commands: tuple[tuple[float, dict[str, float]], ...]) -> None:
    """Raise a BagError if the crank may turn by half a turn between two angles within one turn: then turns are lost."""
    run = simulate(scene, times=channel.times, commands=commands)
    turned = np.abs(np.diff(run.crank_angle))
    if (most := float(turned.max())) > _MOST_TURNED:
        pause = np.diff(channel.times)[turned.argmax()]
        rate = math.ceil(float(np.abs(run.motor_speed).max()) / _MOST_TURNED)
        raise BagError(f"{topic}: crank_angle is within one turn, and the crank turns by {most:.3g} rad in "
                       f"{pause:.3g} s between two samples, so that turns are not "
                       f"known; record at {rate} Hz at least, without a pause while it turns, or count the angle on")


def _with_one_zero(channels: list[Channel]) -> Iterator[Channel]:
    """Yield the channels; angles of the crank differ from those of the first such channel by less than a turn."""
    first = next((channel for channel in channels if channel.field == "crank_angle"), None)
    for channel in channels:
        if first and channel.field == "crank_angle":
            away = float(np.median(channel.values - np.interp(channel.times, first.times, first.values)))
            channel = replace(channel, values=channel.values - math.tau * round(away / math.tau))
        yield channel
