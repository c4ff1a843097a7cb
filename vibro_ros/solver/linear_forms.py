"""Linear forms of the channels: their values at points, and the magnitude of the terms that make them up."""

from vibro_ros.solver.compilation import entry_kernel, kernel, sum_kernel
from vibro_ros.solver.system import NOTHING

# A motion that has died away to less is reported as zero: below 2e-308 doubles lose their digits.
_LEAST_VALUE = 1e-290


@sum_kernel
def form_value(row, point):
    """Value of a linear form at a point."""
    total = 0.0
    for channel in range(len(point)):
        total += row[channel] * point[channel]
    return total


@sum_kernel
def form_magnitude(row, magnitude):
    """Sum of |row| magnitude: of the terms that make up a form, if those of each channel have this magnitude."""
    total = 0.0
    for channel in range(len(row)):
        total += abs(row[channel]) * magnitude[channel]
    return total


@kernel
def value_and_magnitude(row, terms, point, magnitude):
    """Value of a form at a point and the magnitude of its terms, from the channels in `terms` alone."""
    total = 0.0
    terms_magnitude = 0.0
    for channel in terms:
        if channel == NOTHING:
            break
        total += row[channel] * point[channel]
        terms_magnitude += abs(row[channel]) * magnitude[channel]
    return total, terms_magnitude


@entry_kernel
def evaluate_forms(forms, terms, modes, points, values):
    """Values of each mode's linear forms at sampled points.

    Parameters
    ----------
    forms : ndarray, shape (m, f, channels)
        The forms by mode.
    terms : ndarray of int, shape (m, f, channels)
        The forms' `system.terms`.
    modes, points : ndarray
        As `event_loop.advance` fills them; shapes (n,) and (n, channels).
    values : tuple of f ndarrays, shape (n,)
        Receive the values.
    """
    for f in range(len(values)):
        form, used, result = forms[:, f], terms[:, f], values[f]
        for k in range(len(modes)):
            mode = modes[k]
            total = 0.0
            for channel in used[mode]:
                if channel < 0:
                    break
                total += form[mode, channel] * points[k, channel]
            result[k] = total if abs(total) >= _LEAST_VALUE else 0.0
