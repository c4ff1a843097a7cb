"""The page as one text: HTML, style, modules, setting and data; nothing is loaded from elsewhere.

The modules of `page/` import each other by names such as ``vibro/charts.js``. An import map resolves each name to a
`data:` URL, so that unchanged module files fit into one text without a bundler. The page's policy allows only scripts
and styles with the page's nonce, and modules that these import; a recording's page may not connect to anything.
"""

import base64
import functools
import hashlib
import json
import re
import zlib
from collections.abc import Mapping
from html import escape
from importlib import resources
from typing import Any

FILES = resources.files("vibro_ros.view") / "page"  # the page's HTML, style and modules, as they are installed
MARK = '<meta name="generator" content="vibro_ros view">'  # mark near the beginning of every page


def page_text(setting: Mapping[str, Any], motion: tuple[Mapping[str, Any], bytes] | None = None,
              nonce: str = "") -> str:
    """Return the whole page as HTML; ValueError for a number that is not finite, which JSON cannot represent.

    `setting` has ``mode`` (``live`` or ``bag``), ``title``, ``version``; for a recording also ``machine``. `motion` is
    the motion document of a recording, `nonce` that of the server's policy. Without a nonce the text contains its own
    policy, as a file must.
    """
    elements = [f'<script id="setting" type="application/json">{_json(setting)}</script>']
    if motion:
        packed = base64.b64encode(zlib.compress(motion[1])).decode()
        elements += [f'<script id="motion-header" type="application/json">{_json(motion[0])}</script>',
                     f'<script id="motion-payload" type="text/plain">{packed}</script>']
    data = "\n".join(elements)
    meta = "<!-- policy -->"
    if not nonce:
        nonce = hashlib.sha256(data.encode()).hexdigest()[:32]  # the same recording gives the same file
        meta = f'<meta http-equiv="Content-Security-Policy" content="{policy(nonce)}">'
    parts = {
        "policy": meta, "title": escape(str(setting["title"])), "data": data,
        "style": f'<style nonce="{nonce}">\n{_file("style.css")}</style>',
        "modules": f'<script type="importmap" nonce="{nonce}">{import_map()}</script>\n'
                   f'<script type="module" nonce="{nonce}">import "vibro/main.js";</script>'}
    return re.sub(r"<!-- (\w+) -->", lambda match: parts[match[1]], _file("index.html"))


def policy(nonce: str, connect: str = "'none'") -> str:
    """Return the page's Content-Security-Policy; `connect` is where the page may connect to."""
    return (f"default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; img-src data:; "
            f"connect-src {connect}; base-uri 'none'; form-action 'none'")


@functools.cache
def import_map() -> str:
    """Return the import map, JSON that resolves the name of each module to a `data:` URL."""
    urls = {}
    for name in sorted(file.name for file in FILES.iterdir() if file.name.endswith(".js")):
        named = f"{_file(name)}//# sourceURL=vibro/{name}\n"  # for the browser's tools
        urls[f"vibro/{name}"] = "data:text/javascript;base64," + base64.b64encode(named.encode()).decode()
    return json.dumps({"imports": urls})


@functools.cache
def _file(name: str) -> str:
    return (FILES / name).read_text(encoding="utf-8")


def _json(data: Mapping[str, Any]) -> str:
    """Return JSON that cannot end a script element: non-ASCII characters and `<` are escaped."""
    return json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
