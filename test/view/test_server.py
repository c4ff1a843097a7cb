"""Access to the live page's server, its queue for each page: bounded, with the oldest samples dropped first; and
what it tells a page of a robot, which agrees with the scene.
"""

import json

import numpy as np
import pytest
from tornado.httputil import HTTPHeaders, HTTPServerRequest
from tornado.routing import HostMatches

import vibro_ros
from vibro_ros.configuration.scene_file import shipped_scenes
from vibro_ros.view.protocol import COLUMNS, drawing, quantities
from vibro_ros.view.server import MOST_BYTES, MOST_TEXTS, Outbox, host_pattern

ROW = 8 * len(COLUMNS)


def rows(count: int, value: float = 0.0) -> bytes:
    return np.full((count, len(COLUMNS)), value).tobytes()


def taken(outbox: Outbox) -> list[str | bytes]:
    frames = []
    while outbox:
        frames.append(outbox.take())
    return frames


def test_consecutive_rows_make_one_frame_and_texts_keep_their_order():
    outbox = Outbox()
    outbox.add("robot", "R")
    outbox.add("samples", rows(2))
    outbox.add("samples", rows(3))
    outbox.add("log", "L")
    outbox.add("samples", rows(1))
    frames = taken(outbox)
    assert [frame if isinstance(frame, str) else (np.frombuffer(frame[:8], "<u4").tolist(), len(frame))
            for frame in frames] == ["R", ([1, 5], 8 + 5 * ROW), "L", ([1, 1], 8 + ROW)]


def test_a_page_that_does_not_read_keeps_the_latest_samples_within_bounds():
    outbox = Outbox()
    for number in range(3000):
        outbox.add("samples", rows(10, float(number)))
        outbox.add("log", str(number))
        outbox.add("status", str(number))
    frames = taken(outbox)
    samples = [np.frombuffer(frame, offset=8) for frame in frames if isinstance(frame, bytes)]
    assert MOST_BYTES / 2 < sum(sample.nbytes for sample in samples) <= MOST_BYTES
    assert samples[-1][-1] == 2999.0 and samples[0][0] > 1000.0
    texts = [frame for frame in frames if isinstance(frame, str)]
    assert len(texts) <= MOST_TEXTS + 1 and texts[-1] == "2999"


@pytest.mark.parametrize("kind", ["robot", "absent"])
def test_a_new_state_replaces_waiting_frames_of_the_previous_state(kind):
    outbox = Outbox()
    outbox.add("robot", "before")
    outbox.add("samples", rows(2))
    outbox.add("impacts", "blows")
    outbox.add("answer", "done")
    outbox.add(kind, "now")
    assert taken(outbox) == ["done", "now"]


def test_a_motion_replaces_a_waiting_motion():
    outbox = Outbox()
    outbox.add("motion", "first", b"1")
    outbox.add("motion", "second", b"2")
    assert taken(outbox) == ["second", b"2"]


@pytest.mark.parametrize("address, taken, refused", [
    ("127.0.0.1", ["127.0.0.1", "127.0.0.1:8742", "localhost:9", "LocalHost:8742", "[::1]:8742", "127.8.9.10:1"],
     ["evil.example", "127.0.0.1.evil.example:8742", "localhost.evil", "evil.localhost", "192.168.1.2:8742",
      "0.0.0.0:8742", "[::]:8742", "127.0.0.1:8742:1", "robot-pc:8742", "::1", "127.1", "2130706433", "127.0.0.1x"]),
    ("0.0.0.0", ["192.168.1.2:8742", "robot-pc:8742", "127.0.0.1", "[fe80::1]:8742"],
     ["evil.example:8742", "0.0.0.0:8742", "robot-pc.evil:8742", "192.168.1.2.evil:1"])])
def test_the_host_pattern_accepts_only_this_machines_names(address, taken, refused):
    hosts = HostMatches(host_pattern(address, ["Robot-PC"]))
    for host in (*taken, *refused):
        request = HTTPServerRequest("GET", "/", "HTTP/1.1", HTTPHeaders({"Host": host}))
        assert (hosts.match(request) is not None) == (host in taken), host


@pytest.mark.parametrize("name", shipped_scenes())
def test_lengths_limits_and_units_of_every_shipped_scene(name):
    scene = vibro_ros.load_scene(name)
    robot = json.loads(json.dumps(drawing(scene), allow_nan=False))
    assert (robot["name"], robot["crank_radius"]) == (name, scene["crank.radius"])
    assert [guide["side"] for guide in robot["guides"]] == list(scene.guides)
    floor = ["ground.friction"] if scene["effects.friction"] != "none" else []
    assert [knob["name"] for knob in robot["knobs"]] == [
        "motor_speed", *(f"{side}_gap" for side in scene.plates), *floor]
    assert list(robot["quantities"]) == list(quantities(scene)) and robot["hops"] == (name in ("device", "machine"))


@pytest.mark.parametrize("changes", [{"effects.reaction": False}, {"effects.friction": "static"}])
def test_the_robot_refuses_beyond_a_knobs_limits_and_nowhere_before(changes):
    device = vibro_ros.Simulator(vibro_ros.load_scene("device").with_parameters(changes))
    for knob in drawing(device.scene)["knobs"]:
        for limit, beyond in ((knob["from"], -1e-6), (knob["to"], 1e-6)):
            turn = device.set_parameters if knob["parameter"] else lambda value: device.command(**value)
            turn({knob["name"]: limit})
            with pytest.raises(ValueError):
                turn({knob["name"]: limit + beyond})


def test_a_robot_without_a_mass_or_a_plate_has_no_quantities_of_them():
    scene = vibro_ros.load_scene("damped").with_parameters(
        {"effects.upper_mass": False, "effects.inclined_contact": "none", "ground.slope": -0.2})
    robot = drawing(scene)
    assert (robot["slope"], robot["weight"]) == (-0.2, scene.total_mass * scene["gravity"])
    assert [(guide["side"], guide["plate"]) for guide in robot["guides"]] == [("inclined", False)]
    assert [knob["name"] for knob in robot["knobs"]] == ["motor_speed", "ground.friction"]
    assert not any("upper" in name or "plate" in name for name in robot["quantities"])
    assert robot["quantities"]["inclined_position"] == "m" and robot["quantities"]["inclined_drive_force"] == "N"
    assert robot["quantities"]["crank_angle"] == "rad" and robot["quantities"]["motor_speed"] == "rad/s"
