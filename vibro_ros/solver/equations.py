"""Tables that follow from a system's equations: what their rows read, and how long a segment their flows allow; and
tables of what a system does not have."""

import functools

import numpy as np

from vibro_ros.solver.channels import Channels
from vibro_ros.solver.elementary import exp, log
from vibro_ros.solver.system import CONTROLLER, NOTHING, SHOCK, Rotor, Shock

#: Half the longest segment in units of the mode's fastest time constant: 1.7^LENGTH / LENGTH! is below rounding.
RATE_LIMIT = 1.7


def terms(forms: np.ndarray) -> np.ndarray:
    """Return the indices of the nonzero entries of each form, padded with `NOTHING`; shape as `forms`."""
    return _terms_by_zeros((forms == 0.0).tobytes(), forms.shape)


@functools.lru_cache(maxsize=64)
def _terms_by_zeros(zeros: bytes, shape: tuple[int, ...]) -> np.ndarray:
    """Return `terms` of forms with these zeros; cached, because all systems of a sweep have the same zeros."""
    zero = np.frombuffer(zeros, dtype=bool).reshape(shape)
    order = np.argsort(zero, axis=-1, kind="stable")
    return np.where(np.take_along_axis(zero, order, axis=-1), NOTHING, order)


def equation_terms(acceleration: np.ndarray, channels: Channels) -> np.ndarray:
    """Return `System.reads_forcing` of `System.equations`.

    Raises
    ------
    ValueError
        If a dynamic coordinate's row reads a driven coordinate or an acceleration, which the flow does not contain: the
        equations must have these eliminated.
    """
    forcing = acceleration.copy()
    read = np.asarray(acceleration[:, :channels.dynamic, :channels.signal(0)].any(axis=(0, 1)))
    read[:channels.dynamic] = read[channels.velocity(0):channels.velocity(channels.dynamic)] = False
    if read.any():
        raise ValueError(f"rows of dynamic coordinates read channels {np.flatnonzero(read)}, which no flow sees")
    if channels.decays:
        forcing[:, :channels.dynamic, channels.decay] = 0.0
    forcing[:, :channels.dynamic, :channels.signal(0)] = 0.0
    return terms(forcing)


def longest_segments(acceleration: np.ndarray, channels: Channels) -> np.ndarray:
    """Return the longest segment of each mode [s], from the fastest eigenvalue of its dynamic coordinates.

    Parameters
    ----------
    acceleration : ndarray, shape (m, coordinates, channels)
        Rows of A.
    channels : Channels
        Layout of the rows.

    Returns
    -------
    ndarray, shape (m,)
        Infinite for a mode without an eigenvalue other than zero.
    """
    positions, velocities = _own_rows(acceleration, channels)
    numbers = flow_numbers(np.concatenate([positions, velocities], axis=2))
    first = np.unique(numbers, return_index=True)[1]
    with np.errstate(divide="ignore"):
        return (2.0 * RATE_LIMIT / fastest_rates(positions[first], velocities[first]))[numbers]


