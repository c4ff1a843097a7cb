"""The errors of sensors: data of real parts, the errors of an inertial sensor, and counter-based random numbers.

An inertial sensor clips, adds bias and noise, and quantises. The accelerometer's low-pass comes before that, because
it is solved with the motion (`solver.lowpass`), and the delay after it (`sensors.device`).

The k-th number of a stream is a function of the seed, the stream's name and k alone. So a stream does not depend on
another one, on the instants at which it is read, or on how time is divided into calls. The generator is numpy's Philox
4x64 (J. Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", 2011); numpy promises the bits of `random_raw`,
but not those of its normal numbers.
"""

import hashlib
import math
from collections.abc import Callable, Sequence

import numpy as np

from vibro_ros.model.parameters import AS_PRESET
from vibro_ros.model.scene import Scene
from vibro_ros.solver.elementary import log

BLOCK = 128  # samples whose numbers are made together, because a call of numpy costs as much as some hundred of them
LANES = 4  # random numbers per sample: as many as Philox makes of one counter
ACCELERATIONS = ("acceleration_x", "acceleration_z")
"""Names of an IMU's specific force along x and upwards, where it is measured beside fields of `Samples`."""
FORGETTING = 2.0
"""Times 1 / bandwidth after which an IMU's low-pass has forgotten all but 1e-4 of how it began."""
_WHOLE = 1 << 256

_G = 9.80665  # m/s², the unit of data sheets
_DEGREE = math.pi / 180.0

#: Numbers of real parts in SI units, by parameter. A typical offset counts as one standard deviation. Data sheets do
#: not give the drift of the bias; the values here are round numbers of the size that Allan deviations of such parts
#: show.
PRESETS: dict[str, dict[str, float]] = {
    "ideal": {"bandwidth": 1e4},
    # Bosch Sensortec, BST-BMI270-DS000-07 (2023): 16 bits over ±16 g and ±2000 °/s, 160 µg/√Hz, 7 m°/s/√Hz, ±20 mg,
    # ±0.5 °/s, bandwidth of the accelerometer 740 Hz at 1.6 kHz.
    "bmi270": {"bandwidth": 740.0,
               "accelerometer.range": 16.0 * _G, "accelerometer.resolution": _G / 2048.0,
               "accelerometer.noise_density": 160e-6 * _G, "accelerometer.bias_random_walk": 1e-4,
               "accelerometer.turn_on_bias": 0.020 * _G,
               "gyroscope.range": 2000.0 * _DEGREE, "gyroscope.resolution": _DEGREE / 16.384,
               "gyroscope.noise_density": 0.007 * _DEGREE, "gyroscope.bias_random_walk": 1e-5,
               "gyroscope.turn_on_bias": 0.5 * _DEGREE},
    # InvenSense, PS-MPU-6000A-00 revision 3.4 (2013): 16 bits over ±16 g and ±2000 °/s, 400 µg/√Hz, 5 m°/s/√Hz, ±50 mg
    # (z ±80 mg), ±20 °/s, bandwidth of the accelerometer 260 Hz.
    "mpu6050": {"bandwidth": 260.0,
                "accelerometer.range": 16.0 * _G, "accelerometer.resolution": _G / 2048.0,
                "accelerometer.noise_density": 400e-6 * _G, "accelerometer.bias_random_walk": 1e-4,
                "accelerometer.turn_on_bias": 0.050 * _G,
                "gyroscope.range": 2000.0 * _DEGREE, "gyroscope.resolution": _DEGREE / 16.384,
                "gyroscope.noise_density": 0.005 * _DEGREE, "gyroscope.bias_random_walk": 1e-5,
                "gyroscope.turn_on_bias": 20.0 * _DEGREE},
}


def of_imu(scene: Scene, name: str) -> float:
    """Return the value of the parameter `sensors.imu.<name>`, or the preset's if the scene does not give it."""
    value = scene[f"sensors.imu.{name}"]
    return PRESETS[scene["sensors.preset"]].get(name, 0.0) if value == AS_PRESET else value


def force_at_rest(scene: Scene) -> tuple[float, float]:
    """Return the specific force [m/s²] along x and upwards of a body at rest on the scene's ground."""
    return scene.gravity


class InertialErrors:
    """The errors of an inertial sensor, `part` accelerometer or gyroscope, by the parameters `sensors.imu.*`."""

    def __init__(self, scene: Scene, part: str):
        rate, seed = scene["sensors.imu.rate"], int(scene["sensors.seed"])
        limit, self._resolution, density, drift, turn_on = (of_imu(scene, f"{part}.{name}") for name in (
            "range", "resolution", "noise_density", "bias_random_walk", "turn_on_bias"))
        self._range = limit or math.inf
        self._noise, self._step = density * math.sqrt(0.5 * rate), drift * math.sqrt(1.0 / rate)
        self._numbers, self._steps = Stream(seed, f"imu/{part}/noise"), Stream(seed, f"imu/{part}/bias")
        self._bias = turn_on * Stream(seed, f"imu/{part}/turn_on").normal(0)[0]
        self._errors = BlockNumbers(self._block_errors)
        self._variance = self._noise * self._noise + self._resolution * self._resolution / 12.0 + turn_on * turn_on

    def read(self, true: Sequence[float], index: int) -> list[float]:
        """Return the measured values of sample `index` for the `true` quantity along x, y and z."""
        values = [min(max(number, -self._range), self._range) + error
                  for number, error in zip(true, self._errors[index], strict=False)]  # the fourth number is not used
        if step := self._resolution:
            return [step * round(value / step) for value in values]
        return values

    def variance(self, index: int) -> float:
        """Return the variance of the error on each axis by noise, quantisation and bias, within the range."""
        return self._variance + index * (self._step * self._step)

    def _block_errors(self, block: int) -> np.ndarray:
        """Return the errors of a block of samples; a method, because a device with a lambda cannot be pickled."""
        return (self._bias + self._step * self._steps.walk(block)) + self._noise * self._numbers.normal(block)


