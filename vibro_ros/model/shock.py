"""Shocks: impulses that take no time, in which springs, dampers, weights and other finite forces do nothing.

A mass is *free* in a shock if the mass feels the body move (the reaction) and nothing strikes the mass. In space a free
mass keeps its speed along e, the direction of its guide; along the guide its speed changes by -e . dV while the body's
velocity changes by dV = (dx', dy'). The rows x and y then leave the body with the inertia

    A = M 1 - sum m e e^T        over the free masses; M 1 without the reaction.

A blow on the rigid plate of guide i changes the mass's speed along the guide from the approach a to -eps a against the
plate (eps the restitution). The blow's impulse on the mass, and the opposite impulse on the body, make

    A dV = m e (1 + eps) a        where nothing holds the body.

A body on the ground gets this change along x alone, M_xx dx' = m e_x (1 + eps) a, if the blow is too slow to count, or
by a rule that keeps the body on the ground. Otherwise dy' >= 0 while no guide points down: the ground, which cannot
pull, gives no impulse and no friction, and the body lifts off.

A landing is a shock with friction: the ground gives the body the impulse (P_x, P_y) that ends the fall, so
that y' is 0 afterwards. The elements of A are M_xx, M_xy and M_yy,

    P_x = M_xx dx' + M_xy dy'        P_y = M_xy dx' + M_yy dy'

While the body slips, P_x = -sigma mu P_y with sigma = sign(x'), so that

    dx' = -c dy',    c(sigma) = (M_xy + sigma mu M_yy) / (M_xx + sigma mu M_xy)

(Routh's law: friction opposes the speed that the body has, at every instant of the shock.) A body whose speed along the
ground vanishes before the fall has ended sticks if abs(M_xy) <= mu_s M_yy; otherwise the body slips the other way for
the rest of the shock.

With a restitution e of the ground (Poisson's law, in E. J. Routh's two phases), P_y grows after the fall has ended by e
times what it was then, under the same friction, and the body is in the air again. A landing slower than `REST_SPEED` is
the last.

In a landing, a mass that rests on a rigid plate and feels the body move leaves the plate: the mass goes on falling or,
where friction throws the body against the mass, strikes the plate at once. If the fall is slower than `REST_SPEED`, the
mass stays at rest and lands with the body as one, because otherwise hops and bounces that belong together would follow
each other without end.

The crank of a dc motor feels the body through masses of the linkage. A shock changes the crank's speed by -c . dV / J,
where c is the momentum of these masses per unit of the crank's speed, and J the crank's inertia including them. Then A
is smaller by c c^T / J. By Stribeck's law mu falls with the speed, also during a landing. Neither law is a linear form:
`solver.shock` evaluates both from the numbers of a `NonlinearShock`.
"""

import itertools
import math
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from vibro_ros.model.forms import Form, Forms, Target, cached, solve
from vibro_ros.model.scene import Scene
from vibro_ros.solver.system import NOTHING, SHOCK

#: A mass that approaches more slowly [m/s] rests on its plate: the bounces that are left out last about 1e-11 s. A
#: faster mass strikes a blow even if its restitution is 0, because the blow moves the body, and rests afterwards.
REST_SPEED = 1e-9
#: Channels of positions and velocities, each with the form of the value after the shock, shape (channels,).
Jumps = tuple[tuple[int, Form], ...]


class NonlinearShock(NamedTuple):
    """A shock in which the crank's angle or the body's speed decides the inertia or the friction."""

    numbers: np.ndarray  # shape (1,): the shock as a record for the solver
    # shape (dynamic, 2): directions of the masses that are free in the shock, 0 for the other coordinates
    direction: np.ndarray
    speeds: tuple[int, ...]  # channels of the velocities that jump

    def targets(self, forms: Forms, states: Iterable[str], **changes: Any) -> list[Target]:
        """Return the shock's targets: each of the `states` of the guard's effect with each state of the bearing."""
        return [Target(state, bearing=bearing, shock=self, **changes)
                for state in states for bearing in forms.bearings_after_shock]


