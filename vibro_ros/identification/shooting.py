"""Robust multiple shooting: the parameters and the windows' states with which a simulation fits a recording.

What is minimised is the misfit

    sum of rho(residual), over measurements  +  sum of |defect / width|², over pairs of joined windows,

where a defect is the state at a window's end less that at the start of the next. A looseness of 1 permits defects of
1 mm and 0.1 m/s, blurs measurements by as much, and makes rho Cauchy's function, which gives an outlier little weight:
so a blow at a wrong instant does not hide what the rest of a motion says. The fit tightens the looseness to a
thousandth, where all windows are one motion, and looseness 0 of the measurements has their own noise and rho(r) = r².

Derivatives are differences of passes, one for each parameter and each number of a state, in all windows at once. The
state of a window meets only its own measurements and the next window. So the normal equations are block-tridiagonal
with a border for the parameters, and a step costs time in proportion to the number of windows. (H. G. Bock, Randwert-
problemmethoden zur Parameteridentifizierung, 1987, has the method; it is restarted here after every blow lost.)
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve, solveh_banded

from vibro_ros.identification.windows import Pass, Windows
from vibro_ros.simulation.processes import in_processes

#: Defects and blurs at looseness 1, by the end of a field's name: lengths [m], speeds [m/s], angles [rad], rates.
WIDTHS = {"position": 1e-3, "height": 1e-3, "velocity": 0.1, "angle": 0.01, "speed": 1.0, "current": 0.1}
TIGHT = 1e-3
"""Looseness of defects at which the windows are one motion."""
OUTLIER = 3.0
"""Blurred residual at which Cauchy's function gives a measurement half its weight."""
#: Steps of the differences: of a parameter's coordinate, and of a state's number in its width at looseness 1.
_STEP, _STATE_STEP = 1e-5, 1e-4
_LONGEST = 0.7  # longest change of a coordinate in a step: a positive parameter at most doubles
_TRIES, _LEAST_DAMPING, _GROWTH = 8, 1e-9, 10.0


def width_of(name: str) -> float:
    """Return the width of a field at looseness 1."""
    return WIDTHS[name.rsplit("_", 1)[1]]


