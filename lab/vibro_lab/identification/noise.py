"""The noise of a channel, estimated from its own values: that of neighbours, and the step of a quantised sensor."""

import math
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.optimize import nnls

from vibro_ros import Scene, of_imu

LARGEST_VARIANCE = 1e12
"""Largest variance of a measurement, in SI units; a larger one says that nothing was measured."""
_ORDERS = 4, 5, 6, 7  # of differences; lower ones keep too much of the motion, a blow falls into more of higher ones
_MOST = 50_000  # differences
_CLIP = 2.0  # standard deviations
_SHARE = 1.0 - 2.0 * _CLIP * math.exp(-0.5 * _CLIP**2) / math.sqrt(math.tau) / math.erf(_CLIP / math.sqrt(2.0))
_FEWEST_MIDDLES = 30  # samples between neighbours for an estimate of jitter
_ROUNDS, _TRIMMED, _SURE = 20, 4.0, 5.0  # of least squares; beyond so many deviations left out; of a jitter that counts
_BEFORE = 0.1  # weight of the size by rates: without it a channel could take all lateness, with no noise at all
_MEDIAN = 0.6744897501960817  # of the magnitude of a standard normal number


def is_measured(variances: float | np.ndarray) -> Any:
    """Return whether a number with such a variance was measured, bool or ndarray of bool: drivers fill in infinity, the
    largest double, NaN or a negative number where they have not measured. 0 says only that the variance is not known.
    """
    return (variances >= 0.0) & (variances <= LARGEST_VARIANCE)


