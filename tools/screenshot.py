"""Pictures of the live view for the documents: `python -m tools.screenshot`."""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    import sys

    from vibro_ros.process.front_door import enter

    sys.exit(enter("screenshot"))

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tools.browser import Session, chosen_engine
from tools.watched_robot import show_robot, wait_for, watched_robot
from vibro_ros.process.command_line import Parser
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.process.front_door import exit_code

if TYPE_CHECKING:
    from playwright.sync_api import Page

CHARTS_FULL = 7.0
"""Robot time [s] at which the strip charts have no beginning any more."""
BLOWS = 12
"""Impacts from the begin of the slow motion to the one of the picture, which so has others on both sides."""
SLOWNESS = "1/33"


def main(words: Sequence[str] | None = None) -> int:
    """Write the pictures; 0 when done, 1 when a process failed, 2 for a bad argument, 130 when interrupted."""
    return exit_code("screenshot", lambda: _run(sys.argv[1:] if words is None else words))


def _run(words: Sequence[str]) -> int:
    output = _parser().parse_args(words).output
    # A machine that draws without a graphics card is slow: the robot is to catch up, and not to tell of stalls.
    with Session(chosen_engine()) as session, watched_robot({"rate.max_catch_up": 10.0}) as robot:
        page = session.page()
        show_robot(page, robot)
        wait_for(page, f"vibro.drawn().time > {CHARTS_FULL}")
        _save(page, output / "view_live.png")
        _show_a_blow(page)
        _save(page, output / "view.png")
    return 0


def _show_a_blow(page: "Page") -> None:
    """Stop in slow motion where a mass touches its plate, with forces."""
    page.check("#forces")
    page.click("#slow")
    wait_for(page, "!document.querySelector('#timeline').disabled")
    page.select_option("#speed", label=SLOWNESS)
    for _ in range(BLOWS):
        page.click("#next")
    page.evaluate("document.activeElement.blur()")
    page.wait_for_timeout(500)  # for the eye's sake: what fades has faded


def _save(page: "Page", path: Path) -> None:
    page.screenshot(path=path)
    print(path)


def _parser() -> Parser:
    parser = Parser(prog="screenshot", description=EXECUTABLES["screenshot"].does)
    parser.add_argument("--output", type=Path, default=Path("docs"), metavar="DIR",
                        help="where view.png and view_live.png are written (default: %(default)s)")
    return parser
