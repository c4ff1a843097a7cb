"""Robust multiple shooting: the parameters and the windows' states with which a simulation fits a recording.

What is minimised is the misfit

    sum of rho(residual), over measurements  +  sum of |defect / width|², over pairs of joined windows,

where a defect is the state at a window's end less that at the start of the next. A looseness of 1 permits defects of
1 mm and 0.1 m/s, blurs measurements by as much, and makes rho Cauchy's function, which gives an outlier little weight:
so a blow at a wrong instant does not hide what the rest of a motion says. The fit tightens the looseness to 1e-4, or
1e-3 if windows are short and many, where all windows are one motion, and looseness 0 of the measurements has their own
noise and rho(r) = r².

Derivatives are differences of passes, one for each parameter and each number of a state, in all windows at once. The
state of a window meets only its own measurements and the next window. So the normal equations are block-tridiagonal
with a border for the parameters, and a step costs time in proportion to the number of windows. (H. G. Bock, Randwert-
problemmethoden zur Parameteridentifizierung, 1987, has the method; it is restarted here after every blow lost.)
"""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve, solveh_banded

from vibro_lab.identification.windows import Pass, Windows
from vibro_ros import in_processes

#: Defects and blurs at looseness 1, by the end of a field's name: lengths [m], speeds [m/s], angles [rad], rates, and
#: an IMU's forces [m/s²].
WIDTHS = {"position": 1e-3, "height": 1e-3, "velocity": 0.1, "angle": 0.01, "speed": 1.0, "current": 0.1,
          "x": 30.0, "z": 30.0}
TIGHT = 1e-4
"""Looseness of defects at which the windows are one motion. At 1e-3 a defect still took some of the noise of each
window, and 95 % intervals covered 99 %; at 1e-4 they cover 97 %."""
_TIGHT_IF_COARSE = 1e-3  # for many short windows, whose joints bend: at 1e-4 the bend of a step outweighed what it won
RESOLVED = 1e-3
"""Looseness below which neither noise nor the bend of a motion counts: 1 µm, 0.1 mm/s."""
OUTLIER = 3.0
"""Blurred residual at which Cauchy's function gives a measurement half its weight."""
#: Steps of the differences: of a parameter's coordinate, and of a state's number in its width at looseness 1.
_STEP, _STATE_STEP = 1e-5, 1e-4
_LONGEST = 0.7  # longest change of a coordinate in a step: a positive parameter at most doubles
_TRIES, _LEAST_DAMPING, _GROWTH = 8, 1e-9, 10.0
#: Most steps with the same derivatives, and the share of what they say that a step wins while they hold.
_CHORDS, _HOLDS = 5, 0.7
_CORRECTIONS, _REJOININGS = 3, 6  # most of a step with the same derivatives; most rounds, of windows not adjacent
_LITTLE = 1e-3  # of the misfit, where a parameter is within a thirtieth of its standard deviation of the best
#: A window jumps if it spoils a step by this share of what the step should have won; largest share of such windows.
_JUMP, _MOST_LEFT_OUT = 0.3, 0.3
_TOLD = 1e-9  # share of a parameter's information that the others leave, below which rounding has made it
_HELD = 1e6  # times the largest curvature: the weight that holds a parameter at its limit


def width_of(name: str) -> float:
    """Return the width of a field at looseness 1."""
    return WIDTHS[name.rsplit("_", 1)[1]]


@dataclass(frozen=True)
class Point:
    """Coordinates of the parameters, shape (parameters,), states at the windows' starts, shape (windows, states), and
    the pass that was made with them."""

    parameters: np.ndarray
    states: np.ndarray
    simulated: Pass

    @property
    def defects(self) -> np.ndarray:
        """State at each window's end less that at the start of the next, shape (windows - 1, states)."""
        return self.simulated.ends[:-1] - self.states[1:]


@dataclass(frozen=True)
class Jacobian:
    """Derivatives at a point.

    Attributes
    ----------
    residuals, residuals_by_state : ndarray, shapes (measurements, parameters), (measurements, states)
        Of the residuals, by the parameters and by the state of their window.
    ends, ends_by_state : ndarray, shapes (windows, states, parameters), (windows, states, states)
        Of the states at the windows' ends.
    """

    residuals: np.ndarray
    residuals_by_state: np.ndarray
    ends: np.ndarray
    ends_by_state: np.ndarray


