"""What effects cost, in a minute: the column *cost* of the tables in docs/robot.md, for the effects that are asked for.

    python -m tools.effect_cost lag Stribeck

prints the rows whose names hold one of the words.
"""

if __name__ == "__main__":  # before all imports, as in every executable
    import sys

    from vibro_ros.process.front_door import enter

    sys.exit(enter("effect_cost"))

from collections.abc import Iterable, Sequence

from tools.effects import EFFECTS, Effect, cost_ratio
from vibro_ros.process.command_line import Parser
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.process.front_door import exit_code


def chosen(words: Iterable[str]) -> list[Effect]:
    """The effects whose names hold one of the words; all of them without words.

    Raises
    ------
    ValueError
        For a word that no name holds.
    """
    words = list(words)
    for word in words:
        if not any(word in effect.name for effect in EFFECTS):
            raise ValueError(f"{word}: no effect has it in its name; the names stand in docs/robot.md")
    return [effect for effect in EFFECTS if not words or any(word in effect.name for word in words)]


def main(words: Sequence[str]) -> int:
    """Measure and print; 0 when done; see `front_door.exit_code` for errors."""
    return exit_code("effect_cost", lambda: _print(words))


def _print(words: Sequence[str]) -> int:
    parser = Parser(prog="effect_cost", description=EXECUTABLES["effect_cost"].does)
    parser.add_argument("words", nargs="*", metavar="word", help="part of an effect's name (default: all effects)")
    parser.add_argument("--duration", type=float, default=10.0, help="robot time [s] (default %(default)g)")
    parser.add_argument("--repeats", type=int, default=25, help="pairs of timed runs (default %(default)d)")
    options = parser.parse_args(words)
    print("| scene | effect | cost |\n|---|---|---|")
    for effect in chosen(options.words):
        cost = cost_ratio(effect, options.duration, options.repeats)
        print(f"| `{effect.scene}` | {effect.name} | {cost:.2f} |", flush=True)
    return 0