def noise_of(times: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Estimate the standard deviation of white noise on a motion with blows, from neighbouring values.

    A divided difference of order k takes a smooth motion away and has unit weight on the noise. Where a blow falls
    into it, it is large: differences beyond two standard deviations are left out again and again until nothing
    changes. On `damped` and `device` at 100 rad/s with the noise of a laboratory, 0.05 mm and 1 mm/s, 4000 samples at
    500 Hz or 1 kHz give the truth to 4 % of standard deviation, because neighbouring differences are correlated, and a
    bias of 0 to 6 %, or 15 % for the speed of a body that sticks and slips at 500 Hz. At 100 and 200 Hz the motion of
    the masses is larger than such noise.

    Returns
    -------
    tuple of float
        The smallest estimate of four orders, and their spread: the largest estimate over the smallest. Where the
        spread is large, the motion is larger than the noise, and the estimate only a bound.
    """
    estimates = [clipped(_differences(times, values, order)) for order in _ORDERS]
    return min(estimates), max(estimates) / min(estimates) if min(estimates) else math.inf


def _differences(times: np.ndarray, values: np.ndarray, order: int) -> np.ndarray:
    """Return magnitudes of the divided differences of an `order`, whose weights have the square sum 1."""
    first = np.arange(0, len(times) - order, math.ceil(len(times) / _MOST))  # a long recording has enough of them
    rows = first[:, None] + np.arange(order + 1)
    elapsed = times[rows] - times[rows[:, :1]]
    distances = (elapsed[:, :, None] - elapsed[:, None, :]) / elapsed[:, -1:, None]
    distances[:, range(order + 1), range(order + 1)] = 1.0
    weights = 1.0 / distances.prod(axis=2)
    return np.abs((weights * values[rows]).sum(axis=1)) / np.sqrt((weights**2).sum(axis=1))


def clipped(magnitudes: np.ndarray) -> float:
    """Return the standard deviation of normal numbers with these magnitudes, of which some may be too large."""
    sigma = float(np.median(magnitudes)) / _MEDIAN
    for _ in range(100):
        kept = magnitudes[magnitudes < _CLIP * sigma]
        earlier_sigma, sigma = sigma, math.sqrt(float(np.mean(kept**2)) / _SHARE) if len(kept) else sigma
        if abs(sigma - earlier_sigma) <= 1e-4 * sigma:
            break
    return sigma


def resolution_of(field: str, values: np.ndarray, scene: Scene) -> float:
    """Return the step of the scene's sensor, an encoder or an accelerometer, if all values are multiples of it."""
    if field == "crank_angle":
        step = math.tau / scene["sensors.encoder.ticks"]
    elif field.startswith("acceleration"):
        step = of_imu(scene, "accelerometer.resolution")
    else:
        return 0.0
    return step if step and np.abs(values / step - np.round(values / step)).max() < 1e-6 else 0.0


def sizes_of(channel: np.ndarray, follows: np.ndarray, residuals: np.ndarray, rates: np.ndarray,
             is_exact: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the size of the noise of a sensor's channels, shape (channels,), and the jitter [s] of its stamps.

    The residual of a sample less the mean of its neighbours has no motion in it, and its mean square is a weighted sum
    of the channel's variance and of that of the jitter times the rate squared: linear least squares over all channels
    find both. Beyond four standard deviations a square does not count.

    Parameters
    ----------
    channel : ndarray of int, shape (n,)
        Channel of each measurement, neighbours side by side.
    follows : ndarray of bool, shape (n,)
        Whether a measurement is of the same channel and window as the one before.
    residuals, rates : ndarray, shape (n,)
        Residuals in the standard deviation stated, and by how much they grow with the lateness of the stamp [1/s].
    is_exact : ndarray of bool, shape (channels,)
        Channels whose size is known to be 1, as that of a resolution.
    """
    middle = np.flatnonzero(follows[1:-1] & follows[2:]) + 1
    of, sizes = channel[middle], np.ones(len(is_exact))
    if len(middle) < _FEWEST_MIDDLES:
        return sizes, 0.0
    squares = (residuals[middle] - 0.5 * (residuals[middle - 1] + residuals[middle + 1]))**2 / 1.5
    slopes = (rates[middle]**2 + 0.25 * (rates[middle - 1]**2 + rates[middle + 1]**2)) / 1.5
    for k in np.flatnonzero(~is_exact):
        sizes[k] = clipped(np.sqrt(squares[of == k])) if (of == k).any() else 1.0
    with_size, jitter = np.zeros((len(middle), len(sizes) + 1)), 0.0
    with_size[np.arange(len(middle)), of] = ~is_exact[of]
    with_size[:, -1] = slopes * 1e-6  # of milliseconds
    variance = float(np.median(squares)) / _MEDIAN**2 / max(float(np.median(slopes)), 1e-300)
    expected = np.where(is_exact[of], 1.0, 0.0) + with_size @ np.append(np.minimum(sizes**2, 1.0), variance * 1e6)
    for _ in range(_ROUNDS):
        kept = squares < (_TRIMMED**2) * expected
        weights = kept / expected
        rows = weights[:, None] * with_size
        variances = nnls(rows, weights * (squares - is_exact[of]))[0]
        expected = np.maximum(with_size @ variances + is_exact[of], 1e-6)
        deviations = np.sqrt(3.0 * np.maximum(np.diag(np.linalg.pinv(rows.T @ rows)), 0.0))
        jitter = math.sqrt(variances[-1]) * 1e-3
    if variances[-1] < _SURE * deviations[-1]:
        for k in np.flatnonzero(~is_exact):
            sizes[k] = clipped(np.sqrt(squares[of == k])) if (of == k).any() else 1.0
        return sizes, 0.0
    # A square below its own deviation is not told: it may be 0 by chance, and no later step would leave 0.
    return np.where(is_exact, 1.0, np.sqrt(np.maximum(variances, deviations)[:-1])), jitter


def wild(channel: np.ndarray, residuals: np.ndarray, expected: np.ndarray, beyond: float,
         most: float) -> np.ndarray:
    """Return which residuals are outliers, shape (n,): above `beyond` standard deviations `expected`, and as far above
    the middle one of their six neighbours, because where the model is wrong all are large. A channel with a larger
    share of them than `most` has none."""
    away, is_wild = np.abs(residuals) / expected, np.zeros(len(residuals), bool)
    for number in np.unique(channel):
        mine = np.flatnonzero(channel == number)
        padded = np.pad(away[mine], 3, mode="reflect") if len(mine) > 3 else np.pad(away[mine], 3, mode="edge")
        around = np.median(np.delete(sliding_window_view(padded, 7), 3, axis=1), axis=1)
        is_above = away[mine] > beyond * np.maximum(1.0, around / _MEDIAN)
        is_wild[mine] = is_above & (is_above.mean() <= most)
    return is_wild


def refined_sizes(channel: np.ndarray, message: np.ndarray, residuals: np.ndarray, jitters: np.ndarray,
                  bends: np.ndarray, sizes: np.ndarray, is_exact: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the sizes of the noise of a sensor's channels, and the share by which its jitter is another, from what the
    numbers of each message say together (expectation and maximisation).

    Where jitter is fifty times the noise, the square of one number hardly tells the noise; that what the other numbers
    of the message say of its lateness leaves of it does. `jitters` is what one standard deviation of lateness makes of
    each residual, `bends` what it makes beside that; all are in the standard deviation stated.
    """
    earlier_sizes = np.maximum(sizes, 1e-3)
    sizes, share = earlier_sizes.copy(), 1.0
    for _ in range(2 * _ROUNDS):
        deviation = np.hypot(sizes[channel], bends)
        scaled, along = residuals / deviation, share * jitters / deviation
        known = 1.0 + np.bincount(message, along**2)
        late = np.bincount(message, along * scaled) / known
        left = np.minimum((scaled - along * late[message])**2 + along**2 / known[message], _TRIMMED**2)
        share *= math.sqrt(float(np.mean(np.minimum(late**2, _TRIMMED**2) + 1.0 / known)))
        for k in np.flatnonzero(~is_exact):
            mine = (channel == k) & (bends <= sizes[k])
            if mine.sum() > _FEWEST_MIDDLES:
                square = float(np.mean(left[mine] * deviation[mine]**2) - np.mean(bends[mine]**2))
                sizes[k] = math.sqrt((max(square, 0.0) + _BEFORE * earlier_sizes[k]**2) / (1.0 + _BEFORE))
    return sizes, share