class BodyShock:
    """A change of the body's velocity, and the changes of the free masses' speeds that it brings.

    `not_free` are guides whose masses move with the body or are struck themselves. `inertia` is A [kg], for x and y.
    """

    def __init__(self, scene: Scene, forms: Forms, not_free: Iterable[str] = ()):
        self._forms = forms
        self._free = [side for side in forms.guides if scene["effects.reaction"] and side not in not_free]
        self._scene = scene
        inertia = [[scene.total_mass, 0.0], [0.0, scene.total_mass]]
        for side in self._free:
            mass, direction = scene[f"mass.{side}"], scene.direction(side)
            for i, j in itertools.product(range(2), repeat=2):
                inertia[i][j] -= mass * direction[j] * direction[i]
        self.inertia = inertia

    def free_mass_jumps(self, change: tuple[Form, Form]) -> Jumps:
        """Jumps of the free masses' speeds along their guides, for a `change` of the body's x' and y' [m/s]."""
        forms = self._forms
        guides = ((side, forms.guides.index(side)) for side in self._free)
        return tuple((forms.channels.velocity(i), forms.velocity(i) - forms.along(side, change)) for side, i in guides)

    def nonlinear(self, states: int, restitution: float, struck: str = "", lifts: bool = True) -> NonlinearShock:
        """Return the same shock with a crank that is struck, or with friction that changes with the speed.

        `states` counts the states of the body on the ground between which the shock decides, as `solver.system.SHOCK`
        has them. `restitution` is that of the plate or of the ground. `struck` is the guide whose mass strikes its
        plate, empty for a landing. `lifts` says whether the body lifts off in a blow.
        """
        scene, forms = self._scene, self._forms
        has_friction = scene.has_dry_friction and forms.body_moves
        kinetic, static = (scene.kinetic_frictions, scene.resting_frictions) if has_friction else ((0.0, 0.0),) * 2
        mass = forms.guides.index(struck) if struck else NOTHING
        body, height = forms.body if forms.body_moves else NOTHING, forms.height if forms.body_hops else NOTHING
        numbers = np.zeros(1, SHOCK)  # the bytes between the fields are 0 too, so that equal shocks have equal bytes
        numbers[0] = (
            mass, forms.plates.index(struck) if struck else NOTHING,
            scene[f"mass.{struck}"] * np.array(scene.direction(struck)) if struck else (0.0, 0.0),
            lifts, restitution, body, height, self.inertia[0][0], self.inertia[0][1], self.inertia[1][1],
            scene.motor_inertia if forms.has_rotor else math.inf, kinetic, static,
            scene["ground.stribeck_speed"] if forms.friction_decays else 0.0,
            has_friction, len(forms.bearings_after_shock) > 1, states)
        direction = np.zeros((forms.channels.dynamic, 2))
        for side in self._free:
            direction[forms.guides.index(side)] = scene.direction(side)
        moved = [mass, body, height if lifts else NOTHING, *map(forms.guides.index, self._free)]
        moved += [forms.phase] if forms.crank_is_struck else []
        return NonlinearShock(numbers, direction, tuple(forms.channels.velocity(i) for i in moved if i != NOTHING))


class Blow:
    """A blow of a mass on its rigid plate: the jumps of the mass, and those of the body on the ground or thrown up.

    `side` is the guide.
    """

    def __init__(self, scene: Scene, forms: Forms, side: str):
        self._cache: dict[tuple, Any] = {}
        self._scene, self._forms, self._side = scene, forms, side

    @cached
    def mass_jumps(self, restitution: float) -> Jumps:
        """Jumps of the mass that strikes, which is put exactly on its plate."""
        forms, i = self._forms, self._forms.guides.index(self._side)
        plate, _ = forms.plate(self._side)
        return ((forms.channels.position(i), plate),
                (forms.channels.velocity(i), forms.velocity(i) - self._speed_change(restitution)))

    @cached
    def sliding_body_jumps(self, restitution: float) -> Jumps:
        """Jump of x' of a body that stays on the ground: M x' - m3 w' sin(phi) does not change."""
        forms = self._forms
        along_x, _ = self._scene.direction(self._side)
        if not self.moves_sliding_body():
            return ()
        share = self._scene[f"mass.{self._side}"] * along_x / self._scene.total_mass
        return ((forms.channels.velocity(forms.body),
                 forms.velocity(forms.body) + share * self._speed_change(restitution)),)

    @cached
    def thrown_body_jumps(self, restitution: float, resting: frozenset[str] = frozenset()) -> Jumps:
        """Jumps of a body that nothing holds and of the free masses; the masses of `resting` move with the body."""
        forms, shock = self._forms, BodyShock(self._scene, self._forms, (self._side, *resting))
        impulse = self._scene[f"mass.{self._side}"] * np.array(self._scene.direction(self._side))
        by_unit = solve(np.array([shock.inertia]), impulse[None, :, None]).ravel()  # change of x' and y'
        along_x, upwards = (part * self._speed_change(restitution) for part in by_unit)
        speed, rise = forms.body_velocity()
        body: Jumps = ((forms.channels.velocity(forms.height), rise + upwards),)
        if forms.body_moves:
            body += ((forms.channels.velocity(forms.body), speed + along_x),)
        return body + shock.free_mass_jumps((along_x, upwards))

    def moves_sliding_body(self) -> bool:
        """Whether the blow changes x' of a body that stays on the ground."""
        return self._forms.body_moves and self._scene.direction(self._side)[0] != 0.0

    @cached
    def of_struck_crank(self, restitution: float, lifts: bool, states: int,
                        resting: frozenset[str]) -> NonlinearShock:
        """Return the blow with a crank that is struck; the body lifts off or, without `lifts`, stays on the ground."""
        shock = BodyShock(self._scene, self._forms, (self._side, *resting))
        return shock.nonlinear(states, restitution, self._side, lifts)

    def _speed_change(self, restitution: float) -> Form:
        """Decrease of the mass's speed in the blow, (1 + eps) a [m/s]."""
        return (1.0 + restitution) * self._forms.penetration(self._side)[1]


