"""A driven coordinate with a decaying term: x'' = L + k f e, where e = exp(r x') decays with the speed.

L and f are linear forms of the channels, so polynomials on a segment, and r is constant in a mode. With V, the speed
that L alone adds from a on, where the mode starts, and p = f e(a) exp(r V), the term at that speed,

    f e = p / (1 + Q),        Q' = -r k p,        Q(a) = 0.

This is exact, and neither V nor Q depends on the solution. The term is found at the Chebyshev nodes of a *piece* of the
segment, and is the polynomial through them: the values need a rounding or two, and no series.

1 + Q vanishes at a complex time near the piece, so a piece is often shorter than the segment. The dynamic coordinates
do not feel the term: their flow goes on, and the driven coordinate's polynomials and the term's have a local time of
their own, from -1 to 1 over the piece.
"""

import math

import numpy as np
from numpy.polynomial import chebyshev

from vibro_ros.solver.compilation import called_kernel, kernel
from vibro_ros.solver.guards import EPSILON, NO_ROOT, NOISE, first_root
from vibro_ros.solver.polynomial import fill_form, integrate_through, recentre, scale_argument, value
from vibro_ros.solver.segment import set_piece
from vibro_ros.solver.system import CELL_STRIDE, form_magnitude
from vibro_ros.solver.vector import LENGTH, store, vector

#: Bound of the change of r x' about the middle of a piece; the rest of exp(5 x) after 24 terms is 4e-17 of exp(5).
_STRONGEST = 5.0
# ... or, where e has decayed to exp(-E) and need not be known as well, 3 + 0.2 E.
_WEAKER, _BY_DECAY = 3.0, 0.2
#: Where -r x' exceeds this, e has decayed to 4e-18 and may be left out ...
_OVER = 40.0
# ... and e is left out from here on, so that it is not needed again at once.
_WELL_OVER = 44.0
# Change of r x' at which a piece is not tried.
_TOO_STRONG = 30.0
# A piece without e ends before e matters again, by more than rounding.
_BEFORE = 1.0 - 1e-6
# Least factor by which a piece is shortened at once, and the part of the possible that is tried.
_SHORTER, _CAUTION = 0.1, 0.9
# Where a flow starts with a piece that is a smaller part of the segment, the segment is made shorter, because its local
# time would be too coarse for the piece.
_LEAST_PIECE = 5e-3
# A piece that is shorter than this, in the segment's local time, would be lost in rounding.
_SHORTEST = 1e-13
# Half axes of the ellipse about a piece that must be free of poles: what the polynomial leaves out is 4.2^-LENGTH.
_ALONG = 1.0 / CELL_STRIDE
_ACROSS = math.sqrt(_ALONG**2 - 1.0)
# Last two coefficients, in roundings of the magnitude of the terms that make up the acceleration: beyond them follows
# a third of that at most. Their own rounding is about half a rounding of the term.
_ALLOWED = 1.0
# Growth beside its forcing that does not move the pole.
_NO_GROWTH = 1e-3

_ANGLES = math.pi * (np.arange(LENGTH) + 0.5) / LENGTH
# Row n: the n-th power at the nodes.
_POWERS_AT_NODES = np.cos(_ANGLES) ** np.arange(LENGTH)[:, None]
# Row i: what a unit at node i adds to the coefficients of the Chebyshev polynomials ...
_COEFFICIENTS = np.cos(_ANGLES[:, None] * np.arange(LENGTH)) * np.where(np.arange(LENGTH) == 0, 1.0, 2.0) / LENGTH
# ... and to the integrals from -1 to the nodes.
_INTEGRALS = chebyshev.chebval(np.cos(_ANGLES), chebyshev.chebint(_COEFFICIENTS.T, lbnd=-1.0))
# Row k: coefficients of the powers in the k-th Chebyshev polynomial.
_POWERS = np.array([np.pad(chebyshev.cheb2poly(row[:k + 1]), (0, LENGTH - 1 - k))
                    for k, row in enumerate(np.eye(LENGTH))])


@kernel
def _combined(weights, rows):
    """The vector of the sum of the rows, times their weights."""
    result = weights[0] * vector(rows[0])
    for n in range(1, LENGTH):
        result = result + weights[n] * vector(rows[n])
    return result


