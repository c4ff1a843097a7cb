"""Guards: how much of their value is rounding, and which of them turns negative first."""

from vibro_ros.solver.compilation import kernel
from vibro_ros.solver.linear_forms import sparse_magnitude, value_and_magnitude
from vibro_ros.solver.polynomial import fill_form
from vibro_ros.solver.roots import NO_ROOT, SEARCH_FAILED, first_root
from vibro_ros.solver.segment import local_to_piece
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
def _fill_guard(system, state, row, guard):
    """Fill `guard` with the polynomial of a guard row; returns its rounding error."""
    fill_form(system.row[row], system.row_terms[row], state.z, guard)
    noise = NOISE * sparse_magnitude(system.row[row], system.row_terms[row], state.scale)
    if state.now[0].automaton.standstills > _DOUBTFUL_STANDSTILLS:
        guard[0] += _DOUBT * noise
    return noise


@kernel
def _guard_root(system, state, row):
    """First root of a guard row between the mode's start and the next event; remembered until its polynomial
    changes. A row that reads a driven coordinate is a polynomial of the piece, whose local time it has."""
    segment, room = state.now[0].segment, state.scratch.room[0]
    if state.root[row] > segment.mode_start:
        return state.root[row]
    guard = room.guard[:]
    noise = _fill_guard(system, state, row, guard)
    start, limit, in_piece = segment.mode_start, segment.next_event, system.driven[row] and segment.piece_half != 1.0
    if in_piece:
        start, limit = local_to_piece(segment, start), local_to_piece(segment, min(limit, segment.piece_end))
    root = first_root(guard, start, limit, noise, room.search[:])
    if in_piece and root != NO_ROOT and root != SEARCH_FAILED:
        root = segment.piece_middle + segment.piece_half * root if root > start else segment.mode_start
    state.root[row] = UNKNOWN if root == NO_ROOT and segment.next_event < 1.0 else root
    return root


@kernel
def find_next_event(system, state):
    """Set the next event to the earliest root of the mode's guards, else to the end of the piece or the segment; False
    if a root search failed."""
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
    if segment.piece_end < segment.next_event:
        segment.next_event = segment.piece_end
        automaton.guard = NOTHING
    return True
