"""The device with its sensors, each of which measures at its own instants and releases measurements after a delay.

A sensor measures sample k exactly at k / rate since the start, whatever else the device is asked for in between.
All that is random about sample k follows from the seed, the sensor's name and k (`sensors.noise`). So a sensor's
bits do not depend on how time is divided into calls or on other sensors, and are the same in every replay.

A measurement comes out when its delay has passed. A fault of a sensor acts at that instant.
"""

import math
from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from vibro_ros.model.faults import check_lasting, checked_incident, part_of
from vibro_ros.model.scene import Scene, check_scene
from vibro_ros.sensors.noise import BlockNumbers, InertialErrors, Stream, force_at_rest, of_imu
from vibro_ros.simulation.samples import FIELDS, LATEST, Samples, checked_times
from vibro_ros.simulation.simulator import Simulator

_ANGLE, _X, _HEIGHT, _POWER = (FIELDS.index(name) for name in (
    "crank_angle", "body_position", "body_height", "electrical_power"))

DROPOUT, FREEZE, OFFSET = FAULTS = "sensor_dropout", "sensor_freeze", "sensor_offset"
"""The faults of `model.faults.FAULTS` that affect sensors."""

_NEVER = -1e12  # index of the last dropout if there was none


class Measurement(NamedTuple):
    """One measurement that has come out: the sensor, the instant [s] at which it was measured, and the values.

    `imu`, shape (8,): specific force [m/s²] along x, y, z, angular rate [rad/s] about them, and the variances of the
    errors of both, on each axis. `encoder`, shape (2,): the crank's angle [rad] and speed [rad/s]. `current`, shape
    (2,): current of a dc motor's supply [A], negative while the motor brakes, and its voltage [V]. `tracking`, shape
    (4,): the body's position x, y, z [m], and the variance of each coordinate.
    """

    sensor: str
    time: float
    values: np.ndarray


class Sensor:
    """Base class of the sensors.

    A measurement comes out after a `delay` [s], and needs `history` numbers of earlier measurements. `count` is the
    number of measurements so far; `failing` has the instant [s] at which each fault ends, or has ended.
    """

    name = ""
    numbers = 0  # numbers of a measurement
    shifted = 0  # how many of the numbers, from the first on, the fault `OFFSET` shifts

    def __init__(self, scene: Scene, delay: float, history: int = 0):
        self.rate, self.count, self.history = scene[f"sensors.{self.name}.rate"], 0, np.zeros(history)
        self._delay, self._released = delay, 0  # number of measurements that came out or dropped out
        self._recent: deque[np.ndarray | None] = deque([None] * (math.ceil(delay * self.rate) + 2))
        self.failing, self._offset = dict.fromkeys(FAULTS, 0.0), 0.0
        self._last: np.ndarray | None = None  # the last measurement that came out

    @property
    def due(self) -> float:
        """Instant [s] of the next measurement."""
        return self.count / self.rate

    def measure(self, device: Simulator) -> None:
        """Measure at the instant `due`, to which the device has been advanced."""
        self._recent.popleft()
        self._recent.append(self.read(device))
        self.count += 1

    def read(self, device: Simulator) -> np.ndarray | None:
        """Return the values of sample `count`, shape (numbers,); None if the sample drops out."""
        raise NotImplementedError

    def release(self, time: float) -> Iterator[Measurement]:
        """Yield the measurements that come out up to `time` [s] and have not come out before."""
        while self._released < self.count and self._released / self.rate + self._delay <= time:
            values, measured_at = self._recent[self._released - self.count], self._released / self.rate
            self._released += 1
            failing = {fault for fault, until in self.failing.items() if measured_at + self._delay < until}
            if values is None or DROPOUT in failing:
                continue
            if FREEZE in failing and self._last is not None:
                values = self._last
            elif OFFSET in failing:
                values = values.copy()
                values[:self.shifted] += self._offset
            self._last = values
            yield Measurement(self.name, measured_at, values)

    def fail(self, fault: str, until: float, value: float) -> None:
        """Start a fault that lasts until the instant `until` [s]; `value` is the offset of `OFFSET`."""
        self.failing[fault] = until
        if fault == OFFSET:
            self._offset = value

    # For checkpoints. The number of measurements that have come out follows from the time.

    def memory(self) -> np.ndarray:
        """Return all that the future depends on besides device, scene and time; its length is constant."""
        no_values = np.full(self.numbers, np.nan)
        rows = [no_values if row is None else row for row in (self._last, *self._recent)]
        return np.concatenate([[self.count, *self.failing.values(), self._offset], self.history, *rows])

    def restore(self, memory: np.ndarray, time: float) -> None:
        """Go on from a `memory` at `time` [s] (ValueError: a memory that no sensor can have; nothing is changed)."""
        begin = 2 + len(self.failing) + len(self.history)
        count, *numbers = memory[:begin].tolist()
        rows = memory[begin:].reshape(-1, self.numbers)
        has_values = np.isfinite(rows).all(axis=1)
        if not (np.isfinite(memory[:begin]).all() and count == self._measured_by(time, 0.0)
                and (has_values | np.isnan(rows).all(axis=1)).all()):
            raise ValueError(f"the checkpoint is of no state that the sensor {self.name} can be in; give one that a "
                             "device of the same scene has made")
        self.count, self._released = int(count), self._measured_by(time, self._delay)
        self.failing = dict(zip(self.failing, numbers, strict=False))
        self._offset, *self.history[:] = numbers[len(self.failing):]
        self._last, *recent = (row if has else None for row, has in zip(rows.copy(), has_values, strict=True))
        self._recent = deque(recent)

    def _measured_by(self, time: float, delay: float) -> int:
        """Return the number of measurements that are at least `delay` [s] old at `time` [s]."""
        count = max(0, math.floor((time - delay) * self.rate) - 1)
        while count / self.rate + delay <= time:
            count += 1
        return count


