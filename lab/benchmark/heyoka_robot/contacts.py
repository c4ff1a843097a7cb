"""The robot's contacts: its body stands, slips, lifts off and lands; its plates close, bounce and open."""

from collections.abc import Callable
from typing import Any

import numpy as np

from benchmark.heyoka_robot.equations import BODY_PARAMETERS, Equations, Guide
from benchmark.heyoka_robot.run_state import GuardSeries, IntegrationState, leading_sign

_HEIGHT_NUDGE = 1e-23  # m
_SPEED_NUDGE = 1e-18  # m/s; outweighs the rounding error, 1e-12 N, of the force with which a stick ends
_FORCE_NUDGE = 1e-12  # N
#: Masses at rest stay on their plates when the body lands no faster [m/s] (docs/robot.md).
_SLOW_LANDING = 1e-9
_WITHOUT_LOAD = {"unilateral": "unloaded", "hop": "airborne"}


class Body:
    """The body: `free` (without friction), `stick`, `slip_forward`, `slip_backward`, `unloaded` or `airborne`.

    Attributes
    ----------
    friction : str
        State of the body; empty before a start.
    resting : frozenset of str
        Guides whose masses rest on rigid plates.
    feel_shock : callable
        What is called when a landing or a blow has changed the masses' speeds, with the time [s] and the guides whose
        masses no longer rest.
    strike_crank : callable
        What is called with the time [s] when a landing has changed the crank's speed.
    """

    def __init__(self, equations: Equations, run: IntegrationState, series: GuardSeries):
        self._equations, self._run, self._series = equations, run, series
        self._state, self._speed, self._height = run.state, equations.body + 1, equations.height
        rubs, self._static_frictions = equations.has_dry_friction, equations.static_frictions
        self._initial = "stick" if rubs else "free"
        self._without_load = _WITHOUT_LOAD.get(equations.rule, "") if rubs or equations.hops else ""
        self._modes = {(state, resting): np.array(equations.body_parameters(state, resting))
                       for resting in map(frozenset, ((), ("upper",), ("inclined",), ("upper", "inclined")))
                       for state in ("free", "stick", "slip_forward", "slip_backward", "unloaded", "airborne")}
        self._body_parameters = run.parameters[:len(BODY_PARAMETERS)]
        self.feel_shock: Callable[[float, frozenset[str]], None] = lambda time, parted: None
        self.strike_crank: Callable[[float], None] = lambda time: None
        self.reset()

    def reset(self) -> None:
        """Return to what holds before a start: no state, no mass at rest."""
        self.friction, self.resting = "", frozenset[str]()

    def actions(self) -> dict[str, Callable[[float, int], None]]:
        """The action of each guard of the body: a function of time [s] and the sign of the guard's derivative."""
        return {"body forward": lambda t, d: self._leave_stick(t, 1.0) if self.friction == "stick" else self._stop(t),
                "body backward": lambda t, d: self._leave_stick(t, -1.0), "normal": self._cross_normal_force,
                "decay": lambda t, d: None}  # a step must end at this zero, and nothing else changes

    def feel_blow(self, time: float, guide: Guide, change: float) -> None:
        """Change the body's speeds after a blow that has changed the speed of a mass by `change` [m/s].

        By the rule `hop` nothing holds the body, which is thrown up. By the other rules M x' - m3 w' sin(phi) does not
        change, because a finite friction force does nothing in a blow.
        """
        if self._equations.hops:
            self._throw(time, guide, change, frozenset())
        elif self._equations.body_moves and guide.side == "inclined":
            self._state[self._speed] += self._equations.blow_share * change
            if self.friction == "stick":
                self._slip(time, self._state[self._speed])

    def feel_last_blow(self, time: float, guide: Guide, change: float) -> None:
        """Change the body's speeds after the blow with which a mass comes to rest on its plate.

        Such a blow is too slow to lift the body off the ground, and to part another mass from its plate.
        """
        if self.friction == "airborne":
            self._throw(time, guide, change, self.resting)
        elif self._equations.body_moves and guide.side == "inclined" and self.friction != "stick":
            self._state[self._speed] += self._equations.blow_share * change

    def feel_rest(self, side: str, rests: bool) -> None:
        """Store whether the mass of a guide rests on its rigid plate."""
        self.resting = self.resting | {side} if rests else self.resting - {side}
        if self.friction == "airborne":
            self._body_parameters[:] = self._modes["airborne", self.resting]

    def _throw(self, time: float, guide: Guide, change: float, staying: frozenset[str]) -> None:
        """Throw the body up; the masses of the guides `staying` stay at rest on their plates, the others are free."""
        equations, state = self._equations, self._state
        along_x, upwards = equations.thrown_body_jumps(guide, change, staying)
        lifts = self.friction != "airborne"
        if lifts:
            self.friction = self.friction or self._initial
            self._unload(time)
        if equations.body_moves:
            state[self._speed] += along_x
        state[self._height + 1] += upwards
        self._move_free_masses(along_x, upwards, staying | {guide.side})
        parted = self.resting - staying if equations.scene["effects.reaction"] else frozenset()
        self.feel_shock(time, parted - {guide.side})
        fall = -self._run.upward_acceleration(time)
        if lifts and self.friction == "airborne" and fall > 0.0:
            self._run.announce_flight(2.0 * float(state[self._height + 1]) / fall)

    def _move_free_masses(self, along_x: float, upwards: float, not_free: frozenset[str]) -> None:
        for i, change in enumerate(self._equations.free_mass_jumps(along_x, upwards, not_free)):
            self._state[2 * i + 1] += change

    def settle(self, time: float) -> None:
        """Decide the state from the motion, also where a guard is exactly zero."""
        if self.friction == "airborne" or not (self._equations.body_moves or self._equations.hops):
            return
        self._run.set_parameter("normal_offset", 0.0)
        if not self.friction and self._equations.hops and np.any(self._state[self._height:self._height + 2]):
            self._enter(time, "airborne")  # a start in the air
            return
        previous, known = self.friction or self._initial, len(self._run.events)
        if self._equations.has_dry_friction:
            self._settle_friction(time)
        else:
            self._enter(time, "free")
        if self._without_load and leading_sign(*self._series.ground_force_series(time)[::2]) < 0:
            self._unload(time)
        del self._run.events[known:]  # of states that were only tried
        if previous != self.friction:
            self._add_event(time, previous)

    def _settle_friction(self, time: float) -> None:
        """Decide between stick and slip, at rest by the series of N and F_in."""
        if abs(self._state[self._speed]) > _SPEED_NUDGE:
            direction = self._state[self._speed]
        else:
            self._forces_in(time, "stick")
            normal, inertial, noise = self._series.ground_force_series(time)
            noise = (1.0 + max(self._static_frictions.values())) * noise
            bounds = [friction * normal - sign * inertial for sign, friction in self._static_frictions.items()]
            if all(leading_sign(bound, noise) >= 0 for bound in bounds):
                self._state[self._speed] = 0.0
                self._enter(time, "stick")
                return
            direction = leading_sign(inertial, noise) or 1
        self._slip(time, direction)

    def reconsider(self, time: float) -> None:
        """Decide the state by the values of N and F_in, because a force may have jumped."""
        equations = self._equations
        if self.friction == "airborne" or not (equations.body_moves or equations.hops):
            return
        self._run.set_parameter("normal_offset", 0.0)
        if equations.has_dry_friction:
            if self.friction == "stick":
                self._stop(time)
            else:
                self._slip_or_unload(time, self._state[self._speed])
        elif equations.hops and self._forces_in(time, "free")[0] < 0.0:
            self._unload(time)
        else:
            self._enter(time, "free")

    def _forces_in(self, time: float, friction: str) -> list[float]:
        """N and F_in [N] if the body were in the state `friction`; leaves the parameters of that state."""
        self._body_parameters[:] = self._modes[friction, self.resting]
        return self._run.ground_forces(time)

    def _slip_or_unload(self, time: float, direction: float) -> None:
        """Slip in the direction of the sign of `direction`, or unload if N of the slipping body is negative."""
        slipping = "slip_forward" if direction > 0.0 else "slip_backward"
        if self._without_load and self._forces_in(time, slipping)[0] < 0.0:
            self._unload(time)
        else:
            self._slip(time, direction)

    def _leave_stick(self, time: float, direction: float) -> None:
        """End the stick, because F_in has reached its bound in the direction of the sign of `direction`."""
        if self._without_load and self._run.ground_forces(time)[0] < 1e3 * _FORCE_NUDGE:  # N and F_in both vanish
            self._cross_normal_force(time, leading_sign(*self._series.ground_force_series(time)[::2]) or 1)
        else:
            self._slip_or_unload(time, direction)
            self._run.set_parameter("normal_offset", 0.0)

    def _stop(self, time: float) -> None:
        """Stop the body; then it sticks, or slips in the direction of F_in."""
        self._state[self._speed] = 0.0
        normal, inertial = self._forces_in(time, "stick")
        if abs(inertial) <= self._static_frictions[float(np.copysign(1.0, inertial))] * normal:
            self._enter(time, "stick")
        else:
            self._slip_or_unload(time, inertial)

    def _cross_normal_force(self, time: float, direction: int) -> None:
        """Change the state, because N has passed zero, or y in flight."""
        if self.friction == "airborne":
            self._land(time)
            return
        if direction < 0:
            self._unload(time)
        elif not self._equations.has_dry_friction:
            self._enter(time, "free")
        else:
            self._settle_friction(time)
        if self.friction != "airborne":
            self._run.set_parameter("normal_offset", direction * _FORCE_NUDGE - self._run.ground_forces(time)[0])

    def _enter(self, time: float, friction: str) -> None:
        """Set the parameters of a state, and add an event if the state is another one."""
        self._body_parameters[:] = self._modes[friction, self.resting]
        if self.friction != friction:
            previous, self.friction = self.friction, friction
            if previous:
                fall = -float(self._state[self._height + 1]) if previous == "airborne" else 0.0
                self._add_event(time, previous, fall)

    def _add_event(self, time: float, previous: str, fall: float = 0.0) -> None:
        """Add the event of a change from the state `previous`; a landing ends a `fall` [m/s]."""
        kind = "landing" if previous == "airborne" else "lift_off" if self.friction == "airborne" else self.friction
        self._run.add_event(time, kind, fall)

    def _slip(self, time: float, direction: float) -> None:
        forward = direction > 0.0
        if (self._state[self._speed] > 0.0) != forward or self._state[self._speed] == 0.0:
            self._state[self._speed] = _SPEED_NUDGE if forward else -_SPEED_NUDGE
        self._enter(time, "slip_forward" if forward else "slip_backward")

    def _unload(self, time: float) -> None:
        """Enter the state without load: in flight by the rule `hop`, else on ground that does not pull."""
        if self._equations.hops:
            self._state[self._height], self._state[self._height + 1] = _HEIGHT_NUDGE, 0.0
            self._run.set_parameter("normal_offset", 0.0)
        self._enter(time, self._without_load)

    def _land(self, time: float) -> None:
        """Land by a shock, whose changes of the masses' speeds may open a plate or lift the body again.

        With the reaction, masses at rest on rigid plates go on falling, unless the landing is slow. A slow landing is
        inelastic.
        """
        equations, state = self._equations, self._state
        speed_before = float(state[self._speed]) if equations.body_moves else 0.0
        fall = float(state[self._height + 1])
        parts = equations.scene["effects.reaction"] and -fall > _SLOW_LANDING
        staying = frozenset() if parts else self.resting
        restitution = equations.scene["ground.restitution"] if -fall > _SLOW_LANDING else 0.0
        coupling = self._run.coupling(time)
        speed_after, rise, sticks = equations.after_landing(speed_before, fall, staying, restitution, coupling)
        state[self._height] = 0.0
        if equations.body_moves:
            state[self._speed] = speed_after
        self._move_free_masses(speed_after - speed_before, rise - fall, staying)
        if equations.crank_is_struck:
            along, up, inertia = coupling
            state[equations.crank + 1] -= (along * (speed_after - speed_before) + up * (rise - fall)) / inertia
            self.strike_crank(time)
        if rise > 0.0:
            self._rebound(time, fall, rise, self.resting - staying)
            return
        if not equations.has_dry_friction:
            self._enter(time, "free")
        elif sticks:
            self._enter(time, "stick")
        else:
            self._slip(time, speed_after)
        state[self._height + 1] = 0.0
        self.feel_shock(time, self.resting - staying)
        self.reconsider(time)

    def _rebound(self, time: float, fall: float, rise: float, parted: frozenset[str]) -> None:
        """Leave the ground again with `rise` [m/s] after a landing with `fall`; the masses `parted` no longer rest."""
        self._state[self._height], self._state[self._height + 1] = _HEIGHT_NUDGE, rise
        self._run.add_event(time, "landing", -fall)
        self.feel_shock(time, parted)
        pull = -self._run.upward_acceleration(time)
        if pull > 0.0:
            self._run.announce_flight(2.0 * rise / pull)


_DEPTH_NUDGE = 1e-27  # m
_LEAST_RISE = 1e-26  # m; heyoka does not find the end of a bounce that rises less
_FAST = 0.1  # m/s; a faster rebound is no short flight unless the force is 1e3 times the usual one
#: A mass that arrives no faster [m/s] rests (docs/robot.md).
_REST_SPEED = 1e-9


class Plates:
    """The contacts, each in one of the states `open`, `closed`, `released`, `resting`, and the actions of their guards.
    """

    def __init__(self, equations: Equations, run: IntegrationState, body: Body, series: GuardSeries):
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
        actions: dict[str, Any] = {}
        for guide in self._guides:
            side = guide.side
            actions[f"{side} depth"] = lambda t, d, g=guide: self._cross_plate(t, g, d)
            actions[f"{side} force"] = lambda t, d, g=guide: self._cross_force(t, g, d)
            actions[f"{side} plate"] = lambda t, d, g=guide: self._meet_rigid(t, g)
            actions[f"{side} kink"] = lambda t, d, g=guide: self._pass_kink(t, g, d)
        return actions

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
