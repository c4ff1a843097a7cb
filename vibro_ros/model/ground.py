"""The ground: its forces on the body, and the states of the body on it and above it.

Dry friction and the normal force depend on the state of the body, a row of `GROUND_STATES`. Every other force of the
ground is a row of `parameter_values.GROUND_FORCES`, F = F0 + c x' + k x against forward motion.

Coulomb's law is eq. (5). The law `static` holds a body at rest with the coefficient mu_s instead of mu. By Stribeck's
law the coefficient falls from mu_s to mu as the speed rises,

    mu(v) = mu + (mu_s - mu) exp(-|v| / v_s).

This form is A. Tustin's, J. IEE 94 (1947), and the general form with exponent 1 (B. Armstrong-Hélouvry, P. Dupont and
C. Canudas de Wit, Automatica 30 (1994), 1083-1138).
"""

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from vibro_ros.model.forms import NO_EDGES, Form, Forms, Guard, StanceForms, Target, without_jump
from vibro_ros.model.scene import Scene
from vibro_ros.model.shock import REST_SPEED, BodyShock, Landing


class GroundState(NamedTuple):
    """A state of the body on the ground."""

    friction: float | None  # F_fr as a multiple of mu(v) N; None where F_fr balances the other forces along the ground
    # kinds of the events that are recorded when the state begins, or ends; empty for none
    begins: str
    ends: str = ""


GROUND_STATES = {
    "stick": GroundState(None, "stick"),
    "slip_forward": GroundState(1.0, "slip_forward"),
    "slip_backward": GroundState(-1.0, "slip_backward"),
    "unloaded": GroundState(0.0, "unloaded", "loaded"),
    "rest": GroundState(None, ""),
    "airborne": GroundState(0.0, "lift_off", "landing"),
    "grounded": GroundState(0.0, ""),
}
"""The states of the body.

`stick`: x' = 0 while the forces along the ground, F_in without others, are at most mu_s N.
`slip_forward`, `slip_backward`: F_fr = mu(v) N sign(x').
`unloaded` (rule `unilateral`): N < 0, so that there is no friction and x' = 0 is no event.
`rest` (rule `printed`): N < 0 and x' = 0. There eq. (5) starts the body in the direction of F_in, and leaves the body
at rest while F_in is exactly zero.
`airborne` (rule `hop`): N = 0 and y > 0, from lift-off to landing.
`grounded`: the body is on the ground, without dry friction or without a force along the ground.
"""
#: States of the body while N is negative, by the rule of the normal force.
WITHOUT_LOAD = {"weight": (), "unilateral": ("unloaded",), "printed": ("rest",), "hop": ("airborne",)}


