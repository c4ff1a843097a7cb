"""The documents as web pages: built strictly, opened from the disk, read on a narrow screen; no other host is asked."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import vibro_ros

ROOT = Path(__file__).resolve().parents[2]
NARROW = 390  # [px] of a telephone
HIDDEN = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
CODE = "[...document.querySelectorAll('.highlight code')].filter(one => one.scrollWidth > one.clientWidth + 1).length"


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """Give the folder of the site; a link, an anchor or a docstring that mkdocs complains of fails the build."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--config-file", "tools/mkdocs.yml", "--site-dir",
               str(folder)]
    built = subprocess.run(command, cwd=ROOT, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"}, timeout=120,
                           capture_output=True, text=True)
    assert built.returncode == 0, built.stdout + built.stderr
    return folder


def test_every_public_name_is_on_the_page_of_the_python_interface(site):
    anchors = set(re.findall(r'id="vibro_ros\.([^"]+)"', (site / "python_interface.html").read_text()))
    assert set(vibro_ros.__all__) <= anchors
    assert {"Scene.with_parameters", "Scene.describe", "Simulator.command", "Simulator.state"} <= anchors


def test_pages_fit_a_narrow_screen_and_ask_no_other_host(site, open_page):
    """`watch` fails the test on each request to another host, and on each complaint of a page."""
    page = open_page(NARROW, 844)
    for file in sorted(set(site.rglob("*.html")) - {site / "404.html"}):  # a server's, with paths from its root
        page.goto(file.as_uri())
        assert (page.evaluate(HIDDEN), page.evaluate(CODE)) == (0, 0), file.name


def test_the_search_works_from_the_disk(site, page):
    page.goto((site / "guide" / "node.html").as_uri())
    page.fill("input.md-search__input", "grazing")
    page.wait_for_selector(".md-search-result__item a[href*='motions.html']", state="attached", timeout=20_000)
