"""Linear forms of the channels: their values at points, and the magnitude of the terms that make them up."""

from vibro_ros.solver.compilation import kernel, sum_kernel
from vibro_ros.solver.system import NOTHING


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
def sparse_magnitude(row, terms, magnitude):
    """`form_magnitude` of a form that reads the channels in `terms` alone."""
    total = 0.0
    for channel in terms:
        if channel == NOTHING:
            break
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
