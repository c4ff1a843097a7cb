"""What tests of the page share: its modules without the page, and waiting for what a page shows."""

import json
import time
from typing import Any

from vibro_ros.view.page import import_map

PATIENCE = 20.0  # s


def wait_for(page, condition: str):
    """Wait until JavaScript's `condition` holds; the page's policy forbids Playwright's own way."""
    end = time.monotonic() + PATIENCE
    while not page.evaluate(condition):
        assert time.monotonic() < end, condition
        page.wait_for_timeout(20)


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
        """What JavaScript's `body` returns with the names that `module` exports as `m`, and `values` as `v`."""
        program = f'async (v) => {{ const m = await import("vibro/{module}.js"); {body} }}'
        return self._page.evaluate(program, json.loads(json.dumps(values)))
