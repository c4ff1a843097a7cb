"""Modules of the page in a browser, without the page: what their functions return."""

import json
from typing import Any

from vibro_ros.view.page import import_map


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
