"""What a page of the tests' browser does wrong fails its test, and the browser leaves nothing behind."""

import stat
import time
from pathlib import Path

import pytest
from watched_page import Watch, engine_or_outcome

from tools import browser
from tools.browser import CHOICE, Engine, NoBrowserError, Session, running

PAGE = """<!doctype html><meta name="viewport" content="width=device-width"><title>tiny</title>
<link rel="icon" href="data:,">
<canvas id="drawing" width="30" height="20"></canvas><p id="frames">0</p><script>
let frames = 0;
const count = () => { document.querySelector("#frames").textContent = ++frames; requestAnimationFrame(count); };
count();
</script>"""


@pytest.fixture
def tiny(tmp_path: Path) -> str:
    """The address of a page that counts its frames."""
    (tmp_path / "tiny.html").write_text(PAGE)
    return (tmp_path / "tiny.html").as_uri()


def put_program(folder: Path, name: str, text: str) -> Path:
    file = folder / name
    file.write_text(f"#!/bin/sh\n{text}\n")
    file.chmod(stat.S_IRWXU)
    return file


def frames_drawn(page, least: int = 5) -> None:
    page.wait_for_function(f"Number(document.querySelector('#frames').textContent) >= {least}")


def test_a_page_is_drawn_and_has_the_size_that_was_asked_for(page, open_page, tiny):
    phone = open_page(390, 844, touch=True)
    for one, width, height in ((page, 1280, 720), (phone, 390, 844)):
        one.goto(tiny)
        frames_drawn(one)
        assert one.evaluate("[innerWidth, innerHeight]") == [width, height]
        assert one.screenshot().startswith(b"\x89PNG")


def test_a_silent_browser_and_its_children_are_killed(monkeypatch, tmp_path):
    monkeypatch.setattr(browser, "START_PATIENCE", 1.0)
    monkeypatch.setattr(browser, "END_PATIENCE", 0.2)
    # Neither hears SIGTERM.
    silent = put_program(tmp_path, "silent", f"trap '' TERM; sleep 987 & echo $! > {tmp_path}/child; sleep 987")
    with pytest.raises(NoBrowserError, match="did not start within 1 s: it said nothing"), \
            running(Engine("chromium", str(silent))):
        pass
    child = int((tmp_path / "child").read_text())
    deadline = time.monotonic() + 5.0
    while (command := Path(f"/proc/{child}/cmdline")).exists() and command.read_bytes():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_a_browser_leaves_neither_processes_nor_files(engine, monkeypatch, tmp_path, tiny):
    monkeypatch.setattr(browser.tempfile, "tempdir", str(tmp_path))
    before = group_leaders()
    with Session(engine) as session:
        page = session.page()
        page.goto(tiny)
        frames_drawn(page)
        assert list(tmp_path.glob("vibro_ros_browser_*"))
        assert group_leaders() - before
    assert not list(tmp_path.glob("vibro_ros_browser_*"))
    assert not group_leaders() - before


def group_leaders() -> set[int]:
    """The ids of sessions below this process that still have a running member."""
    found = set()
    for stat_file in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, group, session = stat_file.read_text().rpartition(")")[2].split()[:4]
        except OSError:
            continue
        if state != "Z" and group == session and browser_of(int(group)):
            found.add(int(group))
    return found


def browser_of(group: int) -> bool:
    try:
        return b"vibro_ros_browser_" in Path(f"/proc/{group}/environ").read_bytes()
    except OSError:
        return False


def test_complaints_of_a_page_and_requests_to_others_are_noticed(open_page, watch, tiny):
    page = open_page()
    page.goto(tiny)
    page.evaluate("console.error('a wrong note')")
    watch.expect("a wrong note")
    page.evaluate("setTimeout(() => { throw new Error('a fault') })")
    wait_for_complaint(page, watch, "a fault")
    page.evaluate("fetch('http://192.0.2.1/').catch(() => 0); new WebSocket('ws://192.0.2.2/').onerror = () => 0; 0")
    wait_for_complaint(page, watch, "asks another host: http://192.0.2.1/")
    wait_for_complaint(page, watch, "asks another host: ws://192.0.2.2/")
    page.wait_for_load_state("networkidle")
    page.goto("about:blank")
    watch.complaints.clear()  # both were refused or lost, which the browser says in words of its own


def wait_for_complaint(page, watch: Watch, words: str) -> None:
    deadline = time.monotonic() + 10.0
    while not any(words in one for one in watch.complaints):
        assert time.monotonic() < deadline, watch.complaints
        page.wait_for_timeout(10)  # runs what listens
    watch.expect(words)


def test_without_a_browser_tests_are_skipped_but_fail_where_ci_is_set(monkeypatch):
    monkeypatch.setenv(CHOICE, "/nowhere/chrome")
    for name, outcome in (("", pytest.skip.Exception), ("true", pytest.fail.Exception)):
        monkeypatch.setenv("CI", name)
        with pytest.raises(outcome, match="/nowhere/chrome: no such program here; install chromium"):
            engine_or_outcome()