@kernel
def decays(system, mode):
    """Whether the mode has a decaying term."""
    return len(system.decay.rate) > 0 and system.decay.rate[mode] != 0.0


@kernel
def _longest_half(growth, forcing, decayed):
    """Half the duration [s] of a piece whose term is resolved if w' = growth w + forcing with constant rates [1/s].

    w = (1 + Q) exp(-r V) is 1 where the piece starts. Where w vanishes the term has a pole, which must lie outside of
    the ellipse.
    """
    limit = max(_STRONGEST, _WEAKER + _BY_DECAY * decayed) / abs(growth) if growth != 0.0 else math.inf
    if forcing == 0.0:
        return limit
    along, across = -1.0 / forcing, 0.0
    if abs(growth) > _NO_GROWTH * abs(forcing):
        ratio = forcing / (growth + forcing)
        along = math.log(abs(ratio)) / growth
        across = math.pi / growth if ratio < 0.0 else 0.0
    slope, curvature = along / _ALONG**2, 1.0 - 1.0 / _ALONG**2
    half = (math.sqrt(slope * slope + curvature * ((along / _ALONG)**2 + (across / _ACROSS)**2)) - slope) / curvature
    return half if half < limit else limit  # no number: infinitely far


@kernel
def _fill_piece(state):
    """Load and factor over the present piece, from those over the segment."""
    segment, room = state.now[0].segment, state.scratch.room[0]
    whole, piece = room.decay_segment[:], room.decay_piece[:]
    if segment.piece_half == 1.0:
        for k in range(2):
            store(piece[k], vector(whole[k]))
        return
    recentre(whole, segment.piece_middle, LENGTH, piece)
    for k in range(2):
        scale_argument(piece[k], segment.piece_half, piece[k])


@kernel
def _pass_without(state, rate, speed, magnitude):
    """Let the piece end where the motion is no longer too fast for the decay to matter, and be without a term."""
    segment, room = state.now[0].segment, state.scratch.room[0]
    _fill_piece(state)
    guard, start = room.guard[:], segment.mode_start
    room.decay_piece[1] = 0.0
    integrate_through(room.decay_piece[0], segment.half, start, speed, guard)
    store(guard, -rate * vector(guard))
    guard[0] -= _OVER
    noise = NOISE * abs(rate) * (abs(speed) + magnitude * 2.0 * segment.half)
    root = first_root(guard, start, 1.0, noise, room.search[:])
    if root != NO_ROOT:
        segment.piece_end = start + (root - start) * _BEFORE


@kernel
def _fill_nodes(state, rate, start, decayed, term_at):
    """Fill `decayed` with exp(r V) and `term_at` with p at the nodes, `start` = e(a); returns the largest |r V|."""
    segment, piece, largest = state.now[0].segment, state.scratch.room[0].decay_piece[:], 0.0
    integrate_through(piece[0], segment.half * segment.piece_half, -1.0, 0.0, decayed)
    store(decayed, rate * _combined(decayed, _POWERS_AT_NODES))
    store(term_at, start * _combined(piece[1], _POWERS_AT_NODES))
    for n in range(LENGTH):
        largest = max(largest, abs(decayed[n]))
        decayed[n] = math.exp(decayed[n])
        term_at[n] *= decayed[n]
    return largest


@kernel
def _fill_change(state, strength, rate, start):
    """Fill the scratch with the Chebyshev coefficients of the term's change since a, `start` = e(a), over the piece.

    Returns
    -------
    (float, float)
        The part of the piece's duration that may do, 1 if all may, dimensionless; and the largest e / e(a).
    """
    room, segment = state.scratch.room[0], state.now[0].segment
    decayed, growth, term_at = room.decay_nodes[0], room.decay_nodes[1], room.decay_nodes[2]
    room.decay_coefficients[:] = 0.0
    largest = _fill_nodes(state, rate, start, decayed, term_at)
    if not largest < _TOO_STRONG:
        return _CAUTION * _TOO_STRONG / largest, 1.0
    store(growth, (-rate * strength * segment.half * segment.piece_half) * _combined(term_at, _INTEGRALS))
    largest = 1.0
    for n in range(LENGTH):
        if growth[n] <= -1.0:
            return _SHORTER, 1.0
        ratio = decayed[n] / (1.0 + growth[n])
        largest = max(largest, ratio)
        # f (e - e(a)), from p = f e(a) exp(r V)
        term_at[n] *= ((decayed[n] - 1.0) - growth[n]) / ((1.0 + growth[n]) * decayed[n])
    store(room.decay_coefficients[:], _combined(term_at, _COEFFICIENTS))
    return 1.0, largest


