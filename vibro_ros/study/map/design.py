"""What a map is made of: a scene, a grid over motor speed and gap, and the lines along which the grid is swept."""

from collections.abc import Iterator
from dataclasses import dataclass

from vibro_ros.configuration.command_map import Axis, parameters_that_count
from vibro_ros.model.scene import Scene

SPEED, GAP = "motor_speed", "gap"


@dataclass(frozen=True)
class Line:
    """A row or a column of the grid, swept from one end to the other.

    Attributes
    ----------
    along : str
        `SPEED` or `GAP`: what changes.
    place : int
        Index of what stays.
    upwards : bool
        Whether the smallest value comes first.
    """

    along: str
    place: int
    upwards: bool

    @property
    def name(self) -> str:
        """Of the line's file."""
        return f"{self.along}_{'up' if self.upwards else 'down'}_{self.place:04d}"


@dataclass(frozen=True)
class MapDesign:
    """A map to be made.

    Attributes
    ----------
    scene : Scene
        The machine; its own motor speed, gaps of `sides` and start do not count.
    sides : tuple of str
        Sides whose gaps are varied, both alike if there are two.
    speeds, gaps : Axis
        Motor speeds [rad/s] and gaps [m].
    """

    scene: Scene
    sides: tuple[str, ...]
    speeds: Axis
    gaps: Axis

    def scene_at(self, speed_index: int, gap_index: int) -> Scene:
        """The machine in a cell (ValueError where the scene refuses the values)."""
        return self.scene_with(float(self.speeds.values[speed_index]), float(self.gaps.values[gap_index]))

    def scene_with(self, motor_speed: float, gap: float) -> Scene:
        """The machine at a motor speed [rad/s] and a gap [m] (ValueError where the scene refuses the values)."""
        return self.scene.with_parameters({"motor.speed": motor_speed, **{f"{side}.gap": gap for side in self.sides}})

    def check(self) -> None:
        """Refuse a grid with values that the scene refuses (ValueError)."""
        for index in range(self.speeds.count):
            self.scene_at(index, 0)
        for index in range(self.gaps.count):
            self.scene_at(0, index)

    def lines(self) -> list[Line]:
        """All rows and columns, each in both directions."""
        return [Line(along, place, upwards) for along, other in ((SPEED, self.gaps), (GAP, self.speeds))
                for place in range(other.count) for upwards in (True, False)]

    def cells(self, line: Line) -> Iterator[tuple[int, int]]:
        """Speed and gap index of each cell of a line, in its direction."""
        axis = self.speeds if line.along == SPEED else self.gaps
        for index in range(axis.count) if line.upwards else reversed(range(axis.count)):
            yield (index, line.place) if line.along == SPEED else (line.place, index)

    def document(self) -> dict[str, object]:
        """All that the motions depend on, for the record."""
        solver = {name: value for name, value in self.scene.parameters.items() if name.startswith("solver.")}
        return {"parameters": parameters_that_count(self.scene, self.sides), "solver": solver, "gaps": list(self.sides),
                **{name: [axis.low, axis.high, axis.count]
                   for name, axis in ((SPEED, self.speeds), (GAP, self.gaps))}}
