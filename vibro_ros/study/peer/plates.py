"""The plates' part of the automaton: contacts that close and open, blows, rest."""

from vibro_ros.study.peer.body import Body
from vibro_ros.study.peer.equations import Equations, Guide
from vibro_ros.study.peer.present import Present
from vibro_ros.study.peer.series import Series

_DEPTH_NUDGE = 1e-27  # m
_LEAST_RISE = 1e-26  # m; heyoka's search for a root gives up on a bounce that rises less
_FORCE_NUDGE = 1e-12  # N
_FAST = 0.1  # m/s; flies for longer under any force that is not 1e3 times the usual
#: docs/model.md: a mass that arrives no faster [m/s] rests.
_REST_SPEED = 1e-9


class Plates:
    """State of each contact, `open`, `closed`, `released` or `resting`, and what changes it.

    Parameters
    ----------
    equations : Equations
    present : Present
    body : Body
        Which must hear of forces and speeds that jump.
    series : Series
    """

    def __init__(self, equations: Equations, present: Present, body: Body, series: Series):
        self._guides, self._present, self._body, self._series = equations.guides, present, body, series
        self._state = present.state
        self._compliant = [guide for guide in equations.guides if guide.kind == "compliant"]
        self._place = {guide.side: 2 * i for i, guide in enumerate(equations.guides)}
        self.begin()

    def begin(self) -> None:
        """Every plate is free, as before a start."""
        self.contact = {guide.side: "open" for guide in self._guides}

    def actions(self) -> dict[str, object]:
        """What each guard of a guide does: a function of time [s] and the sign of the guard's derivative."""
        found = {}
        for guide in self._guides:
            side = guide.side
            found[f"{side} depth"] = lambda t, d, g=guide: self._cross_plate(t, g, d)
            found[f"{side} force"] = lambda t, d, g=guide: self._cross_force(t, g, d)
            found[f"{side} plate"] = lambda t, d, g=guide: self._meet_rigid(t, g)
            found[f"{side} kink"] = lambda t, d, g=guide: self._pass_kink(t, g, d)
        return found

    def _pass_kink(self, time: float, guide: Guide, direction: int) -> None:
        self._present.set(f"{guide.side}.sign", float(direction))
        self._body.reconsider(time)  # the slider's speed has jumped, and its damper's force

    def settle(self, time: float) -> None:
        """Decide every contact afresh, ties included."""
        for guide in self._guides:
            if guide.kind == "restitution":
                self._settle_rigid(time, guide)
            elif guide.kind == "compliant":
                self._settle_compliant(time, guide)

    # -- compliant -------------------------------------------------------------------------------------

    def _cross_plate(self, time: float, guide: Guide, direction: int) -> None:
        self._state[self._place[guide.side]] = direction * _DEPTH_NUDGE
        self._turn(time, guide, "closed" if direction > 0 else "open")
        if guide.plate_damping > 0.0:  # the force has jumped
            self._body.reconsider(time)
        self._check(time)

    def _cross_force(self, time: float, guide: Guide, direction: int) -> None:
        self._present.set(f"{guide.side}.offset", direction * _FORCE_NUDGE - self._present.push(time, guide))
        self._turn(time, guide, "closed" if direction > 0 else "released")

    def feel_shock(self, time: float, parted: frozenset[str]) -> None:
        """A landing or a blow has changed the masses' speeds: those of the guides `parted` rest no longer, and with the
        dampers' forces a plate without tension may let go or press anew."""
        for guide in self._guides:
            if guide.side in parted:
                self._part(time, guide.side)
                self._state[self._place[guide.side]] = -_DEPTH_NUDGE
        for guide in self._guides:
            if guide.side in parted:
                approach = float(self._state[self._place[guide.side] + 1])
                if approach > 0.0:
                    self._strike(time, guide, approach)
                else:
                    self._fly(time, guide, -approach)
        for guide in self._guides:
            if guide.watches_force and self.contact[guide.side] != "open":
                self._present.set(f"{guide.side}.offset", 0.0)
                self._turn(time, guide, "closed" if self._present.push(time, guide) >= 0.0 else "released")

    def _turn(self, time: float, guide: Guide, contact: str) -> None:
        present, side, old = self._present, guide.side, self.contact[guide.side]
        self.contact[side] = contact
        acts = contact == "closed"
        present.set(f"{side}.spring", guide.plate_stiffness if acts else 0.0)
        if guide.plate_damping > 0.0:
            present.set(f"{side}.damper", guide.plate_damping if acts else 0.0)
            present.set(f"{side}.watch", 0.0 if contact == "open" else 1.0)
            if "released" not in (contact, old):
                present.set(f"{side}.offset", 0.0)
        if acts and old != "closed":
            present.begin_contact(time, side, self._state[self._place[side] + 1])
        elif old == "closed" and not acts:
            present.end_contact(time, side)

    def _check(self, time: float) -> None:
        """Notice the other plate when it is crossed in the same instant."""
        for guide in self._compliant:
            depth = self._state[self._place[guide.side]]
            wrong = depth > 0.0 if self.contact[guide.side] == "open" else depth < 0.0
            if wrong and abs(depth) > 1e-13:
                raise RuntimeError(f"heyoka missed the {guide.side} plate by {depth:g} m before {time:.17g} s")
            if wrong:
                self._cross_plate(time, guide, 1 if depth > 0.0 else -1)

    def _settle_compliant(self, time: float, guide: Guide) -> None:
        at = self._place[guide.side]
        if self._state[at] != 0.0:
            sign = 1 if self._state[at] > 0.0 else -1
        else:
            sign = self._series.depth(time, guide)
            self._state[at] = (sign or -1) * _DEPTH_NUDGE
        if sign <= 0:
            self._turn(time, guide, "open")
        else:
            pulls = guide.watches_force and self._series.push(time, guide) < 0
            self._turn(time, guide, "released" if pulls else "closed")

    # -- rigid -----------------------------------------------------------------------------------------

    def _meet_rigid(self, time: float, guide: Guide) -> None:
        """A blow, or the end of a rest."""
        at, side = self._place[guide.side], guide.side
        self._state[at] = -_DEPTH_NUDGE
        if self.contact[side] == "resting":
            self._part(time, side)
        else:
            self._strike(time, guide, float(self._state[at + 1]))
        self._body.reconsider(time)

    def _strike(self, time: float, guide: Guide, approach: float) -> None:
        """Rest after a slow approach; else a blow, which a mass ends at rest if heyoka could not find its return."""
        if approach <= _REST_SPEED and self._present.support(time, guide) >= 0.0:
            self._rest(time, guide, approach, -approach)
            return
        rebound = guide.restitution * approach
        self._present.begin_contact(time, guide.side, approach)
        self._present.end_contact(time, guide.side)
        self._state[self._place[guide.side] + 1] = -rebound
        self._body.feel_blow(time, guide, -rebound - approach)
        self._fly(time, guide, rebound)

    def _fly(self, time: float, guide: Guide, rebound: float) -> None:
        """Leave the plate with `rebound` [m/s]; a low flight may be over before heyoka can find its end."""
        if rebound > _FAST:
            return
        self._body.reconsider(time)
        pull = self._present.support(time, guide) / guide.mass
        if pull > 0.0:
            flight = 2.0 * rebound / pull
            if rebound**2 <= 2.0 * pull * _LEAST_RISE:
                self._rest(time + flight, guide, rebound, rebound)
            else:
                self._present.expect(flight)

    def _rest(self, time: float, guide: Guide, approach: float, change: float) -> None:
        """Rest after an arrival with `approach` [m/s]; the mass's speed jumps, or has in a bounce, by `change`."""
        at, side = self._place[guide.side], guide.side
        self._present.begin_contact(time, side, approach)
        self.contact[side] = "resting"
        self._state[at] = self._state[at + 1] = 0.0
        self._present.set(f"{side}.free", 0.0)
        self._body.feel_last_blow(time, guide, change)
        self._body.feel_rest(side, True)

    def _part(self, time: float, side: str) -> None:
        """Let a mass fly that may rest on its rigid plate."""
        if self.contact[side] == "resting":
            self._present.end_contact(time, side)
        self.contact[side] = "open"
        self._present.set(f"{side}.free", 1.0)
        self._body.feel_rest(side, False)

    def release(self, time: float) -> None:
        """Part the masses that nothing presses on their rigid plates any more, because a force has jumped."""
        for guide in self._guides:
            if self.contact[guide.side] == "resting" and self._present.support(time, guide) < 0.0:
                self._part(time, guide.side)
                self._state[self._place[guide.side]] = -_DEPTH_NUDGE
                self._body.reconsider(time)

    def _settle_rigid(self, time: float, guide: Guide) -> None:
        at, side = self._place[guide.side], guide.side
        approach = float(self._state[at + 1])
        if self.contact[side] == "resting" and approach == 0.0:
            return  # the guard of its force watches it
        self._part(time, side)
        if self._state[at] < 0.0:
            return
        if approach > 0.0 or (approach == 0.0 and self._series.depth(time, guide) > 0):
            self._strike(time, guide, approach)
        if self.contact[side] == "open":
            self._state[at] = -_DEPTH_NUDGE