def philox(key: int, counter: int, count: int) -> np.ndarray:
    """Return the output of Philox 4x64-10 for `count` counters from `counter` on, shape (count, 4) of uint64.

    `key` has 128 bits and `counter` 256, the first word lowest.
    """
    generator = np.random.Philox(key=key, counter=(counter - 1) % _WHOLE)  # numpy counts up before each output
    return generator.random_raw(LANES * count).reshape(count, LANES)


#: Numerators and denominators of M. Wichura's rational functions (1988, AS 241), highest power first: in the centre of
#: the normal distribution, on its flanks and in its tails.
_CENTRE = (
    (2.5090809287301226727e+3, 3.3430575583588128105e+4, 6.7265770927008700853e+4, 4.5921953931549871457e+4,
     1.3731693765509461125e+4, 1.9715909503065514427e+3, 1.3314166789178437745e+2, 3.3871328727963666080e+0),
    (5.2264952788528545610e+3, 2.8729085735721942674e+4, 3.9307895800092710610e+4, 2.1213794301586595867e+4,
     5.3941960214247511077e+3, 6.8718700749205790830e+2, 4.2313330701600911252e+1, 1.0))
_FLANK = (
    (7.74545014278341407640e-4, 2.27238449892691845833e-2, 2.41780725177450611770e-1, 1.27045825245236838258e+0,
     3.64784832476320460504e+0, 5.76949722146069140550e+0, 4.63033784615654529590e+0, 1.42343711074968357734e+0),
    (1.05075007164441684324e-9, 5.47593808499534494600e-4, 1.51986665636164571966e-2, 1.48103976427480074590e-1,
     6.89767334985100004550e-1, 1.67638483018380384940e+0, 2.05319162663775882187e+0, 1.0))
_TAIL = (
    (2.01033439929228813265e-7, 2.71155556874348757815e-5, 1.24266094738807843860e-3, 2.65321895265761230930e-2,
     2.96560571828504891230e-1, 1.78482653991729133580e+0, 5.46378491116411436990e+0, 6.65790464350110377720e+0),
    (2.04426310338993978564e-15, 1.42151175831644588870e-7, 1.84631831751005468180e-5, 7.86869131145613259100e-4,
     1.48753612908506148525e-2, 1.36929880922735805310e-1, 5.99832206555887937690e-1, 1.0))


def _ratio(coefficients: tuple[tuple[float, ...], tuple[float, ...]], r: np.ndarray) -> np.ndarray:
    numerator, denominator = np.zeros_like(r), np.zeros_like(r)
    for above, below in zip(*coefficients, strict=True):
        numerator, denominator = numerator * r + above, denominator * r + below
    return numerator / denominator


def normal_quantile(share: np.ndarray) -> np.ndarray:
    """Return the numbers below which the given shares of a standard normal distribution lie, to 1e-15 of each."""
    from_middle = share - 0.5
    quantile = from_middle * _ratio(_CENTRE, 0.180625 - from_middle * from_middle)
    outer = abs(from_middle) > 0.425
    share_beyond = np.where(from_middle < 0.0, share, 1.0 - share)[outer]
    r = np.sqrt([-log(number) for number in share_beyond.tolist()])
    magnitude, in_tail = _ratio(_FLANK, r - 1.6), r > 5.0
    magnitude[in_tail] = _ratio(_TAIL, r[in_tail] - 5.0)
    quantile[outer] = np.copysign(magnitude, from_middle[outer])
    return quantile


class Stream:
    """Random numbers in blocks of samples, from the seed of all streams and the name of this one."""

    def __init__(self, seed: int, name: str):
        self._key = int.from_bytes(hashlib.blake2b(f"{seed}/{name}".encode(), digest_size=16).digest(), "little")
        self._walked, self._walk = 0, np.zeros(LANES)  # the sum of all normal numbers before this block

    def uniform(self, block: int) -> np.ndarray:
        """Return numbers in the open interval (0, 1), shape (BLOCK, LANES); row k is of sample block BLOCK + k."""
        return ((philox(self._key, block * BLOCK, BLOCK) >> np.uint64(11)) + 0.5) * 2.0**-53

    def normal(self, block: int) -> np.ndarray:
        """Return standard normal numbers, made of the uniform ones; shape (BLOCK, LANES)."""
        return normal_quantile(self.uniform(block))

    def walk(self, block: int) -> np.ndarray:
        """Return a random walk, the sum of the normal numbers of all earlier samples; shape (BLOCK, LANES)."""
        if block < self._walked:
            self._walked, self._walk = 0, np.zeros(LANES)
        while True:
            sums = np.cumsum(np.vstack([self._walk, self.normal(self._walked)]), axis=0)
            if self._walked == block:
                return sums[:-1]
            self._walked, self._walk = self._walked + 1, sums[-1]


class BlockNumbers:
    """The numbers of each sample; `compute` returns the numbers of a block, shape (BLOCK, n), when they are needed."""

    def __init__(self, compute: Callable[[int], np.ndarray]):
        self._compute, self._block, self._rows = compute, -1, [[0.0]]

    def __getitem__(self, index: int) -> list[float]:
        """Return the numbers of sample `index`."""
        block, place = divmod(index, BLOCK)
        if block != self._block:
            self._block, self._rows = block, self._compute(block).tolist()
        return self._rows[place]