class Landing:
    """The targets of a landing, each with its jumps.

    `kinetic` and `static` are the friction coefficients, forwards and backwards, while the body slips and while it
    sticks. The masses of `resting` stay on their rigid plates. `restitution` is the impulse while the ground rebounds
    over that while it is compressed; 0 for an inelastic landing.
    """

    def __init__(self, scene: Scene, forms: Forms, kinetic: tuple[float, float], static: tuple[float, float],
                 resting: frozenset[str] = frozenset(), restitution: float = 0.0):
        self._forms, self._restitution = forms, restitution
        self._shock = BodyShock(scene, forms, resting)
        (along, across), (_, up) = self._shock.inertia
        self._forwards, self._backwards = ((across + sign * friction * up) / (along + sign * friction * across)
                                           for sign, friction in zip((1.0, -1.0), kinetic, strict=True))
        self._sticks = -static[0] * up <= across <= static[1] * up
        self._across, self._up = across, up

    def targets_without_friction(self, state: str) -> tuple[Target, ...]:
        """Return the only target without friction, `state`."""
        speed, fall = self._forms.body_velocity()
        return (Target(state, self._jumps(speed + self._forwards * fall)),)

    def targets_with_friction(self) -> tuple[Target, ...]:
        """Return the targets in the order to try: the body slips on as before, or has stopped during the shock."""
        forms = self._forms
        speed, fall = forms.body_velocity()
        forwards, backwards = speed + self._forwards * fall, speed + self._backwards * fall
        if self._sticks:
            after_a_stop = Target("stick", self._jumps(forms.zero))
        elif self._backwards > 0.0:  # friction is too weak: the body slips back after speed / c of the fall has ended
            after_a_stop = Target("slip_backward", self._jumps(self._backwards * (speed / self._forwards + fall)))
        else:
            after_a_stop = Target("slip_forward", self._jumps(self._forwards * (speed / self._backwards + fall)))
        # A shock that drives the body on never stops it. Then the speed before the shock decides, else the speed after.
        entries = forwards if self._forwards >= 0.0 else speed, backwards if self._backwards <= 0.0 else speed
        return (Target("slip_forward", self._jumps(forwards), entries=(entries[0],)),
                Target("slip_backward", self._jumps(backwards), entries=(-entries[1],)),
                after_a_stop)

    def bounces(self, has_friction: bool) -> Iterator[Target]:
        """Yield the targets of a landing after which the body is in the air again, in the order to try."""
        forms, share = self._forms, self._restitution
        speed, fall = forms.body_velocity()
        whole = (1.0 + share) * fall  # the change of y' if the body slips in one direction throughout
        if not has_friction:
            yield Target("airborne", self._jumps(speed + self._forwards * whole, -share * fall))
            return
        slips = self._forwards, self._backwards
        for sign, slip in zip((1.0, -1.0), slips, strict=True):
            after = speed + slip * whole
            entry = after if sign * slip >= 0.0 else speed  # a shock that drives the body on never stops it
            yield Target("airborne", self._jumps(after, -share * fall), entries=(sign * entry,))
        # The body stops when y' has changed by `until`, and sticks or slips the other way. P_y = (M_yy - c M_xy) dy'.
        later_slip = 0.0 if self._sticks else self._backwards if self._backwards > 0.0 else self._forwards
        for sign, slip in zip((1.0, -1.0), slips, strict=True):
            if sign * slip > 0.0:
                until, ratio = speed / slip, (self._up - slip * self._across) / (self._up - later_slip * self._across)
                left = -fall - until  # compression to come, below 0 if the ground already rebounds
                for rise, entries in ((share * (ratio * until + left), (left,)),
                                      (ratio * (left - share * fall) - left, ())):
                    yield Target("airborne", self._jumps(-later_slip * (left + rise), rise),
                                 entries=(sign * speed, *entries))

    def _jumps(self, speed_after: Form, rise_after: Form | None = None) -> Jumps:
        """Jumps of a landing that leaves the body with these speeds [m/s] along the ground and upwards, 0 if None."""
        forms, at = self._forms, self._forms.channels
        speed, fall = forms.body_velocity()
        rise = forms.zero if rise_after is None else rise_after
        jumps = [(at.position(forms.height), forms.zero), (at.velocity(forms.height), rise)]
        if forms.body_moves:
            jumps.append((at.velocity(forms.body), speed_after))
        return (*jumps, *self._shock.free_mass_jumps((speed_after - speed, rise - fall)))