def fastest_rates(positions: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """Return the fastest eigenvalue of each mode [1/s], or a close upper bound where coordinates are coupled.

    Parameters
    ----------
    positions : ndarray, shape (m, n, n)
        K [1/s²] of the equations q'' = K q + C q' of each mode's n coordinates.
    velocities : ndarray, shape (m, n, n)
        C [1/s] of these equations.

    Returns
    -------
    ndarray, shape (m,)
        0 for a mode without an eigenvalue other than zero.
    """
    fastest, coupled = _fastest_own_rates(positions, velocities), _are_coupled(positions, velocities)
    if coupled.any():
        fastest[coupled] = _fastest_coupled_rates(positions[coupled], velocities[coupled])
    return fastest


def _fastest_own_rates(positions: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """Return the fastest eigenvalue of each mode [1/s], as if no coordinate entered the equation of another one.

    Coordinate i has the equation q'' = k q + c q', with k = positions[:, i, i] and c = velocities[:, i, i].
    """
    diagonal = np.arange(positions.shape[1])
    k, half = positions[:, diagonal, diagonal], abs(0.5 * velocities[:, diagonal, diagonal])
    square = half * half + k
    oscillates = square < 0.0
    rates = np.sqrt(np.where(oscillates, -k, square)) + np.where(oscillates, 0.0, half)
    return rates.max(axis=1, initial=0.0)


# The bound by the power 2^n is too large by the 2^n-th root of the condition of the matrix, some tenths of a percent.
_SQUARINGS = 10


def _fastest_coupled_rates(positions: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """Return a close upper bound of the fastest eigenvalue of each mode [1/s].

    No eigenvalue of a matrix exceeds the k-th root of a norm of its k-th power, and this root converges to the largest
    one as k grows (I. Gelfand). Powers need only products and sums, whose order is fixed, unlike LAPACK's.
    """
    n = positions.shape[1]
    scale = np.sqrt(abs(positions).max(axis=(1, 2)))[:, None, None]  # of the rates, so that all entries are comparable
    scale[scale == 0.0] = 1.0
    power = np.zeros((len(positions), 2 * n, 2 * n))
    power[:, :n, n:], power[:, n:, :n], power[:, n:, n:] = np.eye(n) * scale, positions / scale, velocities
    exponent, share = np.zeros(len(power)), 1.0
    for _ in range(_SQUARINGS):
        size = abs(power).max(axis=(1, 2))
        exponent += share * np.array([log(number) for number in size.tolist()])
        power /= np.where(size > 0.0, size, 1.0)[:, None, None]
        power = np.asarray(sum(power[:, :, j, None] * power[:, None, j, :] for j in range(2 * n)))
        share *= 0.5
    norm = 2 * n * abs(power).max(axis=(1, 2))  # at least the sum of any row's magnitudes
    return np.array([exp(scale + share * log(number)) for scale, number in zip(
        exponent.tolist(), norm.tolist(), strict=True)])


def couplings(acceleration: np.ndarray, channels: Channels) -> np.ndarray:
    """Return whether a dynamic coordinate of the mode enters the equation of another one; shape (m,)."""
    return _are_coupled(*_own_rows(acceleration, channels))


def _are_coupled(positions: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """Return whether a coordinate enters the equation of another one in each mode; shape (m,)."""
    different = ~np.eye(positions.shape[1], dtype=bool)
    return np.asarray(positions[:, different].any(axis=1) | velocities[:, different].any(axis=1))


def _own_rows(acceleration: np.ndarray, channels: Channels) -> tuple[np.ndarray, np.ndarray]:
    """Return the parts of A by which dynamic coordinates depend on each other's positions and velocities."""
    n, velocity = channels.dynamic, channels.velocity(0)
    return acceleration[:, :n, :n], acceleration[:, :n, velocity:velocity + n]


def flow_numbers(equations: np.ndarray) -> np.ndarray:
    """Return a number for each mode, shape (m,), equal for equal `equations`, shape (m, rows, channels)."""
    numbers: dict[bytes, int] = {}
    return np.array([numbers.setdefault(rows.tobytes(), len(numbers)) for rows in equations])


def no_rotor(count: int) -> Rotor:
    """Return `System.rotor` of a system of `count` channels whose phase is known in time."""
    forms, row = np.empty((0, 0, count)), np.empty((0, count))
    return Rotor(np.empty((0, 4)), forms, terms(forms), row, terms(row), np.empty(0, bool), np.empty(0, CONTROLLER))


def no_shock() -> Shock:
    """Return `System.shock` of a system whose jumps are all linear forms."""
    return Shock(np.empty(0, SHOCK), np.empty((0, 0, 2)), np.empty(0), np.empty((0, 2)),
                 np.empty((0, 0, 0), dtype=np.int64))
