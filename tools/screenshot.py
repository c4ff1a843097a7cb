"""Pictures of the live view for the documents: `python -m tools.screenshot`."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tools.browser import Session, browser_program, running
from tools.watched_robot import show_robot, wait_for, watched_robot

if TYPE_CHECKING:
    from playwright.sync_api import Page

CHARTS_FULL = 7.0
"""Robot time [s] at which the strip charts have no beginning any more."""
BLOWS = 12
"""Impacts from the begin of the slow motion to the one of the picture, which so has others on both sides."""
SLOWNESS = "1/33"


def main(words: Sequence[str]) -> int:
    """Run the command line `words`; the exit code."""
    output = _parser().parse_args(words).output
    # A machine that draws without a graphics card is slow: the robot is to catch up, and not to tell of stalls.
    with (running(browser_program()) as address, Session(address) as session,
          watched_robot({"rate.max_catch_up": 10.0}) as robot):
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


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("docs"), metavar="DIR",
                        help="where view.png and view_live.png are written (default: %(default)s)")
    return parser


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
