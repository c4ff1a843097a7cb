"""What a guard leads to: the first of its candidate modes that is valid, after the jump on the way there."""

from vibro_ros.solver.compilation import kernel
from vibro_ros.solver.recording import form_value
from vibro_ros.solver.state import GUARD, MODE
from vibro_ros.solver.system import NOTHING

EPSILON = 2.220446049250313e-16
#: A guard's rounding error: a sum of products, each term of magnitude scale, through the series' first terms.
NOISE = 16.0 * EPSILON


@kernel
def _holds(system, state, row, point):
    """Whether a guard is not negative at `point`, to rounding."""
    first = 2 * system.sizes[0]
    total = 0.0
    noise = 0.0
    for channel in system.row_terms[row]:
        if channel == NOTHING:
            break
        factor = system.row[row, channel]
        total += factor * point[channel]
        if first <= channel < first + system.sizes[1]:
            noise += abs(factor) * state.work[3, channel - first]
        else:
            noise += abs(factor) * (abs(point[channel]) + state.scale[channel])
    return total >= -NOISE * noise


@kernel
def _accelerate(system, state, mode, point):
    """Set the accelerations of the dynamic coordinates at `point` to those of `mode`, and their scales in `work`."""
    first = 2 * system.sizes[0]
    for i in range(system.sizes[1]):
        total = 0.0
        scale = 0.0
        for channel in range(len(point)):
            factor = system.acceleration[mode, i, channel]
            total += factor * point[channel]
            scale += abs(factor) * (abs(point[channel]) + state.scale[channel])
        point[first + i] = total
        state.work[3, i] = scale


@kernel
def _jump(system, state, candidate, point):
    """Fill `trial` with `point` after the jump to a candidate of the firing guard."""
    mode, guard = state.index[MODE], state.index[GUARD]
    for channel in range(len(point)):
        state.trial[channel] = point[channel]
    jump = system.jump[mode, guard, candidate]
    if jump != NOTHING:
        for channel in range(2 * system.sizes[0]):
            state.trial[channel] = form_value(system.landing[jump, channel], point)


@kernel
def _is_valid(system, state, candidate, point):
    """Whether a candidate of the firing guard may be entered from `point`; fills `trial` with the point after."""
    mode, guard = state.index[MODE], state.index[GUARD]
    for entry in system.entry[mode, guard, candidate]:
        if entry != NOTHING and not _holds(system, state, entry, point):
            return False
    _jump(system, state, candidate, point)
    target = system.candidate[mode, guard, candidate]
    _accelerate(system, state, target, state.trial)
    for g in range(system.guard.shape[1]):
        if system.owner[target, g] == system.owner[mode, guard]:
            if not _holds(system, state, system.guard[target, g], state.trial):
                return False
    return True


@kernel
def choose_candidate(system, state, point):
    """Number of the firing guard's first valid candidate, else of its last; `trial` is the point after its jump."""
    candidates = system.candidate[state.index[MODE], state.index[GUARD]]
    last = 0
    while last + 1 < len(candidates) and candidates[last + 1] != NOTHING:
        if _is_valid(system, state, last, point):
            return last
        last += 1
    _jump(system, state, last, point)
    return last


@kernel
def keeps_flow(system, state, mode, point):
    """Whether `mode`, entered at `trial`, continues the dynamic coordinates' motion as it is at `point`."""
    if system.flow[state.index[MODE]] != system.flow[mode]:
        return False
    coordinates = system.sizes[0]
    for i in range(system.sizes[1]):
        if state.trial[i] != point[i] or state.trial[coordinates + i] != point[coordinates + i]:
            return False
    return True
