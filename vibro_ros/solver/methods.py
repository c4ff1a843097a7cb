"""The methods of `solver.method`, and their common contract, `Stepper`.

How to add a method
-------------------
A method of fixed step:

1. `fixed_step.py`: give the scheme a number, and write a kernel that fills `Step.end`, positions, velocities and
   forcing, from `Step.start`. `take_step` calls it. A kernel cannot allocate: give `Step` a field for each intermediate
   result, which `new_step` makes.
2. The kernel reads only the system's tables: `right_hand_side.accelerate` gives accelerations in a mode,
   `fill_forcing_at` sliders and plates at an instant. It never reads the guards; `_change_modes` changes the mode at
   the step's end, by the same candidates and jumps as the method exact.
3. `fixed_step._interpolate` reads samples between the ends of a step by cubic polynomials: a scheme of lower order
   needs another interpolation there.
4. Steps are a grid from the last command on, whatever is sampled, so that every division of time into calls gives the
   same bits. A scheme with a memory of earlier steps resets the memory in `fixed_step.begin`.
5. `SCHEMES` gives the scheme its name, and the choices of `solver.method` in `model/parameters.py` the same name.
6. For the accuracy study: a ladder of steps in `DEVICE` (`accuracy/programs.py`), and a colour in `_STYLES`
   (`accuracy/report.py`).
7. Tests: order of convergence, cut time, checkpoints and every effect in `test_fixed_steps.py`, published forces in
   `test_published_forces.py`. Documents: the table of docs/solver.md, and `make documents`.

A method without fixed steps is a class with the functions of `Stepper`, and `new_stepper`
(`simulation/motion.py`) makes it. Rules 4 to 7 hold for it, too.
"""

from typing import Protocol

import numpy as np

from vibro_ros.solver import event_loop, fixed_step
from vibro_ros.solver.fixed_step import RK4, RK4_LOCATED, new_step
from vibro_ros.solver.layout import Laid
from vibro_ros.solver.state import State, numbers_of

#: Methods of fixed step, by name.
SCHEMES = {"rk4": RK4, "rk4_located": RK4_LOCATED}


class Stepper(Protocol):
    """Interface of a method that advances a state; arguments and results are those of `event_loop`'s functions."""

    def begin(self, state: State, point: np.ndarray) -> int:
        """Begin with the positions and velocities of `point` now; return `REACHED`, or why the method cannot begin."""

    def advance(self, state: State, times: np.ndarray, point: np.ndarray, points: np.ndarray, modes: np.ndarray,
                phases: np.ndarray, events: np.ndarray) -> tuple[int, int, int]:
        """Advance to each of `times` and sample there; return status, number of samples and number of events."""

    def interrupt(self, state: State, time: float, point: np.ndarray) -> None:
        """Move clock and forcing to `time` and fill `point` with all channels; the caller then sets new rates and calls
        `begin`."""

    @property
    def memory(self) -> list[np.ndarray]:
        """Arrays of numbers, as views, on which the future depends besides the state."""


class _LaidOut:
    """Tables and state in the layout that kernels take, for both methods."""

    def __init__(self, system: Laid):
        self._system = system
        self._state: Laid | None = None  # of the last state

    def _laid(self, state: State) -> Laid:
        if self._state is None or self._state.values is not state:
            self._state = Laid(state)
        return self._state

    def _tables(self, state: State) -> tuple:
        return self._system.layout, self._laid(state).layout


class Exact(_LaidOut):
    """The method `exact`: the event loop."""

    def begin(self, state, point):
        """See `Stepper`."""
        return event_loop.begin_segment(self._system, self._laid(state), point)

    def advance(self, state, times, point, points, modes, phases, events):
        """See `Stepper`."""
        return event_loop.advance(*self._tables(state), times, point, points, modes, phases, events)

    def interrupt(self, state, time, point):
        """See `Stepper`."""
        event_loop.interrupt(*self._tables(state), time, point)

    def filter_rates(self, state, time):
        """Advance the filters of `State.lowpass` to `time`."""
        event_loop.filter_rates(*self._tables(state), time)

    @property
    def memory(self):
        """See `Stepper`."""
        return []


class FixedStep(_LaidOut):
    """A method of fixed step: steps of `step` [s] by one of `SCHEMES`."""

    def __init__(self, system: Laid, scheme: int, step: float):
        super().__init__(system)
        self._step = Laid(new_step(system.values, scheme, step))

    def begin(self, state, point):
        """See `Stepper`."""
        fixed_step.begin(*self._tables(state), point)
        return event_loop.REACHED

    def advance(self, state, times, point, points, modes, phases, events):
        """See `Stepper`."""
        return fixed_step.advance(*self._tables(state), times, points, modes, phases, events)

    def interrupt(self, state, time, point):
        """See `Stepper`."""
        fixed_step.interrupt(*self._tables(state), time, point)

    @property
    def memory(self):
        """See `Stepper`."""
        step = self._step.values
        return numbers_of(values for name, values in zip(step._fields, step, strict=True)
                          if name not in ("scheme", "length"))

    def _tables(self, state):
        return *super()._tables(state), self._step.layout
