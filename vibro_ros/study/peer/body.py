"""The body's part of the automaton: stick, slip, a ground that does not pull, flight and landing."""

from collections.abc import Callable

import numpy as np

from vibro_ros.study.peer.equations import GROUND, Equations, Guide
from vibro_ros.study.peer.present import Present
from vibro_ros.study.peer.series import Series, leading

_HEIGHT_NUDGE = 1e-23  # m
_SPEED_NUDGE = 1e-18  # m/s; outweighs the rounding error of the force, 1e-12 N, that a stick ends with
_FORCE_NUDGE = 1e-12  # N
#: docs/model.md: a body that lands no faster [m/s] keeps the masses at rest on their plates.
_SLOW_LANDING = 1e-9
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
    resting : frozenset of str
        Guides whose masses rest on rigid plates.
    feel_shock : callable
        Called with the time [s] and the guides that no longer rest, when a landing or a blow has changed the masses'
        speeds.
    """

    def __init__(self, equations: Equations, present: Present, series: Series):
        self._equations, self._present, self._series = equations, present, series
        self._state, self._speed, self._height = present.state, equations.body + 1, equations.height
        self._holding, self._at_first = equations.holding, "stick" if equations.rubs else "free"
        self._without_load = _WITHOUT_LOAD.get(equations.rule) if equations.rubs or equations.hops else None
        self._modes = {(state, resting): np.array(equations.ground_mode(state, resting))
                       for resting in map(frozenset, ((), ("upper",), ("inclined",), ("upper", "inclined")))
                       for state in ("free", "stick", "slip_forward", "slip_backward", "unloaded", "airborne")}
        self._ground_switches = present.switches[:len(GROUND)]
        self.feel_shock: Callable[[float, frozenset[str]], None] = lambda time, parted: None
        self.begin()

    def begin(self) -> None:
        """Forget the state, as before a start."""
        self.friction, self.resting = "", frozenset()

    def actions(self) -> dict[str, object]:
        """What each guard of the body does: a function of time [s] and the sign of the guard's derivative."""
        return {"body forward": lambda t, d: self._leave_stick(t, 1.0) if self.friction == "stick" else self._stop(t),
                "body backward": lambda t, d: self._leave_stick(t, -1.0), "normal": self._cross_normal,
                "decay": lambda t, d: None}  # that a step ends there is enough

    def feel_blow(self, time: float, guide: Guide, change: float) -> None:
        """A mass's speed has jumped by `change` [m/s]: on the ground M x' - m3 w' sin(phi) is kept, because a finite
        friction does nothing in no time; by the rule `hop` nothing holds the body at all."""
        if self._equations.hops:
            self._throw(time, guide, change, frozenset())
        elif self._equations.body_moves and guide.side == "inclined":
            self._state[self._speed] += self._equations.share * change
            if self.friction == "stick":
                self._slip(time, self._state[self._speed])

    def feel_last_blow(self, time: float, guide: Guide, change: float) -> None:
        """Likewise where the mass rests from now on, which is too slow to lift the body, or to part another mass."""
        if self.friction == "airborne":
            self._throw(time, guide, change, self.resting)
        elif self._equations.body_moves and guide.side == "inclined" and self.friction != "stick":
            self._state[self._speed] += self._equations.share * change

    def feel_rest(self, side: str, rests: bool) -> None:
        """A mass rests on its rigid plate from now on, or no longer."""
        self.resting = self.resting | {side} if rests else self.resting - {side}
        if self.friction == "airborne":
            self._ground_switches[:] = self._modes["airborne", self.resting]

    def _throw(self, time: float, guide: Guide, change: float, staying: frozenset[str]) -> None:
        """Let the masses of the guides `staying` rest on; with the reaction the others keep their speeds in space."""
        equations, state = self._equations, self._state
        along_x, upwards = equations.thrown(guide, change, staying)
        lifts = self.friction != "airborne"
        if lifts:
            self.friction = self.friction or self._at_first
            self._unload(time)
        if equations.body_moves:
            state[self._speed] += along_x
        state[self._height + 1] += upwards
        self._keep_in_space(along_x, upwards, staying | {guide.side})
        parted = self.resting - staying if equations.scene["effects.reaction"] else frozenset()
        self.feel_shock(time, parted - {guide.side})
        fall = -self._present.rise(time)
        if lifts and self.friction == "airborne" and fall > 0.0:
            self._present.expect(2.0 * float(state[self._height + 1]) / fall)

    def _keep_in_space(self, along_x: float, upwards: float, moved: frozenset[str]) -> None:
        for i, change in enumerate(self._equations.kept_in_space(along_x, upwards, moved)):
            self._state[2 * i + 1] += change

    def settle(self, time: float) -> None:
        """Decide the state afresh, ties included."""
        if self.friction == "airborne" or not (self._equations.body_moves or self._equations.hops):
            return
        before, noted = self.friction or self._at_first, len(self._present.events)
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
        self._ground_switches[:] = self._modes[friction, self.resting]
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
        self._ground_switches[:] = self._modes[friction, self.resting]
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
        """An inelastic shock; what it does to the masses may open a plate or lift the body again.

        A mass at rest on a rigid plate that feels it goes on falling, but for a landing that is slow.
        """
        equations, state = self._equations, self._state
        before = float(state[self._speed]) if equations.body_moves else 0.0
        fall = float(state[self._height + 1])
        parts = equations.scene["effects.reaction"] and -fall > _SLOW_LANDING
        staying = frozenset() if parts else self.resting
        after, sticks = equations.shock(before, fall, staying)
        state[self._height] = 0.0
        if equations.body_moves:
            state[self._speed] = after
        self._keep_in_space(after - before, -fall, staying)
        if not equations.rubs:
            self._turn(time, "free")
        elif sticks:
            self._turn(time, "stick")
        else:
            self._slip(time, after)
        state[self._height + 1] = 0.0
        self.feel_shock(time, self.resting - staying)
        self.reconsider(time)


def _slipping(direction: float) -> str:
    return "slip_forward" if direction > 0.0 else "slip_backward"


def _kind(before: str, after: str) -> str:
    """Kind of the event that a change of state is."""
    return "landing" if before == "airborne" else "lift_off" if after == "airborne" else after
