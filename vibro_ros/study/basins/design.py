"""What a study of basins computes: scene, cut and starts, and how long a start may take to settle."""

from dataclasses import dataclass

from vibro_ros.model.scene import Scene
from vibro_ros.orbits.turn_map import TURN
from vibro_ros.study.basins.starts import Starts

#: Rows of a block, some seconds of work: what an interruption can lose.
BLOCK_ROWS = 1024
FIRST, MOST = 8, 1_000_000  # limits of turns


@dataclass(frozen=True)
class Design:
    """A study of basins, checked.

    Attributes
    ----------
    scene : Scene
        What starts.
    phase : float
        Crank angle at the cut [rad].
    starts : Starts
        From where.
    turns : int
        Turns of the crank after which a start is looked at for the first time.
    most_turns : int
        Turns after which a start is given up.
    shocks : int
        Disturbances that are tried to find the smallest which changes a motion; 0 for none.

    Raises
    ------
    ValueError
        For numbers of turns that make no sense.
    """

    scene: Scene
    phase: float
    starts: Starts
    turns: int
    most_turns: int
    shocks: int

    def __post_init__(self) -> None:
        if not FIRST <= self.turns <= self.most_turns <= MOST:
            raise ValueError(f"--turns {self.turns} and --most-turns {self.most_turns}: give numbers from {FIRST} to "
                             f"{MOST}, the smaller one first")

    @property
    def run_time(self) -> float:
        """Robot time [s] of a start that settles at once."""
        return self.turns * TURN / self.scene["motor.speed"]

    @property
    def blocks(self) -> int:
        """Blocks of starts."""
        return -(-self.starts.count // BLOCK_ROWS)

    def rows_of_block(self, block: int) -> range:
        """Numbers of the starts of a block."""
        return range(block * BLOCK_ROWS, min((block + 1) * BLOCK_ROWS, self.starts.count))

    def document(self) -> dict:
        """All that decides where the starts lead, as JSON has it."""
        return {"scene": self.scene.name, "set": dict(self.scene.parameters), "phase": self.phase,
                "starts": self.starts.document(), "turns": self.turns, "most_turns": self.most_turns}
