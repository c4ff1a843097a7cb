"""Functions by which tests read and await contents of the view's page, and run the page's modules without the page."""

import json
import time
from collections.abc import Callable
from typing import Any

from vibro_ros.view.page import import_map

PATIENCE = 30.0  # [s] deadline of what takes a second on an idle machine
COLOURED = """name => {  // middle and height [CSS px] of what has a colour in the drawing, and its area
    const canvas = document.querySelector("#mechanism");
    const ratio = canvas.width / canvas.clientWidth;
    const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d", {willReadFrequently: true});
    copy.drawImage(canvas, 0, 0);
    const {width, height, data} = copy.getImageData(0, 0, canvas.width, canvas.height);
    const wanted = getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
    const [red, green, blue] = [1, 3, 5].map(place => parseInt(wanted.slice(place, place + 2), 16));
    let [count, x, y] = [0, 0, 0];
    for (let row = 0; row < height; row += 1) {
        for (let column = 0; column < width; column += 1) {
            const place = 4 * (row * width + column);
            if (data[place] === red && data[place + 1] === green && data[place + 2] === blue) {
                count += 1; x += column; y += row;
            }
        }
    }
    return [x / count / ratio, y / count / ratio, count / ratio ** 2];
}"""


def until(page, done: Callable, description: str = "") -> None:
    """Wait until `done(page)`. Playwright's own waiting evaluates text, which the page's policy forbids."""
    deadline = time.monotonic() + PATIENCE
    while not done(page):
        assert time.monotonic() < deadline, f"{description or done.__name__}: not within {PATIENCE} s; {state(page)}"
        page.wait_for_timeout(20)


def wait_for(page, condition: str) -> None:
    """Wait until a JavaScript `condition` is true."""
    until(page, lambda page: page.evaluate(condition), condition)


def open_file(page, file) -> None:
    """Open the page of a recording and wait for its picture."""
    page.goto(file.as_uri())
    wait_for(page, "Boolean(window.vibro) && Number.isFinite(vibro.drawn().time)")


def state(page) -> str:
    """Return the readable contents of a page, for the message of a failing test."""
    absent, words = (page.evaluate(f"document.querySelector('{name}')?.textContent") for name in ("#absent", "#said"))
    return f"absent: {absent!r}; said: {words!r}"


def drawn(page) -> dict:
    """Return the `time` [s] and the `quantities` by name that the last picture shows; NaN is None."""
    return page.evaluate("globalThis.vibro ? vibro.drawn() : {time: NaN, quantities: {}}")


def shows_robot(page) -> bool:
    """Whether the page draws a robot that nothing covers."""
    return drawn(page)["time"] == drawn(page)["time"] and not page.is_visible("#absent")


def drawn_frames(page, count: int) -> list[dict]:
    """Return the contents of so many consecutive pictures of the page."""
    return page.evaluate("""count => new Promise(resolve => {
        const frames = [];
        const take = () => {
            frames.push(vibro.drawn());
            frames.length < count ? requestAnimationFrame(take) : resolve(frames);
        };
        requestAnimationFrame(take);
    })""", count)


def enter(page, knob: str, number: str, key: str = "Enter") -> None:
    """Type a number into the field of a knob, and leave it by a key."""
    page.fill(f"#{knob}", number)
    page.press(f"#{knob}", key)


def robot_message(page) -> str:
    """Return the robot's message that the page shows."""
    return page.inner_text("#said")


def exactness(page) -> str:
    """Return the page's statement on the exactness of its slow motion."""
    return page.inner_text("#exactness")


class Modules:
    """The page's modules, in an empty page of the browser.

    Parameters
    ----------
    page : playwright page
        Empty.
    """

    def __init__(self, page):
        page.set_content(f'<!doctype html><script type="importmap">{import_map()}</script>')
        self._page = page

    def call(self, module: str, body: str, *values: object) -> Any:
        """Return the result of a JavaScript `body`, with the exports of `module` as `m` and `values` as `v`."""
        program = f'async (v) => {{ const m = await import("vibro/{module}.js"); {body} }}'
        return self._page.evaluate(program, json.loads(json.dumps(values)))