class Imu(Sensor):
    """Accelerometer and gyroscope of a body that does not turn."""

    name, numbers, shifted = "imu", 8, 3

    def __init__(self, scene: Scene):
        super().__init__(scene, scene["sensors.imu.delay"])
        self._at_rest = force_at_rest(scene)
        self._accelerometer, self._gyroscope = (InertialErrors(scene, part) for part in ("accelerometer", "gyroscope"))

    def read(self, device: Simulator) -> np.ndarray:
        """See `Sensor`."""
        along, up = device.filtered_acceleration()
        true, index = (along + self._at_rest[0], 0.0, up + self._at_rest[1]), self.count
        return np.array([*self._accelerometer.read(true, index), *self._gyroscope.read((0.0, 0.0, 0.0), index),
                         self._accelerometer.variance(index), self._gyroscope.variance(index)])


class Encoder(Sensor):
    """An incremental encoder on the crank, which counts from 0 at the start."""

    name, numbers, shifted = "encoder", 2, 1

    def __init__(self, scene: Scene):
        rate, window = scene["sensors.encoder.rate"], scene["sensors.encoder.velocity_window"]
        super().__init__(scene, 0.0, 1 + max(1, round(window * rate)))
        self._tick = 2.0 * math.pi / scene["sensors.encoder.ticks"]

    def read(self, device: Simulator) -> np.ndarray:
        """See `Sensor`."""
        history = self.history
        history[:-1] = history[1:]
        history[-1] = round(device.values.item(_ANGLE) / self._tick)
        over = min(self.count, len(history) - 1)
        speed = (history[-1] - history[-1 - over]) * self.rate / over if over else 0.0
        return self._tick * np.array([history[-1], speed])


class Current(Sensor):
    """Current and voltage of a dc motor's supply, whose power is that of the motor, because the drive has no losses."""

    name, numbers, shifted = "current", 2, 1

    def __init__(self, scene: Scene):
        super().__init__(scene, 0.0)
        limit, self._noise, self._resolution, self._resistance = (scene[f"sensors.current.{name}"] for name in (
            "range", "noise", "resolution", "supply_resistance"))
        self._range = limit or math.inf
        self._errors = BlockNumbers(Stream(int(scene["sensors.seed"]), "current/noise").normal)

    def read(self, device: Simulator) -> np.ndarray:
        """See `Sensor`."""
        supply = device.supply_voltage
        true = device.values.item(_POWER) / supply
        value = min(max(true, -self._range), self._range) + self._noise * self._errors[self.count][0]
        if self._resolution:
            value = self._resolution * round(value / self._resolution)
        return np.array([value, supply - self._resistance * true])


