"""The body's part of the automaton: stick, slip, a ground that does not pull, flight and landing."""

from collections.abc import Callable

import numpy as np

from vibro_ros.study.peer.equations import GROUND, Equations
from vibro_ros.study.peer.present import Present
from vibro_ros.study.peer.series import Series, leading

_HEIGHT_NUDGE = 1e-23  # m
_SPEED_NUDGE = 1e-18  # m/s; outweighs the rounding error of the force, 1e-12 N, that a stick ends with
_FORCE_NUDGE = 1e-12  # N
_WITHOUT_LOAD = {"unilateral": "unloaded", "hop": "airborne"}


class Body:
    """State of the body: `free` (no friction), `stick`, `slip_forward`, `slip_backward`, `unloaded`, `airborne`.

    Parameters
    ----------
    equations : Equations
    present : Present
    series : Series

    Attributes
    ----------
    friction : str
        Its state; empty before a start.
    inclined_free : bool
        Whether the inclined mass does not rest on a rigid plate.
    feel_landing : callable
        Called with the time [s] when a landing has changed the masses' speeds.
    """

    def __init__(self, equations: Equations, present: Present, series: Series):
        self._equations, self._present, self._series = equations, present, series
        self._state, self._speed, self._height = present.state, equations.body + 1, equations.height
        self._holding = equations.holding
        self._without_load = _WITHOUT_LOAD.get(equations.rule) if equations.rubs or equations.hops else None
        self._modes = {(state, free): np.array(equations.ground_mode(state, free)) for free in (True, False)
                       for state in ("free", "stick", "slip_forward", "slip_backward", "unloaded", "airborne")}
        self._ground_switches = present.switches[:len(GROUND)]
        self.feel_landing: Callable[[float], None] = lambda time: None
        self.begin()

    def begin(self) -> None:
        """Forget the state, as before a start."""
        self.friction, self.inclined_free = "", True

    def actions(self) -> dict[str, object]:
        """What each guard of the body does: a function of time [s] and the sign of the guard's derivative."""
        return {"body forward": lambda t, d: self._leave_stick(t, 1.0) if self.friction == "stick" else self._stop(t),
                "body backward": lambda t, d: self._leave_stick(t, -1.0), "normal": self._cross_normal}

    def feel_blow(self, time: float, change: float) -> None:
        """The inclined mass's speed has jumped by `change` [m/s]: M x' - m3 w' sin(phi) is kept, because a finite
        friction does nothing in no time."""
        if self._equations.body_moves:
            self._state[self._speed] += self._equations.share * change
            if self.friction == "stick":
                self._slip(time, self._state[self._speed])

    def settle(self, time: float) -> None:
        """Decide the state afresh, ties included."""
        if self.friction == "airborne" or not (self._equations.body_moves or self._equations.hops):
            return
        at_first = "stick" if self._equations.rubs else "free"
        before, noted = self.friction or at_first, len(self._present.events)
        self._present.set("normal_offset", 0.0)
        if self._equations.rubs:
            self._settle_friction(time)
        else:
            self._turn(time, "free")
        if self._without_load and leading(*self._series.ground(time)[::2]) < 0:
            self._unload(time)
        del self._present.events[noted:]  # what it tried
        if before != self.friction:
            self._present.note(time, _kind(before, self.friction))

    def _settle_friction(self, time: float) -> None:
        if abs(self._state[self._speed]) > _SPEED_NUDGE:
            direction = self._state[self._speed]
        else:
            self._try(time, "stick")
            normal, inertial, noise = self._series.ground(time)
            noise = (1.0 + self._holding) * noise
            bounds = self._holding * normal - inertial, self._holding * normal + inertial
            if all(leading(bound, noise) >= 0 for bound in bounds):
                self._state[self._speed] = 0.0
                self._turn(time, "stick")
                return
            direction = leading(inertial, noise) or 1
        self._slip(time, direction)

    def reconsider(self, time: float) -> None:
        """Decide by the values of N and F_in, which may have jumped."""
        equations = self._equations
        if self.friction == "airborne" or not (equations.body_moves or equations.hops):
            return
        self._present.set("normal_offset", 0.0)
        if equations.rubs:
            if self.friction == "stick":
                self._stop(time)
            else:
                self._slip_or_unload(time, self._state[self._speed])
        elif equations.hops and self._try(time, "free")[0] < 0.0:
            self._unload(time)
        else:
            self._turn(time, "free")

    def _try(self, time: float, friction: str) -> list[float]:
        """N and F_in, were the body in the state `friction`."""
        self._ground_switches[:] = self._modes[friction, self.inclined_free]
        return self._present.ground(time)

    def _slip_or_unload(self, time: float, direction: float) -> None:
        if self._without_load and self._try(time, _slipping(direction))[0] < 0.0:
            self._unload(time)
        else:
            self._slip(time, direction)

    # -- guards ----------------------------------------------------------------------------------------

    def _leave_stick(self, time: float, direction: float) -> None:
        if self._without_load and self._present.ground(time)[0] < 1e3 * _FORCE_NUDGE:  # N and F_in vanish both
            self._cross_normal(time, leading(*self._series.ground(time)[::2]) or 1)
        else:
            self._slip_or_unload(time, direction)
            self._present.set("normal_offset", 0.0)

    def _stop(self, time: float) -> None:
        """The body is at rest: stick, or slip in the direction of F_in."""
        self._state[self._speed] = 0.0
        normal, inertial = self._try(time, "stick")
        if abs(inertial) <= self._holding * normal:
            self._turn(time, "stick")
        else:
            self._slip_or_unload(time, inertial)

    def _cross_normal(self, time: float, direction: int) -> None:
        """N has passed zero, or in flight y."""
        if self.friction == "airborne":
            self._land(time)
            return
        if direction < 0:
            self._unload(time)
        elif not self._equations.rubs:
            self._turn(time, "free")
        else:
            self._settle_friction(time)
        if self.friction != "airborne":
            self._present.set("normal_offset", direction * _FORCE_NUDGE - self._present.ground(time)[0])

    # -- changes of state ------------------------------------------------------------------------------

    def _turn(self, time: float, friction: str) -> None:
        self._ground_switches[:] = self._modes[friction, self.inclined_free]
        if self.friction != friction:
            if self.friction:
                fall = -float(self._state[self._height + 1]) if self.friction == "airborne" else 0.0
                self._present.note(time, _kind(self.friction, friction), fall)
            self.friction = friction

    def _slip(self, time: float, direction: float) -> None:
        """Slip in the direction of the sign of `direction`."""
        forward = direction > 0.0
        if (self._state[self._speed] > 0.0) != forward or self._state[self._speed] == 0.0:
            self._state[self._speed] = _SPEED_NUDGE if forward else -_SPEED_NUDGE
        self._turn(time, _slipping(direction))

    def _unload(self, time: float) -> None:
        if self._equations.hops:
            self._state[self._height], self._state[self._height + 1] = _HEIGHT_NUDGE, 0.0
            self._present.set("normal_offset", 0.0)
        self._turn(time, self._without_load)

    def _land(self, time: float) -> None:
        """An inelastic shock; what it does to the masses may open a plate or lift the body again."""
        equations, state = self._equations, self._state
        before = float(state[self._speed]) if equations.body_moves else 0.0
        fall = float(state[self._height + 1])
        after, sticks = equations.shock(before, fall)
        state[self._height] = 0.0
        if equations.body_moves:
            state[self._speed] = after
        for i, change in enumerate(equations.kept_in_space(after - before, -fall)):
            state[2 * i + 1] += change
        if not equations.rubs:
            self._turn(time, "free")
        elif sticks:
            self._turn(time, "stick")
        else:
            self._slip(time, after)
        state[self._height + 1] = 0.0
        self.feel_landing(time)
        self.reconsider(time)


def _slipping(direction: float) -> str:
    return "slip_forward" if direction > 0.0 else "slip_backward"


def _kind(before: str, after: str) -> str:
    """Kind of the event that a change of state is."""
    return "landing" if before == "airborne" else "lift_off" if after == "airborne" else after
