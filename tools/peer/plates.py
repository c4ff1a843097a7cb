"""The states of the peer's contacts: they close and open; on rigid plates there are blows and rest."""

from collections.abc import Callable
from typing import Any

from tools.peer.body import Body
from tools.peer.equations import Equations, Guide
from tools.peer.run_state import RunState, Series

_DEPTH_NUDGE = 1e-27  # m
_LEAST_RISE = 1e-26  # m; heyoka does not find the end of a bounce that rises less
_FORCE_NUDGE = 1e-12  # N
_FAST = 0.1  # m/s; a faster rebound is no short flight unless the force is 1e3 times the usual one
#: A mass that arrives no faster [m/s] rests (docs/robot.md).
_REST_SPEED = 1e-9


class Plates:
    """The contacts, each in one of the states `open`, `closed`, `released`, `resting`, and the actions of their guards.
    """

    def __init__(self, equations: Equations, run: RunState, body: Body, series: Series):
        self._guides, self._run, self._body, self._series = equations.guides, run, body, series
        self._state, self._misprint = run.state, equations.scene["effects.misprint"]
        self._compliant = [guide for guide in equations.guides if guide.kind == "compliant"]
        self._index = {guide.side: 2 * i for i, guide in enumerate(equations.guides)}
        self.reset()

    def reset(self) -> None:
        """Return to what holds before a start: every contact is open."""
        self.contact = {guide.side: "open" for guide in self._guides}

    def actions(self) -> dict[str, Callable[[float, int], None]]:
        """The action of each guard of a guide: a function of time [s] and the sign of the guard's derivative."""
        found: dict[str, Any] = {}
        for guide in self._guides:
            side = guide.side
            found[f"{side} depth"] = lambda t, d, g=guide: self._cross_plate(t, g, d)
            found[f"{side} force"] = lambda t, d, g=guide: self._cross_force(t, g, d)
            found[f"{side} plate"] = lambda t, d, g=guide: self._meet_rigid(t, g)
            found[f"{side} kink"] = lambda t, d, g=guide: self._pass_kink(t, g, d)
        return found

    def _pass_kink(self, time: float, guide: Guide, direction: int) -> None:
        """Change the sign of the root in the slider's position."""
        self._run.set_parameter(f"{guide.side}.sign", float(direction))
        self._body.reconsider(time)  # the slider's speed has jumped, and with it the force of the drive's damper

    def settle(self, time: float) -> None:
        """Decide the state of every contact from the motion, also where a depth is exactly zero."""
        for guide in self._guides:
            if guide.kind == "restitution":
                self._settle_rigid(time, guide)
            elif guide.kind == "compliant":
                self._settle_compliant(time, guide)

    def _cross_plate(self, time: float, guide: Guide, direction: int) -> None:
        """Close or open the contact, because the depth has passed zero upwards (1) or downwards (-1)."""
        self._state[self._index[guide.side]] = direction * _DEPTH_NUDGE
        self._enter(time, guide, "closed" if direction > 0 else "open")
        if guide.plate_damping > 0.0 or self._is_misread(guide):  # the force on the body has jumped
            self._body.reconsider(time)
        for other in self._compliant:  # which may have been met in the same instant, or missed by heyoka
            depth = self._state[self._index[other.side]]
            wrong = depth > 0.0 if self.contact[other.side] == "open" else depth < 0.0
            if wrong and abs(depth) > 1e-13:
                raise RuntimeError(f"heyoka missed the {other.side} plate by {depth:g} m before {time:.17g} s")
            if wrong:
                self._cross_plate(time, other, 1 if depth > 0.0 else -1)

    def _cross_force(self, time: float, guide: Guide, direction: int) -> None:
        """Close or release the contact, because the plate's force has passed zero upwards (1) or downwards (-1)."""
        self._run.set_parameter(f"{guide.side}.offset", direction * _FORCE_NUDGE - self._run.plate_force(time, guide))
        self._enter(time, guide, "closed" if direction > 0 else "released")
        if self._is_misread(guide):
            self._body.reconsider(time)

    def _is_misread(self, guide: Guide) -> bool:
        """Whether the body feels another force than the mass from the plate's spring, which jumps at contact."""
        return self._misprint and guide.side == "inclined"

    def feel_shock(self, time: float, parted: frozenset[str]) -> None:
        """Change the contacts after a landing or a blow that has changed the masses' speeds.

        The masses of the guides `parted` no longer rest. Where the dampers' forces have changed, a plate without
        tension may let go or press again.
        """
        for guide in self._guides:
            if guide.side in parted:
                self._end_rest(time, guide.side)
                self._state[self._index[guide.side]] = -_DEPTH_NUDGE
        for guide in self._guides:
            if guide.side in parted:
                approach = float(self._state[self._index[guide.side] + 1])
                if approach > 0.0:
                    self._blow(time, guide, approach)
                else:
                    self._leave(time, guide, -approach)
        for guide in self._guides:
            if guide.watches_force and self.contact[guide.side] != "open":
                self._run.set_parameter(f"{guide.side}.offset", 0.0)
                self._enter(time, guide, "closed" if self._run.plate_force(time, guide) >= 0.0 else "released")

    def _enter(self, time: float, guide: Guide, contact: str) -> None:
        """Set the parameters of a compliant contact's state, and begin or end the event of the contact."""
        run, side, old = self._run, guide.side, self.contact[guide.side]
        self.contact[side] = contact
        acts = contact == "closed"
        run.set_parameter(f"{side}.spring", guide.plate_stiffness if acts else 0.0)
        if guide.plate_damping > 0.0:
            run.set_parameter(f"{side}.damper", guide.plate_damping if acts else 0.0)
            run.set_parameter(f"{side}.watch", 0.0 if contact == "open" else 1.0)
            if "released" not in (contact, old):
                run.set_parameter(f"{side}.offset", 0.0)
        if acts and old != "closed":
            run.begin_contact(time, side, self._state[self._index[side] + 1])
        elif old == "closed" and not acts:
            run.end_contact(time, side)

    def _settle_compliant(self, time: float, guide: Guide) -> None:
        """Decide the state of a compliant contact by depth and force, at zero by the sign just after."""
        at = self._index[guide.side]
        if self._state[at] != 0.0:
            sign = 1 if self._state[at] > 0.0 else -1
        else:
            sign = self._series.depth_sign(time, guide)
            self._state[at] = (sign or -1) * _DEPTH_NUDGE
        if sign <= 0:
            self._enter(time, guide, "open")
        else:
            pulls = guide.watches_force and self._series.plate_force_sign(time, guide) < 0
            self._enter(time, guide, "released" if pulls else "closed")

    def _meet_rigid(self, time: float, guide: Guide) -> None:
        """Strike the plate, or end a rest, because the depth or the pressing force has passed zero."""
        at, side = self._index[guide.side], guide.side
        self._state[at] = -_DEPTH_NUDGE
        if self.contact[side] == "resting":
            self._end_rest(time, side)
        else:
            self._blow(time, guide, float(self._state[at + 1]))
        self._body.reconsider(time)

    def _blow(self, time: float, guide: Guide, approach: float) -> None:
        """Rest after a slow approach; else strike a blow and fly, or rest where the bounce is very low."""
        if approach <= _REST_SPEED and self._run.pressing_force(time, guide) >= 0.0:
            self._rest(time, guide, approach, -approach)
            return
        rebound = guide.restitution * approach
        self._run.begin_contact(time, guide.side, approach)
        self._run.end_contact(time, guide.side)
        self._state[self._index[guide.side] + 1] = -rebound
        self._body.feel_blow(time, guide, -rebound - approach)
        self._leave(time, guide, rebound)

    def _leave(self, time: float, guide: Guide, rebound: float) -> None:
        """Leave the plate with `rebound` [m/s]; a flight so low that heyoka cannot find its end ends in rest."""
        if rebound > _FAST:
            return
        self._body.reconsider(time)
        pull = self._run.pressing_force(time, guide) / guide.mass
        if pull > 0.0:
            flight = 2.0 * rebound / pull
            if rebound**2 <= 2.0 * pull * _LEAST_RISE:
                self._rest(time + flight, guide, rebound, rebound)
            else:
                self._run.announce_flight(flight)

    def _rest(self, time: float, guide: Guide, approach: float, change: float) -> None:
        """Rest after an arrival with `approach` [m/s]; `change` [m/s] is the jump of the mass's speed."""
        at, side = self._index[guide.side], guide.side
        self._run.begin_contact(time, side, approach)
        self.contact[side] = "resting"
        self._state[at] = self._state[at + 1] = 0.0
        self._run.set_parameter(f"{side}.free", 0.0)
        self._body.feel_last_blow(time, guide, change)
        self._body.feel_rest(side, True)

    def _end_rest(self, time: float, side: str) -> None:
        """Open a rigid contact, and end its event if the mass was at rest."""
        if self.contact[side] == "resting":
            self._run.end_contact(time, side)
        self.contact[side] = "open"
        self._run.set_parameter(f"{side}.free", 1.0)
        self._body.feel_rest(side, False)

    def release_unpressed(self, time: float) -> None:
        """Part the masses from their rigid plates that nothing presses on them, because a force has jumped."""
        for guide in self._guides:
            if self.contact[guide.side] == "resting" and self._run.pressing_force(time, guide) < 0.0:
                self._end_rest(time, guide.side)
                self._state[self._index[guide.side]] = -_DEPTH_NUDGE
                self._body.reconsider(time)

    def _settle_rigid(self, time: float, guide: Guide) -> None:
        """Decide the state of a rigid contact by depth and approach, at zero by the sign just after."""
        at, side = self._index[guide.side], guide.side
        approach = float(self._state[at + 1])
        if self.contact[side] == "resting" and approach == 0.0:
            return  # the guard of the pressing force decides
        self._end_rest(time, side)
        if self._state[at] < 0.0:
            return
        if approach > 0.0 or (approach == 0.0 and self._series.depth_sign(time, guide) > 0):
            self._blow(time, guide, approach)
        if self.contact[side] == "open":
            self._state[at] = -_DEPTH_NUDGE
