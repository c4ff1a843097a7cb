"""The instants at which a run is sampled, checked."""

import math

import numpy as np

#: Latest instant [s] that can be asked for, 31 years: there, doubles tell instants apart that are 1e-7 s apart.
LATEST = 1e9
#: Most samples of one run: their fields take 20 GB.
MOST_SAMPLES = 1e8


def sample_times(duration: float | None, rate: float | None, times: np.ndarray | None) -> np.ndarray:
    """Instants to sample [s], shape (n,), from the arguments of `simulate`; a ValueError for any that make no sense."""
    if times is None:
        if duration is None or rate is None:
            raise ValueError("give duration and rate, or times")
        if not (math.isfinite(duration) and duration >= 0.0 and math.isfinite(rate) and rate > 0.0):
            raise ValueError(f"duration {duration:g} s and rate {rate:g} Hz: give a duration of at least 0 and a "
                             "rate above 0")
        if duration > LATEST or duration * rate > MOST_SAMPLES:
            raise ValueError(f"duration {duration:g} s and rate {rate:g} Hz: give a duration of at most {LATEST:g} s "
                             f"and at most {MOST_SAMPLES:g} samples")
        return np.arange(int(math.floor(duration * rate * (1.0 + 1e-12))) + 1) / rate
    return checked_times(times, 0.0)


def checked_times(times: np.ndarray, start: float) -> np.ndarray:
    """Copy of the instants `times` [s], shape (n,); a ValueError for any that make no sense or lie before `start`."""
    times = np.array(times, dtype=float)  # the caller's may change between parts
    if times.ndim != 1 or not np.isfinite(times).all() or (times < start).any() or (np.diff(times) < 0.0).any():
        raise ValueError("times: give a one-dimensional, ascending array of finite instants, none below "
                         f"{start:.9g} s")
    if (times > LATEST).any():
        raise ValueError(f"times: {times[-1]:g} s is too late; give instants up to {LATEST:g} s")
    return times
