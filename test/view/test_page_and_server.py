"""The live page with its server and a robot that a test plays: what the page shows, asks for and says."""

import contextlib
import time

import numpy as np
import pytest
from page_modules import wait_for

import vibro_ros
from vibro_ros.simulation.samples import FIELDS
from vibro_ros.view.gate import Gate
from vibro_ros.view.machine import machine
from vibro_ros.view.page import page_text
from vibro_ros.view.protocol import Call, Command, SlowMotion, text_frame
from vibro_ros.view.server import Server, listening
from vibro_ros.view.slow_motion import motion_between

RATE = 200.0  # Hz
PATIENCE = 20.0  # s
OFFERS = {"reset": True, "pause": True, "step": True, "record": True}
STATUS = {"real_time_factor": 0.998, "dropped_share": 0.0125, "refused": 0, "paused": False,
          "recording": "recording to /tmp/bag"}


def rows_of(scene, seconds, motor_speed=100.0):
    """Samples of a robot from its start, shape (n, fields)."""
    device = vibro_ros.Simulator(scene)
    device.command(motor_speed=motor_speed)
    rows = []
    for tick in range(round(seconds * RATE)):
        device.advance_to(tick / RATE)
        rows.append([getattr(device.state, name) for name in FIELDS])
    return np.array(rows)


class Played:
    """The other side of the page: what the robot tells, and what it was asked for."""

    def __init__(self):
        self.asked, self.told = [], [("absent", text_frame("absent", words="no robot named /vibro_robot here"))]
        self.gate = Gate("127.0.0.1", [])
        self._sockets = listening("127.0.0.1", 0)
        self.address = f"http://127.0.0.1:{self._sockets[0].getsockname()[1]}/?token={self.gate.token}"
        setting = {"mode": "live", "title": "/vibro_robot live", "robot": "/vibro_robot", "version": "1"}
        self.server = Server(self._sockets, self.gate, lambda nonce: page_text(setting, None, nonce),
                             lambda page, request: self.asked.append((page, request)), lambda: self.told)

    def tell(self, kind, **what):
        self.server.send(kind, text_frame(kind, **what))

    def tell_robot(self, scene, origin="1", offers=OFFERS):
        self.tell("robot", name="/vibro_robot", machine=machine(scene), columns=list(FIELDS), origin=origin,
                  offers=offers)

    def wait_for(self, kind):
        """Give page and request of the next request of that kind."""
        end = time.monotonic() + PATIENCE
        while True:
            for one in self.asked:
                if isinstance(one[1], kind):
                    self.asked.remove(one)
                    return one
            assert time.monotonic() < end, self.asked
            time.sleep(0.01)


@pytest.fixture
def robot():
    played = Played()
    with played.server:
        yield played


@pytest.fixture(scope="module")
def scene():
    return vibro_ros.load_scene("device")


@pytest.fixture(scope="module")
def rows(scene):
    return rows_of(scene, 3.0)


@pytest.fixture
def live(page, robot, scene, rows):
    """A page that has seen three seconds of a robot."""
    page.goto(robot.address)
    wait_for(page, "document.querySelector('#absent').textContent.includes('no robot named')")
    robot.tell_robot(scene)
    robot.tell("status", **STATUS)
    robot.server.send_samples(rows.tobytes())
    wait_for(page, "Number.isFinite(vibro.drawn().time)")
    return page


def test_what_is_drawn_is_what_was_published(live, rows):
    for row in rows[::71]:
        drawn = live.evaluate("(time) => vibro.show(time)", row[0])
        assert drawn["time"] == row[0]
        assert drawn["quantities"] == dict(zip(FIELDS[1:], row[1:].tolist(), strict=True))
    between = live.evaluate("(time) => vibro.show(time)", rows[300, 0] + 0.002)
    assert between["time"] == rows[300, 0]  # nothing is invented


def test_knobs_command_and_refusals_are_said(live, robot):
    live.fill("#motor_speed", "120")
    live.press("#motor_speed", "Enter")
    _, request = robot.wait_for(Command)
    assert (request.name, request.value) == ("motor_speed", 120.0)
    live.fill("#upper_gap", "1")
    live.press("#upper_gap", "Enter")
    assert robot.wait_for(Command)[1].value == 1.0
    words = "command refused: upper.gap: 1 is out of range <b>"
    robot.tell("log", level="warning", words=words)
    wait_for(live, "document.querySelector('#said').textContent.includes('out of range')")
    assert live.text_content("#said p:last-child") == words  # text, not HTML
    assert live.get_attribute("#said", "aria-live") == "polite"


def test_buttons_ask_for_what_the_robot_offers(live, robot, scene):
    assert live.is_disabled("#step")  # not before the robot is paused
    for name, on in (("reset", None), ("pause", True), ("record", False)):
        live.click(f"#{name}")
        page, request = robot.wait_for(Call)
        assert (request.name, request.on) == (name, on)
        robot.server.answer(page, request.id, True, f"{name} done")
        wait_for(live, f"document.querySelector('#said').textContent.includes('{name} done')")
    robot.tell("status", **{**STATUS, "paused": True, "recording": ""})
    wait_for(live, "document.querySelector('#pause').ariaPressed === 'true'")
    assert live.get_attribute("#record", "aria-pressed") == "false"
    live.click("#step")
    assert robot.wait_for(Call)[1].name == "step"
    robot.tell_robot(scene, offers={**OFFERS, "reset": False})
    wait_for(live, "document.querySelector('#reset').disabled")


def test_slow_motion_of_the_last_second_and_back(live, robot, scene, rows):
    live.keyboard.press("s")
    page, request = robot.wait_for(SlowMotion)
    assert request.seconds == 1.0
    motion = motion_between(scene, dict(zip(FIELDS, rows[-201:].T, strict=True)))
    robot.server.send_motion(page, request.id, motion)
    wait_for(live, "!document.querySelector('#live').hidden")
    wait_for(live, "document.querySelector('#exactness').textContent === 'exact between samples'")
    for row in rows[-150:-1:40]:
        drawn = live.evaluate("(time) => vibro.show(time)", row[0])
        for name in ("body_position", "upper_position", "inclined_position"):
            assert abs(drawn["quantities"][name] - row[FIELDS.index(name)]) < 1e-9, name  # m
    live.keyboard.press("Escape")
    wait_for(live, f"vibro.drawn().time === {float(rows[-1, 0])!r}")
    assert live.is_disabled("#play")


def test_another_robot_is_drawn_from_its_start(live, robot, rows):
    other = vibro_ros.load_scene("no_impact")
    robot.tell("absent", words="the robot has gone")
    wait_for(live, "!document.querySelector('#absent').hidden")
    assert live.is_disabled("#motor_speed")
    robot.tell_robot(other, origin="2")
    robot.server.send_samples(rows_of(other, 0.5).tobytes())
    wait_for(live, "document.querySelector('#absent').hidden && vibro.drawn().time < 0.5")
    assert live.locator("#motor_speed").count() == 1 and live.locator("#upper_gap").count() == 0


def test_a_server_that_ends_is_said_and_waited_for(live, robot, watch):
    robot.server.__exit__()
    wait_for(live, "document.querySelector('#absent').textContent.includes('the view has ended')")
    assert live.is_disabled("#motor_speed")
    with contextlib.suppress(AssertionError):  # there is one if the page has tried again already
        watch.expect("WebSocket")
