"""Disturbances of a motion: a push, a stalled motor, a stuck plate, a supply sag, and a patch of other friction.

They are one table of numbers, which a checkpoint contains. Each row ends at an instant of its own. The rows of a
stalled motor and of a stuck plate store the commands that arrive meanwhile. A push, a sag, a patch and a stalled dc
motor change the equations: `Disturbances.equations` returns the arguments with which to compile them.
"""

import math
from collections.abc import Sequence

import numpy as np

from vibro_ros.model.faults import DURATION, FORCE
from vibro_ros.model.forms import NO_EDGES, Forms
from vibro_ros.model.parameters import AS_FORWARD
from vibro_ros.model.scene import Scene

PUSH, STALL, STUCK, SAG, PATCH = "push", "motor_stall", "plate_stuck", "supply_sag", "friction_patch"
#: The disturbances by row: name, and the side of a stuck plate.
ROWS = ((PUSH, ""), (STALL, ""), (STUCK, "upper"), (STUCK, "inclined"), (SAG, ""), (PATCH, ""))
#: Parameters of a seized bearing [N m], which stops the crank in less than a microsecond.
SEIZED = {"motor.friction": 1e4, "motor.static_friction": 1e4}


class Disturbances:
    """The disturbances of `ROWS` that are active now.

    `table`, shape (6, 5), has for each row the instant at which it ends [s], or 0 if it is not active; then its
    numbers, filled up with 0: the force along x and upwards [N]; the command to the motor, or to a plate [rad/s, m];
    the supply's voltage [V]; a patch's friction coefficient, its ends [m], and -1, 0 or 1 while the body is before it,
    on it or behind it. `next_end` is the instant at which the first disturbance ends [s]; infinite if none is active.
    """

    def __init__(self) -> None:
        self.table, self.next_end = np.zeros((len(ROWS), 5)), math.inf

    def row(self, name: str, of: str = "") -> np.ndarray:
        """Return the row of a disturbance, to be read or written, shape (5,)."""
        return self.table[ROWS.index((name, of))]

    def write(self, name: str, of: str, until: float, numbers: Sequence[float]) -> None:
        """Activate a disturbance until the instant `until` [s], with new `numbers`; 0 ends it."""
        row = self.row(name, of)
        row[...] = 0.0
        if until:
            row[:1 + len(numbers)] = until, *numbers
        self.look_for_next_end()

    def look_for_next_end(self) -> None:
        """Set `next_end` from the table."""
        self.next_end = min(self.lasting().values(), default=math.inf)

    def lasting(self) -> dict[tuple[str, str], float]:
        """Return the instants [s] at which the active disturbances end, by name and side."""
        return {which: until for which, until in zip(ROWS, self.table[:, 0].tolist(), strict=True) if until}

    def stored_command(self, name: str, of: str = "") -> float | None:
        """Return the last command to a stalled motor or a stuck plate [rad/s, m]; None if it is not disturbed."""
        until, command, *_ = self.row(name, of).tolist()
        return command if until else None

    def equations(self, scene: Scene) -> tuple[Scene, tuple[float, float], tuple[float, float]]:
        """Return the arguments of `compile_scene`: the scene with its faults, the push, and the edges of the ground."""
        until, friction, low, high, location = self.row(PATCH).tolist()
        edges = NO_EDGES
        if until:
            edges = {-1.0: (-math.inf, low), 0.0: (low, high), 1.0: (high, math.inf)}[location]
            scene = patched(scene, friction) if location == 0.0 else scene
        _, along_x, upwards, *_ = self.row(PUSH).tolist()
        return self._with_failing_motor(scene).machine, (along_x, upwards), edges

    def _with_failing_motor(self, scene: Scene) -> Scene:
        """Return the scene with the faults of a dc motor: a seized bearing, or less supply voltage."""
        if not scene.has_rotor:
            return scene
        changes = dict(SEIZED) if self.row(STALL)[0] else {}
        supply = self.supply_voltage_of(scene)
        if supply != scene["motor.supply_voltage"]:  # motor.voltage enters no equation, but could exceed the supply's
            changes |= {"motor.supply_voltage": supply, "motor.voltage": 0.0}
        return scene.with_parameters(changes)

    def supply_voltage_of(self, scene: Scene) -> float:
        """Return the supply's voltage [V]: the scene's, or less during a sag."""
        until, sagged, *_ = self.row(SAG).tolist()
        return min(sagged, scene["motor.supply_voltage"]) if until else scene["motor.supply_voltage"]

    def locate_on_patch(self, position: float) -> None:
        """Store whether a body at `position` [m] is before, on or behind a patch; the edges belong to the patch."""
        patch = self.row(PATCH)
        patch[4] = float(position > patch[3]) - float(position < patch[2])

    def are_possible(self, scene: Scene, forms: Forms, now: float) -> bool:
        """Whether these disturbances of `scene` can be compiled and are active at `now` [s]."""
        _, along_x, upwards, *_ = self.row(PUSH).tolist()
        until_patch_ends, friction, _, _, location = self.row(PATCH).tolist()
        if until_patch_ends:
            try:
                patched(scene, friction)
            except ValueError:
                return False
        return (all(until == 0.0 and not any(numbers) or now < until <= now + DURATION.maximum
                    for until, *numbers in self.table.tolist())
                and abs(along_x) <= FORCE.maximum * forms.body_moves and abs(upwards) <= FORCE.maximum * forms.body_hops
                and location in (-1.0, 0.0, 1.0))


def patched(scene: Scene, friction: float) -> Scene:
    """Return the scene with another friction coefficient, which is the same at rest and in both directions.

    ValueError for a scene without friction on a moving body, a method that does not find edges, or a refused
    coefficient.
    """
    if not scene.body_moves or scene["effects.friction"] == "none":
        raise ValueError("fault: friction_patch needs friction on a body that moves, and this scene has none; leave it "
                         "out, or choose coulomb for effects.friction")
    if scene["solver.method"] != "exact":
        raise ValueError(f"fault: friction_patch has edges that solver.method {scene['solver.method']} does not find; "
                         "choose exact")
    try:
        return scene.with_parameters({"ground.friction": friction, "ground.static_friction": friction,
                                      "ground.friction_backward": AS_FORWARD})
    except ValueError as error:
        raise ValueError(f"value: as on a patch, {error}") from None
