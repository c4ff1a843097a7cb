"""The 0-1 test for chaos: a number near 0 for a regular series, near 1 for a chaotic one, without a derivative.

G. A. Gottwald and I. Melbourne, On the implementation of the 0-1 test for chaos, SIAM Journal on Applied Dynamical
Systems 8 (2009) 129-145: a plane walk p(n) + i q(n) = sum of x(j) exp(i j c) stays bounded when the series x is
regular, and diffuses like a Brownian motion when the series is chaotic. K is the correlation of the walk's mean square
displacement with time, by their eq. (2.4) without the oscillating part; the median over frequencies c leaves out those
that resonate with the series.
"""

from collections.abc import Sequence

import numpy as np

LEAST = 200
"""Values that a series must have: the walk is watched over a tenth of them."""
_FREQUENCIES = 100
_LOWEST, _HIGHEST = np.pi / 5.0, 4.0 * np.pi / 5.0  # of the frequencies, away from resonances with every series
_WATCHED = 10  # the displacement is correlated with time over this part of the series


def zero_one_test(series: Sequence[float] | np.ndarray, noise: float = 1e-9) -> float:
    """Whether a series of a motion, seen once a turn, is regular or chaotic.

    Parameters
    ----------
    series : ndarray, shape (n,)
        One quantity at successive cuts, at least `LEAST` of them; about 1000 tell clearly. Its unit does not matter. Do
        not take samples that are closer together than a turn: neighbours that depend on each other look regular.
    noise : float
        A series whose standard deviation is smaller, in its own unit, counts as constant, and as regular: rounding
        looks like chaos.

    Returns
    -------
    float
        K, dimensionless, from -1 to 1: near 0 for a periodic or quasi-periodic motion, near 1 for chaos.

    Raises
    ------
    ValueError
        For a series that is too short, has another shape or is not finite.

    Examples
    --------
    >>> logistic = [0.3]
    >>> for _ in range(1000):
    ...     logistic.append(3.97 * logistic[-1] * (1.0 - logistic[-1]))
    >>> f"{vibro_ros.zero_one_test(logistic):.3f}"
    '0.998'
    >>> abs(vibro_ros.zero_one_test([0.1, 0.7] * 500)) < 0.05
    True
    """
    values = np.asarray(series, dtype=float)
    if values.ndim != 1 or len(values) < LEAST:
        raise ValueError(f"series: has shape {values.shape}; give at least {LEAST} values in a row")
    if not np.isfinite(values).all():
        raise ValueError("series: has values that are not finite; give numbers alone")
    if values.std() <= noise:
        return 0.0
    frequencies = np.random.default_rng(0).uniform(_LOWEST, _HIGHEST, _FREQUENCIES)
    return float(np.median([_growth(values / values.std(), frequency) for frequency in frequencies]))


def _growth(values: np.ndarray, frequency: float) -> float:
    """K of one frequency c [rad a value]."""
    count, lags = len(values), np.arange(1, len(values) // _WATCHED + 1)
    walk = np.cumsum(values * np.exp(1j * frequency * np.arange(1, count + 1)))
    oscillating = values.mean()**2 * (1.0 - np.cos(frequency * lags)) / (1.0 - np.cos(frequency))
    displacement = _mean_square(walk, lags) - oscillating
    if displacement.std() <= 1e-9 * max(1.0, float(np.abs(displacement).max())):
        return 0.0
    return float(np.corrcoef(lags, displacement)[0, 1])


def _mean_square(walk: np.ndarray, lags: np.ndarray) -> np.ndarray:
    """Mean of |walk(j + lag) - walk(j)|² over the j that every lag has, by one correlation for all lags."""
    kept = len(walk) - len(lags)
    size = 1 << (2 * len(walk)).bit_length()
    squares = np.concatenate([[0.0], np.cumsum(np.abs(walk)**2)])
    first = np.fft.fft(walk[:kept], size)
    crossed = np.fft.ifft(np.fft.fft(walk, size) * np.conj(first))[lags].real
    return (squares[lags + kept] - squares[lags] + squares[kept] - 2.0 * crossed) / kept
