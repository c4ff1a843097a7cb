"""The vibro-impact capsule in the variables of its literature, integrated by scipy alone.

An internal mass on a spring and a damper inside a capsule, a weightless second spring at a gap, Coulomb's friction
under the capsule. Lengths in units of P_f / k1, times of sqrt(m1 / k1), forces of P_f, the friction force:

- y1' = a - z - 2 ξ z' - β max(z - δ, 0), z = x1 - x2, a the drive's force, usually α cos(ω τ + phase)
- γ y2' = -ρ a + z + 2 ξ z' + β max(z - δ, 0) - f, with f = sign(y2), or what keeps the capsule at rest up to 1

Friction backwards may be greater by a factor, the grip.

The internal mass is pushed by the capsule, ρ = 1, or from outside, ρ = 0. This module does not use this package's
solver, so that the comparison is independent.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp


class TerminalEvent:
    """An event of scipy's `solve_ivp`: a function of time and state at whose passage through zero an integration ends.

    `direction` is the sign of the zero crossings that are detected; 0 for both.
    """

    terminal = True  # so that scipy ends the integration there

    def __init__(self, function: Callable[[float, np.ndarray], float], direction: float):
        self._function, self.direction = function, direction

    def __call__(self, time: float, state: np.ndarray) -> float:
        """The function's value."""
        return self._function(time, state)


_TOLERANCE = 1e-11
# Least number of steps per period, so short that no contact lies within one step.
_STEPS_A_PERIOD = 40
# First step of a mode, so short that scipy does not miss a slide that begins and ends within one step.
_FIRST_STEP = 1e-6


@dataclass(frozen=True)
class Capsule:
    """Dimensionless parameters of a vibro-impact capsule."""

    alpha: float  # amplitude of the drive's force over the friction force
    omega: float  # frequency of the drive over that of the internal mass on its spring
    beta: float  # stiffness of the second spring over that of the first
    gamma: float  # mass of the capsule over the internal mass
    delta: float  # gap of the second spring over P_f / k1
    xi: float  # damping ratio of the internal mass on its spring
    # Friction against sliding backwards over that forwards; infinite for wheels that turn one way only.
    grip: float = 1.0

    @property
    def period(self) -> float:
        """Period of the drive in units of sqrt(m1 / k1)."""
        return 2.0 * math.pi / self.omega


@dataclass(frozen=True)
class Drive:
    """Drive of the internal mass: the force as a function of time, and the share ρ of its reaction on the capsule."""

    push: Callable[[float], float]
    reaction: float = 1.0


def harmonic(capsule: Capsule, phase: float, reaction: float = 1.0) -> Drive:
    """The drive α cos(ω τ + phase), phase in rad."""
    return Drive(lambda time: capsule.alpha * math.cos(capsule.omega * time + phase), reaction)


class _Equations:
    """Right-hand sides and guards; a mode is (slides: -1, 0 or 1; whether the second spring is touched)."""

    def __init__(self, capsule: Capsule, drive: Drive):
        self._capsule, self._drive = capsule, drive

    def forces(self, time: float, state: np.ndarray, touched: bool) -> tuple[float, float]:
        """Forces on the internal mass, and on the capsule without friction."""
        capsule, drive = self._capsule, self._drive
        stretch, speed = state[0] - state[2], state[1] - state[3]
        push = drive.push(time)
        spring = stretch + 2.0 * capsule.xi * speed + (capsule.beta * (stretch - capsule.delta) if touched else 0.0)
        return push - spring, spring - drive.reaction * push

    def rate(self, slides: int, touched: bool) -> Callable[[float, np.ndarray], list[float]]:
        """The right-hand side of a mode."""
        friction = slides if slides > 0 else slides * self._capsule.grip if slides else 0.0

        def right(time: float, state: np.ndarray) -> list[float]:
            mass, capsule = self.forces(time, state, touched)
            acceleration = (capsule - friction) / self._capsule.gamma if slides else 0.0
            return [state[1], mass, state[3] if slides else 0.0, acceleration]
        return right

    def guards(self, slides: int, touched: bool) -> list[TerminalEvent]:
        """Guards that end a mode: the second spring's gap, and the end of sliding or of rest."""
        def gap(_time: float, state: np.ndarray) -> float:
            return state[0] - state[2] - self._capsule.delta

        def friction(time: float, state: np.ndarray) -> float:
            force = self.forces(time, state, touched)[1]
            return state[3] if slides else min(1.0 - force, self._capsule.grip + force)

        return [TerminalEvent(gap, -1.0 if touched else 1.0),
                TerminalEvent(friction, -float(slides) if slides else -1.0)]

    def next_slides(self, time: float, state: np.ndarray, touched: bool, slides: int) -> int:
        """Direction of sliding after the friction's guard, 0 for rest."""
        force = self.forces(time, state, touched)[1]
        return 0 if slides and -self._capsule.grip <= force <= 1.0 else int(math.copysign(1.0, force))


def integrate(capsule: Capsule, times: np.ndarray, drive: Drive, speed: float = 0.0,
              tolerance: float = _TOLERANCE) -> np.ndarray:
    """States at `times`, ascending from 0, of a capsule that starts at rest with its spring relaxed.

    Parameters
    ----------
    capsule : Capsule
        The machine.
    times : ndarray, shape (n,)
        In units of sqrt(m1 / k1).
    drive : Drive
        Force and reaction of the drive.
    speed : float
        Speed of the internal mass at the start, dimensionless as all here.
    tolerance : float
        Relative and absolute tolerance of scipy, dimensionless.

    Returns
    -------
    ndarray, shape (n, 4)
        x1, y1, x2, y2: positions and speeds of internal mass and capsule.

    Raises
    ------
    RuntimeError
        If scipy fails.
    """
    equations, state, time = _Equations(capsule, drive), np.array([0.0, speed, 0.0, 0.0]), 0.0
    touched = capsule.delta < 0.0
    slides = equations.next_slides(0.0, state, touched, 1)
    states, done = np.empty((len(times), 4)), 0
    while done < len(times):
        piece = solve_ivp(equations.rate(slides, touched), (time, times[-1]), state, method="DOP853",
                          rtol=tolerance, atol=tolerance, max_step=capsule.period / _STEPS_A_PERIOD,
                          first_step=min(_FIRST_STEP, times[-1] - time),
                          events=equations.guards(slides, touched), dense_output=True)
        if not piece.success:
            raise RuntimeError(f"the capsule at {time:g}: {piece.message}")
        upto = len(times) if piece.status == 0 else int(np.searchsorted(times, piece.t[-1]))
        if upto > done:
            states[done:upto] = piece.sol(times[done:upto]).T
        done, time, state = upto, piece.t[-1], piece.y[:, -1].copy()
        if piece.status == 0:
            break
        if len(piece.t_events[0]):
            touched = not touched
        else:
            state[3] = 0.0 if slides else state[3]
            slides = equations.next_slides(time, state, touched, slides)
    return states