@kernel
def _resolved_part(state, strength, magnitude):
    """The part of the piece's duration that its polynomial resolves, 1 if all: by the term's last coefficients."""
    coefficients = state.scratch.room[0].decay_coefficients[:]
    left_out = abs(coefficients[LENGTH - 2]) + abs(coefficients[LENGTH - 1])
    allowed = _ALLOWED * EPSILON * magnitude / abs(strength)
    if left_out <= allowed or not left_out < math.inf:  # a value that is no number, which the event loop will find
        return 1.0
    return max(_SHORTER, _CAUTION * (allowed / left_out) ** (1.0 / LENGTH))


@kernel
def _finish_term(state, strength, start, term):
    """Fill `term`, and let the piece's load be all but the term's change, which is what remains in the piece's factor.

    Where the load and the term nearly balance, as at a start, their sum is rounded, and not each of them.
    """
    room = state.scratch.room[0]
    piece, change = room.decay_piece[:], _combined(room.decay_coefficients[:], _POWERS)
    at_start = start * vector(piece[1])
    store(term, at_start + change)
    store(piece[0], vector(piece[0]) + strength * at_start)
    store(piece[1], change)


@called_kernel
def _resolve(system, state, point):
    mode, segment, room = state.now[0].automaton.mode, state.now[0].segment, state.scratch.room[0]
    coordinate, channel = system.size[0].dynamic, len(state.z) - 2
    row, rate, whole = system.acceleration[mode, coordinate], system.decay.rate[mode], room.decay_segment[:]
    speed, term, start = point[system.size[0].coordinates + coordinate], state.z[channel], segment.mode_start
    for k in range(2):
        whole[k, :] = 0.0
    fill_form(row, system.terms[mode, coordinate], state.z, whole[0])
    fill_form(system.decay.factor[mode], system.decay.terms[mode], state.z, whole[1])
    term[:] = 0.0
    state.scale[channel] = 0.0
    if -rate * speed > _WELL_OVER:
        _pass_without(state, rate, speed, form_magnitude(row, state.scale))
        return
    e = math.exp(min(rate * speed, 0.0))  # a speed beyond zero is rounding
    duration = 1.0 - start
    for k in range(3):  # where the piece starts and, as far as is known by then, in its middle and at its end
        x = start + 0.5 * k * duration
        forcing = -rate * row[channel] * e * value(whole[1], x)
        half = _longest_half(-rate * value(whole[0], x), forcing, -rate * speed)
        duration = min(duration, _CAUTION * 2.0 * half / segment.half)
    part = 0.0
    while part < 1.0:
        duration = max(duration, _SHORTEST)
        set_piece(segment, start, start + duration if start + duration < 1.0 else 1.0)
        _fill_piece(state)
        part, largest = _fill_change(state, row[channel], rate, e)
        state.scale[channel] = e * largest * form_magnitude(system.decay.factor[mode], state.scale)
        if part == 1.0:
            part = _resolved_part(state, row[channel], form_magnitude(row, state.scale))
        if duration == _SHORTEST:
            break
        duration = part * 2.0 * segment.piece_half
    _finish_term(state, row[channel], e, term)


@kernel
def resolve_piece(system, state, point):
    """Begin a piece where the present mode begins, and solve its decaying term, if the mode has one.

    The piece ends where the term's polynomial would no longer reach rounding, and is the segment if there is no term.
    The polynomial belongs to the velocity in `point`.
    """
    set_piece(state.now[0].segment, -1.0, 1.0)
    if decays(system, state.now[0].automaton.mode):
        _resolve(system, state, point)


@kernel
def wanted_duration(state):
    """Longest duration [s] of the segment that its first piece allows; infinite if the segment may stay as it is."""
    segment = state.now[0].segment
    if segment.piece_half >= _LEAST_PIECE or segment.piece_end == 1.0:
        return math.inf
    return 2.0 * segment.half * segment.piece_half / _LEAST_PIECE