class Tracking(Sensor):
    """A tracking system beside the robot, such as a camera, which measures the body's position."""

    name, numbers, shifted = "tracking", 4, 3

    def __init__(self, scene: Scene):
        super().__init__(scene, scene["sensors.tracking.latency"], 1)
        self.history[0] = _NEVER  # index at which the last dropout began
        self._noise, self._probability, self._duration = (scene[f"sensors.tracking.{name}"] for name in (
            "noise", "dropout_probability", "dropout_duration"))
        seed = int(scene["sensors.seed"])
        self._errors = BlockNumbers(Stream(seed, "tracking/noise").normal)
        self._chances = BlockNumbers(Stream(seed, "tracking/dropout").uniform)

    def read(self, device: Simulator) -> np.ndarray | None:
        """See `Sensor`."""
        if self._chances[self.count][0] < self._probability:
            self.history[0] = self.count
        if (self.count - self.history[0]) / self.rate < self._duration:
            return None
        values, errors = device.values, self._errors[self.count]
        place = (values.item(_X), 0.0, values.item(_HEIGHT))
        return np.array([*(true + self._noise * error for true, error in zip(place, errors, strict=False)),
                         self._noise * self._noise])


KINDS = {kind.name: kind for kind in (Imu, Encoder, Current, Tracking)}  # classes of sensors by name


def sensors_on(scene: Scene) -> tuple[str, ...]:
    """Return the names of the sensors that are on in a scene."""
    return tuple(name for name in KINDS if scene[f"sensors.{name}.rate"] > 0.0)