@dataclass(frozen=True)
class Point:
    """Coordinates of the parameters, shape (parameters,), states at the windows' starts, shape (windows, states), and
    the pass that was made with them."""

    parameters: np.ndarray
    states: np.ndarray
    found: Pass

    @property
    def defects(self) -> np.ndarray:
        """State at each window's end less that at the start of the next, shape (windows - 1, states)."""
        return self.found.ends[:-1] - self.states[1:]


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
    """

    def __init__(self, windows: Windows, simulate: Callable[[np.ndarray, np.ndarray], Pass | None], workers: int = 1):
        self.windows, self._simulate, self._workers, self.passes = windows, simulate, workers, 0
        self.widths = np.array([width_of(name) for name in windows.names])
        self._blurs = np.array([width_of(one.field) for one in windows.recording.channels])[windows.channel]
        self.prior: tuple[np.ndarray, np.ndarray] | None = None

    def point(self, parameters: np.ndarray, states: np.ndarray) -> Point | None:
        """Return the point with these parameters and states; None where there is no motion."""
        self.passes += 1
        found = self._simulate(parameters, states)
        return found and Point(parameters, states, found)

    def jacobian(self, at: Point) -> Jacobian:
        """Return the derivatives at a point."""
        count, steps = len(at.parameters), self.widths * _STATE_STEP
        columns = [(_STEP * row, np.zeros(len(steps)), _STEP) for row in np.eye(count)]
        columns += [(np.zeros(count), step * row, step) for row, step in zip(np.eye(len(steps)), steps, strict=True)]

        def difference(column: tuple[np.ndarray, np.ndarray, float]) -> tuple[np.ndarray, np.ndarray]:
            parameters, states, step = column
            for sign in (1.0, -1.0):  # where one side is impossible, the other may not be
                there = self._simulate(at.parameters + sign * parameters, at.states + sign * states)
                if there is not None:
                    return ((there.residuals - at.found.residuals) / (sign * step),
                            (there.ends - at.found.ends) / (sign * step))
            return np.zeros_like(at.found.residuals), np.zeros_like(at.found.ends)

        self.passes += len(columns)
        found = [future.result() for _, future in in_processes(difference, columns, self._workers)]
        residuals, ends = (np.stack(part, axis=-1) for part in zip(*found, strict=True))
        return Jacobian(residuals[:, :count], residuals[:, count:], ends[..., :count], ends[..., count:])

    def losses(self, at: Point, looseness: float) -> tuple[np.ndarray, np.ndarray]:
        """Return rho of each residual, and the weight of its square in the Gauss-Newton equations."""
        squares = at.found.residuals**2
        if not looseness:
            return squares, np.ones(len(squares))
        shrunk = 1.0 / (1.0 + (looseness * self._blurs / self.windows.sigmas)**2)
        ratio = shrunk * squares / OUTLIER**2
        return OUTLIER**2 * np.log1p(ratio), shrunk / (1.0 + ratio)

    def misfit(self, at: Point, looseness: float, width: float) -> float:
        """Return what is minimised; `width` is the looseness of the defects."""
        defects = (at.defects / (width * self.widths))[self.windows.joined]
        total = float(self.losses(at, looseness)[0].sum() + np.sum(defects**2))
        if self.prior is not None:
            total += float(self.prior[1] @ (at.parameters - self.prior[0])**2)
        return total

    def equations(self, at: Point, jacobian: Jacobian, looseness: float, width: float) -> "NormalEquations":
        """Return the normal equations at a point."""
        (count, states), parameters = at.states.shape, len(at.parameters)
        weights, tight = self.losses(at, looseness)[1], 1.0 / (width * self.widths)
        diagonal, beside = np.zeros((count, states, states)), np.zeros((count, states, states))
        border, gradient = np.zeros((count, states, parameters)), np.zeros((count, states))
        corner, corner_gradient = np.zeros((parameters, parameters)), np.zeros(parameters)
        if self.prior is not None:
            corner += np.diag(self.prior[1])
            corner_gradient += self.prior[1] * (at.parameters - self.prior[0])

        def add(k: int, by_state: np.ndarray, by_own: np.ndarray, weight: np.ndarray, residual: np.ndarray) -> None:
            weighted, weighted_own = weight[:, None] * by_state, weight[:, None] * by_own
            diagonal[k] += weighted.T @ by_state
            border[k] += weighted.T @ by_own
            gradient[k] += weighted.T @ residual
            corner[:] += weighted_own.T @ by_own
            corner_gradient[:] += weighted_own.T @ residual

        for k, part in enumerate(self.windows.slices):
            add(k, jacobian.residuals_by_state[part], jacobian.residuals[part], weights[part],
                at.found.residuals[part])
        for k in np.flatnonzero(self.windows.joined).tolist():
            defect, by_own = at.defects[k], jacobian.ends[k]
            add(k, jacobian.ends_by_state[k], by_own, tight**2, defect)
            beside[k] = -jacobian.ends_by_state[k].T * tight**2
            diagonal[k + 1] += np.diag(tight**2)
            border[k + 1] -= tight[:, None]**2 * by_own
            gradient[k + 1] -= tight**2 * defect
        return NormalEquations(diagonal, beside, border, gradient, corner, corner_gradient)

    def minimise(self, at: Point, looseness: float, width: float, most: int, enough: float = 1e-3) -> Point:
        """Return the point after Levenberg-Marquardt steps: at most so many, or until one lowers the misfit by less
        than its share `enough` and 0.01."""
        misfit, damping = self.misfit(at, looseness, width), 1e-3
        for _ in range(most):
            before, equations = misfit, self.equations(at, self.jacobian(at), looseness, width)
            for _ in range(_TRIES):
                there = self._stepped(at, equations, damping)
                tried = np.inf if there is None else self.misfit(there, looseness, width)
                if there is not None and tried < misfit:
                    at, misfit, damping = there, tried, max(damping / _GROWTH, _LEAST_DAMPING)
                    break
                damping *= _GROWTH
            if before - misfit < max(0.01, enough * misfit):
                break
        return at

    def _stepped(self, at: Point, equations: "NormalEquations", damping: float) -> Point | None:
        try:
            own, states = equations.step(damping)
        except LinAlgError:
            return None
        shrink = min(1.0, _LONGEST / max(np.abs(own).max(), 1e-300))
        return self.point(at.parameters + shrink * own, at.states + shrink * states)

    def repaired(self, at: Point, looseness: float, others: Sequence[np.ndarray]) -> Point:
        """Return the point in which each window starts from the state with which it fits best: its own, the end of the
        window before, or that of `others`, each of shape (windows, states)."""
        follow = at.states.copy()
        follow[1:] = np.where(self.windows.joined[:, None], at.found.ends[:-1], follow[1:])
        for states in (follow, *others):
            there = self.point(at.parameters, states)
            if there is None:
                continue
            better = self._by_window(there, looseness) < 0.9 * self._by_window(at, looseness)
            if better.any():
                at = self.point(at.parameters, np.where(better[:, None], states, at.states)) or at
        return at

    def _by_window(self, at: Point, looseness: float) -> np.ndarray:
        return np.bincount(self.windows.window, self.losses(at, looseness)[0], len(at.states))


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
        schur, gradient, by_own, offset = self._eliminated(damping)
        own = -cho_solve(cho_factor(schur), gradient)
        return own, (-offset - by_own @ own).reshape(self.gradient.shape)

    def information(self) -> np.ndarray:
        """Return Fisher's information of the parameters, shape (p, p), when the states are unknown as well."""
        return self._eliminated(0.0)[0]

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
