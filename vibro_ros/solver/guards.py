"""Guards: how much of their value is rounding, and which of them turns negative first."""

from vibro_ros.solver.compilation import kernel
from vibro_ros.solver.linear_forms import sparse_magnitude, value_and_magnitude
from vibro_ros.solver.polynomial import fill_form
from vibro_ros.solver.roots import NO_ROOT, SEARCH_FAILED, first_root
from vibro_ros.solver.state import UNKNOWN
from vibro_ros.solver.system import NOTHING

EPSILON = 2.220446049250313e-16
#: A guard's rounding error beside the magnitude of its terms: a sum of products, through the series' first terms.
NOISE = 16.0 * EPSILON

# Events in a row at one instant after which a guard must be below zero by more than its rounding error: modes whose
# guards contradict each other within it would take turns for ever.
_DOUBTFUL_STANDSTILLS = 10
_DOUBT = 8.0  # rounding errors
# Roots no further apart than rounding are simultaneous: the guard that its mode names first decides.
_SIMULTANEOUS = 16.0 * EPSILON


@kernel
def guard_value(system, row, point, magnitude):
    """Value of a guard row at a point and its rounding error, from the magnitude of the terms of each channel."""
    total, terms = value_and_magnitude(system.row[row], system.row_terms[row], point, magnitude)
    return total, NOISE * terms


@kernel
def _guard_root(system, state, row):
    """First root of a guard row between the mode's start and the next event; remembered until its polynomial
    changes."""
    segment, room = state.now[0].segment, state.scratch.room[0]
    if state.root[row] > segment.mode_start:
        return state.root[row]
    guard = room.guard[:]
    fill_form(system.row[row], system.row_terms[row], state.z, guard)
    noise = NOISE * sparse_magnitude(system.row[row], system.row_terms[row], state.scale)
    if state.now[0].automaton.standstills > _DOUBTFUL_STANDSTILLS:
        guard[0] += _DOUBT * noise
    limit = segment.next_event
    root = first_root(guard, segment.mode_start, limit, noise, room.search[:])
    state.root[row] = UNKNOWN if root == NO_ROOT and limit < 1.0 else root
    return root


@kernel
def find_next_event(system, state):
    """Set the next event to the earliest root of the mode's guards, else to the segment's end; False if a root search
    failed."""
    segment, automaton = state.now[0].segment, state.now[0].automaton
    segment.next_event = 1.0
    automaton.guard = NOTHING
    for g in range(system.guard.shape[1]):
        row = system.guard[automaton.mode, g]
        if row == NOTHING:
            break
        root = _guard_root(system, state, row)
        if root == SEARCH_FAILED:
            return False
        if root != NO_ROOT and (root < segment.next_event - _SIMULTANEOUS or automaton.guard == NOTHING):
            segment.next_event = root
            automaton.guard = g
    return True