class SensedSimulator(Simulator):
    """A `Simulator` with the sensors of its scene; its motion is that of a `Simulator`, to the last bit.

    Parameters
    ----------
    scene : Scene
        The scene to simulate. A sensor is on if its `sensors.*.rate` is above 0.

    Examples
    --------
    >>> scene = vibro_ros.load_scene("device").with_parameters({"motor.speed": 100.0, "sensors.encoder.rate": 500.0})
    >>> device = vibro_ros.SensedSimulator(scene)
    >>> device.advance_to(0.004)
    >>> for sensor, time, values in device.take_measurements():
    ...     print(sensor, time, values.round(4))
    encoder 0.0 [0. 0.]
    encoder 0.002 [ 0.1994 99.7088]
    encoder 0.004 [  0.4004 100.0922]
    """

    def __init__(self, scene: Scene):
        check_scene(scene)
        names = sensors_on(scene)
        super().__init__(scene, of_imu(scene, "bandwidth") if Imu.name in names else 0.0)
        self._names = names
        self._begin()

    def _begin(self) -> None:
        """Create the sensors, and take the measurements that are due now."""
        self._sensors = {name: KINDS[name](self.scene) for name in self._names}
        self._pending: list[Measurement] = []
        self._measure_up_to(self.time)

    def take_measurements(self) -> list[Measurement]:
        """Return the measurements that have come out since the last call; those of one sensor are in order.

        Examples
        --------
        >>> scene = vibro_ros.load_scene("device").with_parameters({"sensors.tracking.rate": 100.0})
        >>> device = vibro_ros.SensedSimulator(scene)
        >>> device.advance_to(1.0)
        >>> len(device.take_measurements()), len(device.take_measurements())
        (101, 0)
        """
        taken, self._pending = self._pending, []
        return taken

    def fail(self, fault: str, duration: float, of: str = "", value: float = 0.0, from_x: float = 0.0,
             to_x: float = 0.0) -> None:
        """Start a fault of the device, as `Simulator.fail`, or of a sensor, for measurements that come out meanwhile.

        `sensor_dropout`: nothing comes out. `sensor_freeze`: the last measurement comes out again and again.
        `sensor_offset`: `value` is added to the measured values: the specific force on each axis [m/s²], the crank's
        angle [rad], the current [A], or each coordinate [m]. The sensor that fails is `of`: `imu`, `encoder`,
        `current` or `tracking`.

        Examples
        --------
        >>> scene = vibro_ros.load_scene("device").with_parameters({"sensors.tracking.rate": 100.0})
        >>> device = vibro_ros.SensedSimulator(scene)
        >>> device.fail("sensor_dropout", duration=0.5, of="tracking")
        >>> device.disturbances
        {'sensor_dropout of tracking': 0.5}
        >>> device.advance_to(1.0)
        >>> len(device.take_measurements())  # of 101; the first came out before the fault
        52
        """
        incident = checked_incident(fault, duration, of, value, from_x, to_x)
        if incident.fault not in FAULTS:
            super().fail(*incident)
        elif incident.of not in self._sensors:
            raise ValueError(f"of: the sensor {incident.of} is off; give {' or '.join(self._sensors) or 'none'}, or "
                             f"start the robot with a sensors.{incident.of}.rate above 0 Hz")
        else:
            check_lasting(incident.fault, incident.of, incident.duration, self.disturbances)
            self._sensors[incident.of].fail(incident.fault, self.time + incident.duration, incident.value)

    @property
    def disturbances(self) -> dict[str, float]:
        """Active disturbances, as `Simulator.disturbances`, with faults of sensors."""
        lasting = {part_of(fault, name): until for name, sensor in self._sensors.items()
                   for fault, until in sensor.failing.items() if until > self.time}
        return {**super().disturbances, **lasting}

    def advance_to(self, time: float) -> None:
        """Advance as `Simulator.advance_to`; sensors measure at their instants until then."""
        time = float(time)
        if time <= LATEST:  # else refused below
            self._measure_up_to(time)
        if time != self.time:
            super().advance_to(time)
        for sensor in self._sensors.values():
            self._pending += sensor.release(self.time)

    def _measure_up_to(self, time: float) -> None:
        """Let every sensor measure at its instants up to `time` [s], the earliest first."""
        while True:
            due = min((sensor.due for sensor in self._sensors.values()), default=math.inf)
            if not due <= time:
                return
            super().advance_to(due)
            for sensor in self._sensors.values():
                if sensor.due == due:
                    sensor.measure(self)
                self._pending += sensor.release(due)

    def sample(self, times: np.ndarray) -> Samples:
        """Advance and sample as `Simulator.sample`; sensors measure at their instants."""
        rows = np.empty((len(FIELDS), len(times)))
        for k, time in enumerate(checked_times(times, self.time)):
            self.advance_to(time)
            rows[:, k] = self.values
        return Samples(*rows)

    def reset(self, /, **given: float) -> None:
        """Reset as `Simulator.reset`; sensors start again, with the same noise as at the first start."""
        super().reset(**given)
        self._begin()

    def checkpoint(self) -> np.ndarray:
        """Return a checkpoint as `Simulator.checkpoint`, with the state of the sensors."""
        return np.concatenate([super().checkpoint(), *(sensor.memory() for sensor in self._sensors.values())])

    def restore(self, checkpoint: np.ndarray) -> None:
        """Restore as `Simulator.restore`, with the sensors; measurements that were not taken are dropped."""
        memories = [sensor.memory() for sensor in self._sensors.values()]
        previous = super().checkpoint()
        if np.ndim(checkpoint) != 1:
            raise ValueError(f"the checkpoint has shape {np.shape(checkpoint)}, this device's have one dimension; give "
                             "one of the same scene and version")
        ends = len(checkpoint) - np.cumsum([0, *(len(memory) for memory in memories[::-1])])[::-1]
        super().restore(checkpoint[:max(0, ends[0])])
        try:
            for sensor, begin, end in zip(self._sensors.values(), ends, ends[1:], strict=False):
                sensor.restore(checkpoint[begin:end], self.time)
        except ValueError:
            super().restore(previous)
            for sensor, memory in zip(self._sensors.values(), memories, strict=True):
                sensor.restore(memory, self.time)
            raise
        self._pending.clear()


def new_device(scene: Scene) -> Simulator:
    """Return the device of a scene: a `SensedSimulator` if a sensor is on, else a `Simulator`, which costs less."""
    return SensedSimulator(scene) if sensors_on(scene) else Simulator(scene)
