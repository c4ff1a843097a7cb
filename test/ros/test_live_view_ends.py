"""Start and end of the live view: signals at any instant, ports in use, wrong arguments."""

import random
import signal
import socket
import time
from pathlib import Path

import pytest
from real_processes import CRAWL
from visitor import address_of

from vibro_ros.ros.live import view as live_view

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def test_a_signal_at_any_instant_of_the_start_ends_it_well(start):
    view, number = start("view", "--port", "0"), random.choice(SIGNALS)
    time.sleep(random.uniform(0.1, 1.5))  # the instant is by chance
    view.send(number)
    code = view.end()
    if "entry_point" not in view.text and "<frozen" not in view.text:  # else Python itself was still starting
        assert code in (0, -number) and "Traceback" not in view.text, view.text


def test_many_signals_end_it_well_with_pages_open(start, view, visit):
    pages = [visit(view) for _ in range(3)]
    start("robot", *CRAWL)
    for page in pages:
        page.wait_for_rows(10)
    for number in SIGNALS:
        view.send(number)
    assert view.end() == 0 and "Traceback" not in view.text, view.text
    for page in pages:
        page.wait(lambda page=page: page.closed, "the connection's end")


@pytest.mark.parametrize(("words", "line"), [
    ([], "--port {port}: something listens there already, perhaps another view; give another port, or --port 0 for any "
     "that is free"),
    (["--port", "65536"], "argument --port: 65536 is no port; give a number from 0 to 65535, 0 for any that is free"),
    (["--address", "192.0.2.1", "--port", "0"], "--address 192.0.2.1: nothing can listen there"),
    (["--robot", "1bad", "--port", "0"], "--robot 1bad: no node's name; give one such as /r1/vibro_robot"),
])
def test_what_is_wrong_is_one_line(refusal, monkeypatch, words, line):
    monkeypatch.setattr("os.nice", lambda _: None)  # or all tests that follow would be nice
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        assert refusal(live_view.main, *(words or ["--port", port])).startswith(f"view: {line.format(port=port)}")


def test_it_may_serve_others_and_opens_a_browser_whose_command_line_tells_no_token(start, visit, tmp_path, monkeypatch):
    browser, heard = tmp_path / "browser", tmp_path / "heard"
    browser.write_text(f'#!/bin/sh\necho "$1" > {heard}.part; mv {heard}.part {heard}\n')
    browser.chmod(0o700)
    monkeypatch.setenv("BROWSER", f"{browser} %s")
    view = start("live_view", "--port", "0", "--address", "0.0.0.0", "--open")
    view.wait_for("other machines reach this page, and who has its whole address commands the robot")
    address = address_of(view)
    page = visit(view)
    page.wait_for_absence("no robot")
    page.wait(heard.exists, "the browser")
    url = heard.read_text().strip()
    redirect = Path(url.removeprefix("file://"))
    assert address.token not in url and f"url={address.url}" in redirect.read_text()
    assert redirect.stat().st_mode & 0o777 == 0o600
    view.send(signal.SIGINT)
    assert view.end() == 0 and not redirect.exists()
