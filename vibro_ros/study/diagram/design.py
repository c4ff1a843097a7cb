"""A diagram's design: which values are visited, in which order, and what is measured at each.

Visits are numbered: first all values upwards, then all downwards, so that each begins where the one before has ended.
"""

from dataclasses import dataclass

from vibro_ros.model.scene import Scene
from vibro_ros.orbits.chaos import LEAST_TURNS
from vibro_ros.orbits.chaos import LEAST_VALUES as LEAST_CUTS
from vibro_ros.orbits.chaos import MOST_TURNS as MOST_MEASURED
from vibro_ros.orbits.recurrence import FIRST_TURNS
from vibro_ros.orbits.turn_map import TurnMap, coordinates
from vibro_ros.study.variation import Axis, whole_number

UP, DOWN = "up", "down"
#: Most turns that a motion may be given to settle.
MOST_SETTLING = 1_000_000
_BLOCK = 8  # visits of a block: what an interruption can lose


@dataclass(frozen=True)
class Design:
    """A diagram, checked.

    Attributes
    ----------
    scene : Scene
        What is varied, and how it starts at the first value.
    axis : Axis
        The parameter and its values, ascending.
    phase : float
        Crank angle [rad] at which the states are seen.
    coordinate : str
        Of the state, which the picture shows and the 0-1 test hears.
    most_turns : int
        Turns of the crank that a motion has to settle.
    exponents, cuts : int
        Turns over which Lyapunov exponents are measured, and cuts that the 0-1 test hears; 0 for neither.

    Raises
    ------
    ValueError
        For what contradicts itself or is too much; one line that names the remedy.
    """

    scene: Scene
    axis: Axis
    phase: float
    coordinate: str
    most_turns: int
    exponents: int
    cuts: int

    def __post_init__(self) -> None:
        whole_number("--most-turns", self.most_turns, FIRST_TURNS, MOST_SETTLING)
        if self.exponents:
            whole_number("--exponents (0: none)", self.exponents, LEAST_TURNS, MOST_MEASURED)
        if self.cuts:
            whole_number("--cuts (0: none)", self.cuts, LEAST_CUTS, MOST_MEASURED)
        for value in self.axis.values:
            self._check(value)
        if self.coordinate not in self.names:
            raise ValueError(f"--coordinate {self.coordinate}: is none of the state; choose one of "
                             f"{', '.join(self.names)}")

    def _check(self, value: object) -> None:
        """Refuse a value without a turn map, or with other coordinates than the first."""
        try:
            scene = self.scene_at(value)
        except ValueError as error:
            raise ValueError(f"--vary {self.axis.name}: at {value:g} there is no scene ({error})") from error
        if scene["motor.speed"] == 0.0:
            raise ValueError("motor.speed: 0 rad/s turns no crank; give --set motor.speed=100, or vary it above 0")
        if coordinates(scene) != self.names:
            raise ValueError(f"--vary {self.axis.name}: at {value:g} the state has other coordinates than at "
                             f"{self.axis.values[0]:g}; leave that value out")

    @property
    def names(self) -> tuple[str, ...]:
        """The state's coordinates, fields of `Samples`."""
        return coordinates(self.scene_at(self.axis.values[0]))

    @property
    def visits(self) -> int:
        """Values, up and down."""
        return 2 * len(self.axis.values)

    @property
    def blocks(self) -> int:
        """Blocks."""
        return -(-self.visits // _BLOCK)

    def visits_of_block(self, block: int) -> range:
        """Numbers of the visits of a block."""
        return range(block * _BLOCK, min((block + 1) * _BLOCK, self.visits))

    def direction(self, visit: int) -> str:
        """`UP` or `DOWN`."""
        return UP if visit < len(self.axis.values) else DOWN

    def place(self, visit: int) -> int:
        """Place of the visited value among the values."""
        return min(visit, self.visits - 1 - visit)

    def value(self, visit: int) -> float:
        """The visited value, in the parameter's unit."""
        return float(self.axis.values[self.place(visit)])

    def scene_at(self, value: object) -> Scene:
        """The scene at a value (ValueError where it is none)."""
        return self.scene.with_parameters({self.axis.name: value})

    def map_of(self, visit: int) -> TurnMap:
        """The turn map at a visit."""
        return TurnMap(self.scene_at(self.value(visit)), self.phase)

    def document(self) -> dict[str, object]:
        """All that decides what is found, as JSON has it."""
        fixed = {name: value for name, value in self.scene.parameters.items() if name != self.axis.name}
        return {"scene": self.scene.name, "set": fixed, "vary": {self.axis.name: self.axis.document()},
                "phase": self.phase, "coordinate": self.coordinate, "most_turns": self.most_turns,
                "exponents": self.exponents, "cuts": self.cuts}
