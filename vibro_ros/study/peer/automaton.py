"""The mode automaton: what each guard's zero changes, as run-time parameters of the equations.

heyoka finds a root wherever an event's polynomial starts at zero, and its own remedy, a cooldown, would hide a true
event that follows at once (bounces that die out, N = 0 just after an impact). So cooldowns are off, and whatever fires
is put on its new side by less than a rounding error: a depth or a speed of the body by a nudge of the state, a force by
an offset of its guard.
"""

import math

import heyoka as hy
import numpy as np

from vibro_ros.study.peer.equations import Equations, Guide
from vibro_ros.study.peer.series import Series, leading

#: m; bounces at _REST_SPEED rise 5e-21 m, and heyoka's search for a root gives up on much finer scales.
_DEPTH_NUDGE = 1e-23
_SPEED_NUDGE = 1e-18  # m/s; outweighs the rounding error of the force, 1e-12 N, that a stick ends with
_FORCE_NUDGE = 1e-12  # N
#: docs/model.md: a mass that would rebound more slowly [m/s] rests.
_REST_SPEED = 1e-9
_FAINT = 1e-6  # m/s; the last bounce before a rest does not wake a sticking body, a blow with e = 0 does


class Automaton:
    """Modes of contacts and friction, and what happens at guards.

    Parameters
    ----------
    equations : Equations
    state, switches : ndarray
        The integrator's own arrays, changed in place.

    Attributes
    ----------
    events : list of (float, str, float, float)
        Instant [s], kind, and for contacts approach speed [m/s] and duration [s] (infinite while they last), else 0.
    origin : float
        Instant [s] from which the integrator counts time.
    """

    def __init__(self, equations: Equations, state: np.ndarray, switches: np.ndarray):
        self._equations, self._state, self._switches = equations, state, switches
        self._number, self._guides = equations.switches.number, equations.guides
        self._series = Series(equations, state, switches)
        self._place = {guide.side: 2 * i for i, guide in enumerate(equations.guides)}
        pushes = [guide.push for guide in self._guides]
        resting = [equations.forces[guide.side] for guide in self._guides]
        variables = [variable for variable, _ in equations.system]
        self._forces = hy.cfunc([equations.normal, equations.inertial, *pushes, *resting], vars=variables)
        self._read_switches = switches[:self._forces.nparams]  # guards have more
        self._values = np.empty(2 + len(pushes) + len(resting))
        holding = "ground.static_friction" if equations.scene["effects.friction"] == "static" else "ground.friction"
        self._holding = equations.scene[holding]
        self.begin()

    def begin(self) -> None:
        """Forget everything, as before a start."""
        self.events: list[tuple[float, str, float, float]] = []
        self._lasting: dict[str, int] = {}  # number of each guide's contact that has not ended
        self.origin = 0.0
        self.friction = ""
        self.contact = {guide.side: "open" for guide in self._guides}

    def set(self, name: str, value: float) -> None:
        """Set a run-time parameter, where the scene has it."""
        number = self._number.get(name)
        if number is not None:
            self._switches[number] = value

    def actions(self) -> dict[str, object]:
        """What each of `Equations.guards` does: a function of time [s] and the sign of the guard's derivative."""
        found = {}
        for guide in self._guides:
            side = guide.side
            found[f"{side} depth"] = lambda t, d, g=guide: self._cross_plate(t, g, d)
            found[f"{side} force"] = lambda t, d, g=guide: self._cross_force(t, g, d)
            found[f"{side} plate"] = lambda t, d, g=guide: self._meet_rigid(t, g)
            found[f"{side} kink"] = lambda t, d, g=guide: self._pass_kink(t, g, d)
        found["body forward"] = lambda t, d: self._leave_stick(t, 1.0) if self.friction == "stick" else self._stop(t)
        found["body backward"] = lambda t, d: self._leave_stick(t, -1.0)
        found["normal"] = self._cross_normal
        return found

    def _pass_kink(self, time: float, guide: Guide, direction: int) -> None:
        self.set(f"{guide.side}.sign", float(direction))
        self._reconsider_body(time)  # the slider's speed has jumped, and its damper's force

    def settle(self, time: float) -> None:
        """Decide every mode afresh, ties included."""
        for guide in self._guides:
            self._settle_plate(time, guide)
        if self._equations.body_moves:
            before, noted = self.friction, len(self.events)
            self._settle_body(time)
            del self.events[noted:]  # what it tried
            if before not in ("", self.friction):
                self._note(time, self.friction)

    # -- plates ----------------------------------------------------------------------------------------

    def _cross_plate(self, time: float, guide: Guide, direction: int) -> None:
        self._state[self._place[guide.side]] = direction * _DEPTH_NUDGE
        self._turn_compliant(time, guide, "closed" if direction > 0 else "open")
        if guide.plate_damping > 0.0:  # the force has jumped
            self._reconsider_body(time)
        self._check_plates(time)

    def _cross_force(self, time: float, guide: Guide, direction: int) -> None:
        self.set(f"{guide.side}.offset", direction * _FORCE_NUDGE - self._read(time)[2 + self._guides.index(guide)])
        self._turn_compliant(time, guide, "closed" if direction > 0 else "released")

    def _turn_compliant(self, time: float, guide: Guide, contact: str) -> None:
        side, old = guide.side, self.contact[guide.side]
        self.contact[side] = contact
        acts = contact == "closed"
        self.set(f"{side}.spring", guide.plate_stiffness if acts else 0.0)
        self.set(f"{side}.damper", guide.plate_damping if acts else 0.0)
        self.set(f"{side}.watch", 0.0 if contact == "open" else 1.0)
        if "released" not in (contact, old):
            self.set(f"{side}.offset", 0.0)
        if acts and old != "closed":
            self._begin_contact(time, side, self._state[self._place[side] + 1])
        elif old == "closed" and not acts:
            self._end_contact(time, side)

    def _check_plates(self, time: float) -> None:
        """Notice the other plate when it is crossed in the same instant."""
        for guide in self._guides:
            depth = self._state[self._place[guide.side]]
            wrong = guide.kind == "compliant" and depth * (0.5 - (self.contact[guide.side] == "open")) < 0.0
            if wrong and abs(depth) > 1e-13:
                raise RuntimeError(f"heyoka missed the {guide.side} plate by {depth:g} m before {time:.17g} s")
            if wrong:
                self._cross_plate(time, guide, 1 if depth > 0.0 else -1)

    def _meet_rigid(self, time: float, guide: Guide) -> None:
        """A blow, or the end of a rest."""
        at, side = self._place[guide.side], guide.side
        self._state[at] = -_DEPTH_NUDGE
        if self.contact[side] == "resting":
            self._part(time, side)
        else:
            self._strike(time, guide, self._state[at + 1])
        self._reconsider_body(time)

    def _strike(self, time: float, guide: Guide, approach: float) -> None:
        """Newton's restitution; M x' - m3 w' sin(phi) is kept, because a finite friction does nothing in no time."""
        at, equations, side = self._place[guide.side], self._equations, guide.side
        self._begin_contact(time, side, approach)
        rests = guide.restitution * approach <= _REST_SPEED
        rests = rests and self._read(time)[2 + len(self._guides) + self._guides.index(guide)] >= 0.0
        change = -approach if rests else -(1.0 + guide.restitution) * approach
        self._state[at + 1] += change
        if rests:
            self.contact[side] = "resting"
            self._state[at] = self._state[at + 1] = 0.0
            self.set(f"{side}.free", 0.0)
        else:
            self._end_contact(time, side)
        faint = rests and approach < _FAINT
        if side == "inclined" and equations.body_moves and not (faint and self.friction == "stick"):
            self._state[-1] += guide.mass * equations.sine / equations.total * change
            if self.friction == "stick":
                self._slip(time, 1.0 if self._state[-1] > 0.0 else -1.0)

    def _part(self, time: float, side: str) -> None:
        """Let a mass fly that may rest on its rigid plate."""
        if self.contact[side] == "resting":
            self._end_contact(time, side)
        self.contact[side] = "open"
        self.set(f"{side}.free", 1.0)

    def _settle_plate(self, time: float, guide: Guide) -> None:
        at = self._place[guide.side]
        if guide.kind == "restitution":
            self._settle_rigid(time, guide)
        if guide.kind != "compliant":
            return
        if self._state[at] != 0.0:
            sign = 1 if self._state[at] > 0.0 else -1
        else:
            sign = self._series.depth(time, guide)
            self._state[at] = (sign or -1) * _DEPTH_NUDGE
        if sign <= 0:
            self._turn_compliant(time, guide, "open")
        else:
            pulls = guide.watches_force and self._series.push(time, guide) < 0
            self._turn_compliant(time, guide, "released" if pulls else "closed")

    def _settle_rigid(self, time: float, guide: Guide) -> None:
        at, side = self._place[guide.side], guide.side
        approach = self._state[at + 1]
        if self.contact[side] == "resting" and approach == 0.0:
            return  # the guard of its force watches it
        self._part(time, side)
        if self._state[at] < 0.0:
            return
        if approach > 0.0 or (approach == 0.0 and self._series.depth(time, guide) > 0):
            self._strike(time, guide, approach)
        if self.contact[side] == "open":
            self._state[at] = -_DEPTH_NUDGE

    # -- the body on the ground ------------------------------------------------------------------------

    def _read(self, time: float) -> np.ndarray:
        """N, F_in, push of each compliant plate, force on each rigid one [N], in the present mode."""
        return self._forces(self._state, outputs=self._values, pars=self._read_switches, time=time)

    def _turn_friction(self, time: float, friction: str, direction: float = 0.0) -> None:
        inclined_free = self.contact.get("inclined") != "resting"
        slide, mobility = self._equations.mobility(direction, inclined_free)
        held = friction == "stick"
        self.set("slide", 0.0 if held else slide)
        self.set("mobility", 0.0 if held else mobility)
        self.set("stick", float(held))
        self.set("slip", float(friction.startswith("slip")))
        if self.friction not in ("", friction):
            self._note(time, friction)
        self.friction = friction

    def _slip(self, time: float, direction: float) -> None:
        if self._state[-1] * direction <= 0.0:
            self._state[-1] = direction * _SPEED_NUDGE
        self._turn_friction(time, "slip_forward" if direction > 0.0 else "slip_backward", direction)

    def _leave_stick(self, time: float, direction: float) -> None:
        if self._equations.rule == "unilateral" and self._read(time)[0] < 1e3 * _FORCE_NUDGE:  # N and F_in vanish both
            self._cross_normal(time, leading(*self._series.ground(time)[::2]) or 1)
        else:
            self._slip(time, direction)
            self.set("normal_offset", 0.0)

    def _stop(self, time: float) -> None:
        """x' has reached zero: stick, or slip on in the direction of F_in."""
        self._state[-1] = 0.0
        self._hold()
        normal, inertial = self._read(time)[:2]
        if abs(inertial) <= self._holding * normal:
            self._turn_friction(time, "stick")
        else:
            self._slip(time, 1.0 if inertial > 0.0 else -1.0)

    def _hold(self) -> None:
        self.set("slide", 0.0)
        self.set("mobility", 0.0)

    def _cross_normal(self, time: float, direction: int) -> None:
        if direction < 0:
            self._turn_friction(time, "unloaded")
        elif abs(self._state[-1]) <= _SPEED_NUDGE:
            self._stop(time)
        else:
            self._slip(time, 1.0 if self._state[-1] > 0.0 else -1.0)
        self.set("normal_offset", direction * _FORCE_NUDGE)
        self.set("normal_offset", direction * _FORCE_NUDGE - self._read(time)[0])

    def _reconsider_body(self, time: float) -> None:
        """Friction's state by the values of N and F_in, which may have jumped."""
        equations = self._equations
        if not equations.body_moves:
            return
        if not equations.rubs:
            self._turn_friction(time, "free")
            return
        self.set("normal_offset", 0.0)
        if self.friction == "stick":
            normal, inertial = self._read(time)[:2]
            if abs(inertial) > self._holding * normal:
                self._slip(time, 1.0 if inertial > 0.0 else -1.0)
        else:
            self._slip_or_unload(time, self._state[-1], self._read(time)[0] >= 0.0)
        if self.friction.startswith("slip"):
            self._slip_or_unload(time, self._state[-1], self._read(time)[0] >= 0.0)

    def _slip_or_unload(self, time: float, velocity: float, loaded: bool) -> None:
        if loaded or self._equations.rule != "unilateral":
            self._slip(time, 1.0 if velocity > 0.0 else -1.0)
        else:
            self._turn_friction(time, "unloaded")

    def _settle_body(self, time: float) -> None:
        equations = self._equations
        if not equations.rubs:
            self._turn_friction(time, "free")
            return
        self.set("normal_offset", 0.0)
        if abs(self._state[-1]) > _SPEED_NUDGE:
            direction = 1.0 if self._state[-1] > 0.0 else -1.0
        else:
            self._hold()
            normal, inertial, noise = self._series.ground(time)
            noise = (1.0 + self._holding) * noise
            bounds = self._holding * normal - inertial, self._holding * normal + inertial
            if all(leading(bound, noise) >= 0 for bound in bounds):
                self._state[-1] = 0.0
                self._turn_friction(time, "stick")
                return
            direction = float(leading(inertial, noise)) or 1.0
        self._slip(time, direction)
        if equations.rule == "unilateral" and leading(*self._series.ground(time)[::2]) < 0:
            self._turn_friction(time, "unloaded")

    def _note(self, time: float, kind: str) -> None:
        self.events.append((self.origin + time, kind, 0.0, 0.0))

    def _begin_contact(self, time: float, side: str, speed: float) -> None:
        self._lasting[side] = len(self.events)
        self.events.append((self.origin + time, f"{side}_contact", float(speed), math.inf))

    def _end_contact(self, time: float, side: str) -> None:
        number = self._lasting.pop(side)
        began, kind, speed, _ = self.events[number]
        self.events[number] = began, kind, speed, self.origin + time - began