class Shooting:
    """Multiple shooting through windows.

    Parameters
    ----------
    windows : Windows
        The windows.
    simulate : callable
        Takes coordinates of parameters and states of windows, and returns a `Pass`, or None where there is no motion.
    workers : int
        Number of processes for the passes of a Jacobian.

    Attributes
    ----------
    passes : int
        Number of passes so far.
    prior : tuple of (ndarray, ndarray), or None
        Expected coordinates, and the weights of the squared distances from them.
    limits : sequence of (ndarray, float, float)
        Directions in the space of the parameters, with the least and the largest coordinate along each.
    left_out : ndarray of bool, shape (windows,)
        Windows that do not count, because their motion jumps: it depends on its start by more than differences tell,
        as where a mass grazes a plate or rattles to rest.
    is_coarse : bool
        Whether samples are so far apart that windows are short and many, and are asked for `jumps` at each new set of
        derivatives. Near samples lie within blows, which look like jumps and are none.
    """

    def __init__(self, windows: Windows, simulate: Callable[[np.ndarray, np.ndarray], Pass | None], workers: int = 1):
        self.windows, self._simulate, self._workers, self.passes = windows, simulate, workers, 0
        self.widths = np.array([width_of(name) for name in windows.names])
        self._blurs = np.array([width_of(channel.field) for channel in windows.recording.channels])[windows.channel]
        self.prior: tuple[np.ndarray, np.ndarray] | None = None
        self.left_out = np.zeros(len(windows.spans), bool)
        self.limits: Sequence[tuple[np.ndarray, float, float]] = ()
        self.is_coarse = False

    def with_limit(self, direction: np.ndarray, low: float, high: float) -> "Shooting":
        """Return a shooting through the same windows with one limit more, whose passes count from 0."""
        more = copy(self)
        more.passes, more.limits, more.left_out = 0, [*self.limits, (direction, low, high)], self.left_out.copy()
        return more

    @property
    def tight(self) -> float:
        """Looseness of defects at which the windows are one motion."""
        return _TIGHT_IF_COARSE if self.is_coarse else TIGHT

    def point(self, parameters: np.ndarray, states: np.ndarray) -> Point | None:
        """Return the point with these parameters and states; None where there is no motion."""
        self.passes += 1
        simulated = self._simulate(parameters, states)
        return None if simulated is None else Point(parameters, states, simulated)

    def jacobian(self, point: Point) -> Jacobian:
        """Return the derivatives at a point."""
        count, steps = len(point.parameters), self.widths * _STATE_STEP
        columns = [(_STEP * row, np.zeros(len(steps)), _STEP) for row in np.eye(count)]
        columns += [(np.zeros(count), step * row, step) for row, step in zip(np.eye(len(steps)), steps, strict=True)]

        def difference(column: tuple[np.ndarray, np.ndarray, float]) -> tuple[np.ndarray, np.ndarray]:
            parameters, states, step = column
            for sign in (1.0, -1.0):  # where one side is impossible, the other may not be
                trial = self._simulate(point.parameters + sign * parameters, point.states + sign * states)
                if trial is not None:
                    return ((trial.residuals - point.simulated.residuals) / (sign * step),
                            (trial.ends - point.simulated.ends) / (sign * step))
            return np.zeros_like(point.simulated.residuals), np.zeros_like(point.simulated.ends)

        self.passes += len(columns)
        differences = [future.result() for _, future in in_processes(difference, columns, self._workers)]
        residuals, ends = (np.stack(part, axis=-1) for part in zip(*differences, strict=True))
        return Jacobian(residuals[:, :count], residuals[:, count:], ends[..., :count], ends[..., count:])

    def jumps(self, point: Point, jacobian: Jacobian) -> np.ndarray:
        """Return which windows, shape (windows,), change otherwise than the derivatives say where the parameters go as
        little the other way: a jump within the difference would count as ten thousand times the information there is.
        """
        step = np.full(len(point.parameters), -_STEP)
        trial = self.point(point.parameters + step, point.states)
        if trial is None:
            return np.zeros(len(point.states), bool)

        change, promised = trial.simulated.residuals - point.simulated.residuals, jacobian.residuals @ step
        squares = [np.bincount(self.windows.window, part**2, len(point.states))
                   for part in (change - promised, promised)]
        ends = jacobian.ends @ step / self.widths
        beside = (trial.simulated.ends - point.simulated.ends) / self.widths - ends
        return (squares[0] > _JUMP**2 * squares[1]) | (
            np.sum(beside**2, axis=1) > _JUMP**2 * np.sum(ends**2, axis=1))

    def losses(self, point: Point, looseness: float) -> tuple[np.ndarray, np.ndarray]:
        """Return rho of each residual, and the weight of its square in the Gauss-Newton equations."""
        squares = point.simulated.residuals**2
        if not looseness:
            return squares, np.ones(len(squares))
        shrunk = 1.0 / (1.0 + (looseness * self._blurs / self.windows.spreads)**2)
        ratio = shrunk * squares / OUTLIER**2
        return OUTLIER**2 * np.log1p(ratio), shrunk / (1.0 + ratio)

    @property
    def _joined(self) -> np.ndarray:
        return self.windows.joined & ~self.left_out[:-1] & ~self.left_out[1:]

    def joints(self, defects: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
        """Return rho of each defect, and the weight of its square, shape (windows - 1,). Where samples are far apart a
        window may fit them in a motion with another blow, to which no other window joins: it must not tear them."""
        squares = np.where(self._joined, np.sum((defects / (width * self.widths))**2, axis=1), 0.0)
        if not self.is_coarse:
            return squares, self._joined.astype(float)
        most = OUTLIER**2 * len(self.widths)
        return most * np.log1p(squares / most), self._joined / (1.0 + squares / most)

    def by_window(self, point: Point, looseness: float, width: float) -> np.ndarray:
        """Return the misfit of each window and of its defect, shape (windows,); 0 for those that are left out."""
        misfits = np.bincount(self.windows.window, self.losses(point, looseness)[0], len(point.states))
        misfits[:-1] += self.joints(point.defects, width)[0]
        return np.where(self.left_out, 0.0, misfits)

    def misfit(self, point: Point, looseness: float, width: float) -> float:
        """Return what is minimised; `width` is the looseness of the defects."""
        return float(self.by_window(point, looseness, width).sum()) + self._prior_misfit(point)

    def _prior_misfit(self, point: Point) -> float:
        return float(self.prior[1] @ (point.parameters - self.prior[0])**2) if self.prior else 0.0

    def equations(self, point: Point, jacobian: Jacobian, looseness: float, width: float) -> "NormalEquations":
        """Return the normal equations at a point."""
        (count, states), parameters = point.states.shape, len(point.parameters)
        weights, tight = self.losses(point, looseness)[1], 1.0 / (width * self.widths)
        weights = np.where(self.left_out[self.windows.window], 0.0, weights)
        diagonal, beside = np.zeros((count, states, states)), np.zeros((count, states, states))
        border, gradient = np.zeros((count, states, parameters)), np.zeros((count, states))
        corner, corner_gradient = np.zeros((parameters, parameters)), np.zeros(parameters)
        if self.prior is not None:
            corner += np.diag(self.prior[1])
            corner_gradient += self.prior[1] * (point.parameters - self.prior[0])

        def add(k: int, by_state: np.ndarray, by_parameters: np.ndarray, weight: np.ndarray,
                residual: np.ndarray) -> None:
            weighted, weighted_by_parameters = weight[:, None] * by_state, weight[:, None] * by_parameters
            diagonal[k] += weighted.T @ by_state
            border[k] += weighted.T @ by_parameters
            gradient[k] += weighted.T @ residual
            corner[:] += weighted_by_parameters.T @ by_parameters
            corner_gradient[:] += weighted_by_parameters.T @ residual

        for k, part in enumerate(self.windows.slices):
            add(k, jacobian.residuals_by_state[part], jacobian.residuals[part], weights[part],
                point.simulated.residuals[part])
        joints = self.joints(point.defects, width)[1]
        for k in np.flatnonzero(joints).tolist():
            defect, by_parameters, weight = point.defects[k], jacobian.ends[k], joints[k] * tight**2
            add(k, jacobian.ends_by_state[k], by_parameters, weight, defect)
            beside[k] = -jacobian.ends_by_state[k].T * weight
            diagonal[k + 1] += np.diag(weight)
            border[k + 1] -= weight[:, None] * by_parameters
            gradient[k + 1] -= weight * defect
        return NormalEquations(diagonal, beside, border, gradient, corner, corner_gradient)

    def minimise(self, point: Point, looseness: float, width: float, most: int, enough: float = 1e-3,
                 jacobian: Jacobian | None = None) -> Point:
        """Return the point after Levenberg-Marquardt steps. Windows that jump are left out from then on.

        Derivatives serve for further steps as long as these win what the derivatives say. They are computed anew at
        most so many times, or until the misfit is lowered, or would be by what they say, by less than its share
        `enough` and 0.001. `jacobian` has derivatives of a point nearby to begin with.
        """
        damping = 1e-3
        for _ in range(most):
            fresh = jacobian is None
            if jacobian is None:
                point = self.rejoined(point, looseness, width) if self.is_coarse else point
                jacobian = self.jacobian(point)
                if self.is_coarse and not looseness:
                    self._leave_out(self.jumps(point, jacobian))
            earlier_misfit = self.misfit(point, looseness, width)
            little = max(_LITTLE, enough * earlier_misfit)
            for chord in range(_CHORDS):
                trial, promised, damping = self._lower(point, jacobian, looseness, width, damping, fresh and not chord,
                                                       little)
                if trial is None:
                    break
                won = self.misfit(point, looseness, width) - self.misfit(trial, looseness, width)
                point = trial
                if won < _HOLDS * promised or promised < little:
                    break
            if promised < little or (fresh and earlier_misfit - self.misfit(point, looseness, width) < little):
                break
            jacobian = None
        return point

    def _lower(self, point: Point, jacobian: Jacobian, looseness: float, width: float, damping: float, fresh: bool,
               little: float) -> tuple[Point | None, float, float]:
        """Return a point with a lower misfit, None if none is found; by how much the derivatives said that the first
        step would lower it; and the damping to go on with. Only `fresh` derivatives, those of the point itself, tell
        what jumps, and are worth more than one step. A step that would win less than `little` tells nothing of jumps,
        because it is spoilt by much smaller ones. Where windows are many and short, a step that bends their joints is
        corrected with the same derivatives first: only what they do not mend is a jump."""
        first = np.inf
        for _ in range(_TRIES if fresh else 1):
            misfit = self.misfit(point, looseness, width)  # of the windows that are not left out by now
            step = self._step(point, self.equations(point, jacobian, looseness, width), damping)
            trial = step and self.point(point.parameters + step[0], point.states + step[1])
            jumped = np.zeros(len(self.left_out), bool)
            if trial:
                change = self._change(point, trial, jacobian, looseness, width)
                promised = self._prior_misfit(point) - self._prior_misfit(trial) - float(change.sum())
                first = promised if first == np.inf else first
                if self.is_coarse and not looseness:
                    trial = self._corrected(trial, jacobian, looseness, width, damping, misfit)
                if self.misfit(trial, looseness, width) < misfit:
                    return trial, first, max(damping / _GROWTH, _LEAST_DAMPING)
                if promised < little:
                    break
                risen = self.by_window(trial, looseness, width) - self.by_window(point, looseness, width)
                jumped = (risen > 1.0) & (risen - change > _JUMP * max(promised, 1.0))
            if fresh and not self._leave_out(jumped):
                damping *= _GROWTH
        return None, first, damping

    def _corrected(self, point: Point, jacobian: Jacobian, looseness: float, width: float, damping: float,
                   enough: float) -> Point:
        """Return the point after steps with derivatives of another point, while they lower the misfit that is not yet
        below `enough`."""
        for _ in range(_CORRECTIONS):
            if self.misfit(point, looseness, width) < enough:
                break
            step = self._step(point, self.equations(point, jacobian, looseness, width), damping)
            trial = step and self.point(point.parameters + step[0], point.states + step[1])
            if not trial or self.misfit(trial, looseness, width) >= self.misfit(point, looseness, width):
                break
            point = trial
        return point

    def _step(self, point: Point, equations: "NormalEquations", damping: float) -> tuple[np.ndarray, np.ndarray] | None:
        """Return the step of parameters and states that stays within the limits; None if there is none."""
        try:
            parameter_step, state_step = equations.step(damping)
            for direction, low, high in self.limits:
                now, trial = float(direction @ point.parameters), float(direction @ (point.parameters + parameter_step))
                if not low <= trial <= high:  # the others must not move as if this one went beyond
                    weight = _HELD * max(float(np.diag(equations.corner).max()), 1.0)
                    equations = equations.held(direction, weight, now - min(max(trial, low), high))
                    parameter_step, state_step = equations.step(damping)
        except LinAlgError:
            return None
        shrink = min(1.0, _LONGEST / max(np.abs(parameter_step).max(), 1e-300))
        return shrink * parameter_step, shrink * state_step

    def _change(self, point: Point, trial: Point, jacobian: Jacobian, looseness: float, width: float) -> np.ndarray:
        """Return the change of each window's misfit that the derivatives say, shape (windows,)."""
        parameter_step, state_step = trial.parameters - point.parameters, trial.states - point.states
        weights = np.where(self.left_out[self.windows.window], 0.0, self.losses(point, looseness)[1])
        linear = (point.simulated.residuals + jacobian.residuals @ parameter_step
                  + np.sum(jacobian.residuals_by_state * state_step[self.windows.window], axis=1))
        change = np.bincount(self.windows.window, weights * (linear**2 - point.simulated.residuals**2), len(state_step))
        defects = (point.defects + jacobian.ends[:-1] @ parameter_step
                   + np.einsum("kij,kj->ki", jacobian.ends_by_state[:-1], state_step[:-1]) - state_step[1:])
        squares = np.sum((defects**2 - point.defects**2) / (width * self.widths)**2, axis=1)
        change[:-1] += self.joints(point.defects, width)[1] * squares
        return change

    def _leave_out(self, jumped: np.ndarray) -> bool:
        """Leave out windows that jump, unless they are too many; return whether there are any."""
        jumped = jumped & ~self.left_out
        if not jumped.any() or (self.left_out | jumped).mean() > _MOST_LEFT_OUT:
            return False
        self.left_out |= jumped
        return True

    def repaired(self, point: Point, looseness: float, others: Sequence[np.ndarray]) -> Point:
        """Return the point in which each window starts from the state with which it fits best: its own, the end of the
        window before, or that of `others`, each of shape (windows, states)."""
        def by_window(point: Point) -> np.ndarray:
            return np.bincount(self.windows.window, self.losses(point, looseness)[0], len(point.states))

        follow = point.states.copy()
        follow[1:] = np.where(self.windows.joined[:, None], point.simulated.ends[:-1], follow[1:])
        for states in (follow, *others):
            trial = self.point(point.parameters, states)
            if trial is None:
                continue
            better = by_window(trial) < 0.9 * by_window(point)
            if better.any():
                point = self.point(point.parameters, np.where(better[:, None], states, point.states)) or point
        return point

    def rejoined(self, point: Point, looseness: float, width: float) -> Point:
        """Return the point in which windows start where the one before ends, if that lowers the misfit: one that fits
        its few samples in a motion with another blow is torn from it, and small steps do not lead back."""
        def rho(defects: np.ndarray) -> np.ndarray:
            return np.concatenate([[0.0], self.joints(defects, width)[0], [0.0]])

        for _ in range(_REJOININGS):
            torn = rho(point.defects)[:-1] > OUTLIER**2 * len(self.widths)
            ends_before = np.concatenate([point.states[:1], point.simulated.ends[:-1]])
            follow = np.where(torn[:, None], ends_before, point.states)
            if not torn.any() or (trial := self.point(point.parameters, follow)) is None:
                break
            before, after = rho(point.defects), rho(trial.simulated.ends[:-1] - point.states[1:])
            losses = self.losses(trial, looseness)[0] - self.losses(point, looseness)[0]
            change = np.bincount(self.windows.window, losses, len(torn)) + after[1:] - before[1:] - before[:-1]
            better = torn & ~self.left_out & (change < -1.0)
            for k in np.flatnonzero(better).tolist():
                better[k] &= not better[k - 1]  # of two neighbours one stays, else neither joins
            if not better.any():
                break
            point = self.mixed(point, trial, better)
        return point

    def mixed(self, point: Point, other: Point, are_others: np.ndarray) -> Point:
        """Return the point of which some windows, shape (windows,), are another's with the same parameters."""
        return Point(point.parameters, np.where(are_others[:, None], other.states, point.states), Pass(
            np.where(are_others[self.windows.window], other.simulated.residuals, point.simulated.residuals),
            np.where(are_others[:, None], other.simulated.ends, point.simulated.ends)))


@dataclass(frozen=True)
class NormalEquations:
    """Normal equations of n windows with s numbers of state and p parameters.

    Attributes
    ----------
    diagonal, beside : ndarray, shape (n, s, s)
        Blocks of each window with itself and with the next.
    border : ndarray, shape (n, s, p)
        Blocks of states with parameters.
    corner : ndarray, shape (p, p)
        Block of the parameters.
    gradient, corner_gradient : ndarray, shapes (n, s), (p,)
        Half the gradient by states and by parameters.
    """

    diagonal: np.ndarray
    beside: np.ndarray
    border: np.ndarray
    gradient: np.ndarray
    corner: np.ndarray
    corner_gradient: np.ndarray

    def step(self, damping: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Return the step of parameters and states; `damping` is the share by which the diagonal grows (LinAlgError:
        if the equations are singular)."""
        schur, gradient, by_parameters, offset = self._eliminated(damping)
        parameter_step = -cho_solve(cho_factor(schur), gradient)
        return parameter_step, (-offset - by_parameters @ parameter_step).reshape(self.gradient.shape)

    def states_for(self, parameter_change: np.ndarray) -> np.ndarray:
        """Return the change of the states that follows a change of the parameters, shape (n, s)."""
        return -(self._eliminated(0.0)[2] @ parameter_change).reshape(self.gradient.shape)

    def held(self, direction: np.ndarray, weight: float, distance: float) -> "NormalEquations":
        """Return the equations with the parameters held along a direction, from which they are `distance` away."""
        return replace(self, corner=self.corner + weight * np.outer(direction, direction),
                       corner_gradient=self.corner_gradient + weight * distance * direction)

    def information(self) -> np.ndarray:
        """Return Fisher's information of the parameters, shape (p, p), when the states are unknown as well."""
        return self._eliminated(0.0)[0]

    def gain_of_last(self) -> float:
        """Return by how much the misfit falls where the last parameter is free, to first order, if all others are at
        their best (a score test)."""
        matrix, gradient = self._eliminated(0.0)[:2]
        along = np.linalg.pinv(matrix[:-1, :-1], hermitian=True) @ np.column_stack([matrix[:-1, -1], gradient[:-1]])
        told = float(matrix[-1, -1] - matrix[-1, :-1] @ along[:, 0])
        left = float(gradient[-1] - matrix[-1, :-1] @ along[:, 1])
        return left**2 / told if told > _TOLD * matrix[-1, -1] else 0.0

    def _eliminated(self, damping: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Eliminate the states: return what is left of `corner` and its gradient, and the states' step by those."""
        count, states = self.gradient.shape
        upper, size = 2 * states - 1, count * states
        banded = np.zeros((upper + 1, size))
        for i in range(states):
            for j in range(states):
                if j >= i:
                    banded[upper + i - j, j::states] = self.diagonal[:, i, j] * (1.0 + damping * (i == j))
                banded[upper + i - j - states, j + states::states] = self.beside[:-1, i, j]
        banded[upper] += 1e-14 * banded[upper].max()  # a number that no measurement meets stays where it is
        border = self.border.reshape(size, -1)
        solved = solveh_banded(banded, np.column_stack([border, self.gradient.ravel()]))
        corner = self.corner + damping * np.diag(np.diag(self.corner)) - border.T @ solved[:, :-1]
        return corner, self.corner_gradient - border.T @ solved[:, -1], solved[:, :-1], solved[:, -1]