class Ground:
    """The forces, states and guards of one scene's ground.

    `edges` are the positions of the body [m] between which the ground reaches; see `compile_scene`.
    """

    def __init__(self, scene: Scene, forms: Forms, edges: tuple[float, float] = NO_EDGES):
        self._scene = scene
        self._forms, self._edges = forms, edges
        self._kinetic, self._static = scene.kinetic_frictions, scene.resting_frictions
        self._rule, self._restitution = scene["effects.normal_force"], scene["ground.restitution"]
        # whether friction can hold the body
        self.has_dry_friction = scene.has_dry_friction and forms.body_moves
        # the forces along the ground that the scene has, except dry friction, F0 + c x' + k x [N]
        self.forces = {force: constant * forms.one + damping * forms.velocity(forms.body)
                       + stiffness * forms.position(forms.body)
                       for force, (constant, damping, stiffness) in scene.ground_laws.items()}
        self.driving_symbol = " - ".join(["F_in", *(force.symbol for force in self.forces)])
        without_load = WITHOUT_LOAD[self._rule] if self._rule != "hop" or forms.body_hops else ()
        if self.has_dry_friction:
            self.states = ("stick", "slip_forward", "slip_backward", *without_load)
        else:
            self.states = ("grounded", *(("airborne",) if forms.body_hops else ()))

    def friction_force(self, multiple: np.ndarray, normal: StanceForms, inertial: StanceForms) -> StanceForms:
        """F_fr [N], positive when F_fr opposes forward motion, from N on the ground and F_in.

        `multiple`, shape (stances, 1), is `GroundState.friction` in every stance, and NaN for None.
        """
        kinetic, static = (np.where(multiple < 0.0, backward, forward)
                           for forward, backward in (self._kinetic, self._static))
        force = kinetic * normal
        if self._forms.friction_decays:
            force = force + (static - kinetic) * self._forms.decayed_normal_force()
        return np.where(np.isnan(multiple), self.driving_force(inertial), multiple * force)

    def driving_force(self, inertial: Form | StanceForms) -> Form | StanceForms:
        """F_in less every force along the ground except dry friction [N]."""
        return inertial - sum(self.forces.values())

    def decay_rate(self, state: str) -> float:
        """Rate [s/m] at which ln(exp(-abs(x') / v_s)) changes with x' in `state`; 0 where no friction decays."""
        if not self._forms.friction_decays:
            return 0.0
        return -(GROUND_STATES[state].friction or 0.0) / self._scene["ground.stribeck_speed"]

    @staticmethod
    def context(state: str, resting: frozenset[str], closed: frozenset[str]) -> tuple:
        """Return the states of other effects on which the guards of `state` depend.

        A landing depends on the masses at rest alone. Every other guard depends on the plates in contact that change
        the forms of N and F_in, `closed`.
        """
        return (resting,) if state == "airborne" else (closed,)

    def guards(self, state: str, normal: Form, inertial: Form, resting: frozenset[str] = frozenset()) -> list[Guard]:
        """Guards of `state`, from the forms of N and F_in and the guides whose masses rest on rigid plates."""
        return [*self._force_guards(state, normal, inertial, resting), *self._edge_guards(state)]

    def _edge_guards(self, state: str) -> list[Guard]:
        """Guards of the edges towards which the body may move; past an edge the run continues with another system."""
        (low, high), unit = self._edges, self._forms.one
        position = self._forms.position(self._forms.body) if self._forms.body_moves else self._forms.zero
        at_rest = GROUND_STATES[state].friction is None
        ahead = [Guard(high * unit - position, (), f"x <= {high:g} m")] if high < math.inf else []
        behind = [Guard(position - low * unit, (), f"x >= {low:g} m")] if low > -math.inf else []
        return ahead * (not at_rest and state != "slip_backward") + behind * (not at_rest and state != "slip_forward")

    def _force_guards(self, state: str, normal: Form, inertial: Form, resting: frozenset[str]) -> list[Guard]:
        """Guards of `state` except those of the ground's edges."""
        if state == "airborne":
            height = self._forms.position(self._forms.height)
            return [Guard(height, tuple(self._landings(resting)), "y >= 0", entries_decide=True,
                          event="landing")]
        driving = self.driving_force(inertial)
        symbol = f"({self.driving_symbol})" if self.forces else self.driving_symbol
        if state == "stick":
            forward, backward = self._static
            return self._normal_force_guards(state, normal) + [
                Guard(forward * normal - driving, without_jump("slip_forward"), f"{symbol} <= {forward:g} N"),
                Guard(backward * normal + driving, without_jump("slip_backward"), f"-{symbol} <= {backward:g} N"),
            ]
        if state == "rest":
            return [Guard(-normal, without_jump("stick"), "N <= 0"),
                    Guard(-driving, without_jump("slip_forward"), f"{symbol} <= 0"),
                    Guard(driving, without_jump("slip_backward"), f"{symbol} >= 0")]
        if state == "unloaded":
            return [Guard(-normal, without_jump("slip_forward", "slip_backward", "stick"), "N <= 0")]
        if state == "grounded":
            return self._normal_force_guards(state, normal)
        body = self._forms.body
        velocity, stopped = self._forms.velocity(body), ((self._forms.channels.velocity(body), self._forms.zero),)
        sign, other, text = (1.0, "slip_backward", "x' >= 0") if state == "slip_forward" else (
            -1.0, "slip_forward", "x' <= 0")
        moving = Guard(sign * velocity, (Target("stick", stopped), Target(other, stopped)), text)
        return [moving, *self._normal_force_guards(state, normal)]

    def _normal_force_guards(self, state: str, normal: Form) -> list[Guard]:
        """Return the guard N >= 0 if the rule of the normal force ends `state` when N turns negative, else no guard.

        In `stick` this guard stands before the bounds of F_in, because N may fall below 0 at a blow. A body that
        slips instead has another N and may still be pressed on the ground, so that slipping is tried first.
        """
        if self._rule == "printed" and state != "stick":
            return []
        slipping = ("slip_forward", "slip_backward") if self._rule == "hop" and state == "stick" else ()
        targets = tuple(name for name in WITHOUT_LOAD[self._rule] if name in self.states)
        return [Guard(normal, without_jump(*slipping, *targets), "N >= 0")] if targets else []

    def _landings(self, resting: frozenset[str]) -> Iterator[Target]:
        """Yield the targets of a landing; after a slow one the body stays on the ground and resting masses at rest."""
        felt = resting if self._scene["effects.reaction"] else frozenset()
        bounces = list(self._bounces()) if self._restitution else []
        if not (felt or bounces):
            yield from self._inelastic_landing(frozenset())
            return
        _, rise = self._forms.body_velocity()
        slow = REST_SPEED * self._forms.one + rise
        for target in self._inelastic_landing(felt):
            yield target._replace(entries=(slow, *target.entries))
        for target in bounces or self._inelastic_landing(frozenset()):
            yield target._replace(frees_resting_masses=bool(felt))

    @property
    def _landing_is_nonlinear(self) -> bool:
        return self._forms.crank_is_struck or self._forms.friction_decays

    def _bounces(self) -> Iterable[Target]:
        """Targets of a landing after which the body is in the air again."""
        if self._landing_is_nonlinear:
            shock = BodyShock(self._scene, self._forms).nonlinear(1, self._restitution)
            return shock.targets(self._forms, ["airborne"])
        return self._landing(frozenset()).bounces(self.has_dry_friction)

    def _inelastic_landing(self, resting: frozenset[str]) -> Iterable[Target]:
        if self._landing_is_nonlinear:
            states = ["slip_forward", "slip_backward", "stick"] if self.has_dry_friction else ["grounded"]
            shock = BodyShock(self._scene, self._forms, resting).nonlinear(len(states), 0.0)
            return shock.targets(self._forms, states)
        landing = self._landing(resting)
        if not self.has_dry_friction:
            return landing.targets_without_friction("grounded")
        return landing.targets_with_friction()

    def _landing(self, resting: frozenset[str]) -> Landing:
        """A landing in which the masses of `resting` stay on their plates."""
        none = (0.0, 0.0)
        frictions = (self._kinetic, self._static) if self.has_dry_friction else (none, none)
        return Landing(self._scene, self._forms, *frictions, resting, self._restitution)
