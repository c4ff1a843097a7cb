"""The live view between a robot and strangers who publish anything: it shows the robot, and nothing else changes."""

import random
import struct

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import WrenchStamped
from observation import stop
from rcl_interfaces.msg import Log
from rclpy.serialization import serialize_message
from real_processes import CRAWL
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, String

from vibro_ros.messages.robot_messages import SAMPLE_LABELS
from vibro_ros.view.protocol import COLUMNS

KINDS = {"/vibro_robot/samples": Float64MultiArray, "impacts": WrenchStamped, "/diagnostics": DiagnosticArray,
         "/rosout": Log, "/vibro_robot/operations": String}
ROUNDS = 150


def strange_messages(chance: random.Random) -> list[tuple[str, bytes]]:
    """Yield random bytes, and well-formed messages with contents that no robot sends."""
    sample = Float64MultiArray(data=[chance.choice((float("nan"), float("inf"), -5.0, 1e300)) for _ in SAMPLE_LABELS])
    sample.layout.dim = [MultiArrayDimension(label=chance.choice((",".join(SAMPLE_LABELS), "x", "\n" * 900)))]
    impact = WrenchStamped()
    impact.header.frame_id, impact.wrench.force.z = chance.choice(("upper_plate", "x" * 3000)), chance.choice(
        (float("nan"), 1e9))
    boast = DiagnosticArray(status=[DiagnosticStatus(
        name="vibro_robot: simulation", hardware_id=chance.choice(("/other", "")), message="\n" * 50,
        values=[KeyValue(key="real-time factor", value=chance.choice(("nan", "9" * 400, "")))])])
    said = Log(level=50, name="somebody.else", msg="\x1b[31mhaha\n" * 30)
    asked = String(data=chance.choice(("set {", "reset reset", "step x", "set " + "[" * 2000, "fly")))
    whole = {"/vibro_robot/samples": sample, "impacts": impact, "/diagnostics": boast, "/rosout": said,
             "/vibro_robot/operations": asked}
    messages = [(topic, bytes(serialize_message(message))) for topic, message in whole.items()]
    messages += [(topic, chance.randbytes(chance.randrange(1, 1200))) for topic in KINDS]
    messages += [(topic, b"\0\1\0\0" + struct.pack("<iI", 2**31 - 1, 999_999_999) + b"\xff" * 50) for topic in KINDS]
    return messages


def test_strangers_change_nothing(start, bench, view, visit):
    chance, page = random.Random(17), visit(view)
    start("robot", *CRAWL)
    page.wait_for_robot()
    publishers = bench.publishers(KINDS)
    begin = len(page.rows)
    page.wait_for_rows(50)
    for _ in range(ROUNDS):
        for topic, data in strange_messages(chance):
            publishers[topic].publish(data)
        bench.spin_once()
    page.wait_for_rows(100)
    rows = np.concatenate(page.rows[begin:])
    assert np.isfinite(rows).all()
    assert np.allclose(np.diff(rows[:, 0]), 0.005, rtol=0.0, atol=1e-9)  # none is missing, none too many
    angle = rows[:, COLUMNS.index("crank_angle")]
    assert np.allclose(np.diff(angle), 0.5, rtol=0.0, atol=1e-9)
    logs = [text["words"] for text in page.texts if text["kind"] == "log"]
    assert not any("haha" in words or "\n" in words for words in logs)
    assert all(impact["peak_force"] < 1e8
               for text in page.texts if text["kind"] == "impacts" for impact in text["list"])
    view.wait_for("/vibro_robot/samples: refused: ")
    page.wait_for_robot()
    stop(view)
    assert "Traceback" not in view.text and "please report" not in view.text, view.text
    assert len(view.lines) < 200  # a flood does not fill the log


def test_a_node_of_the_robot_s_name_that_is_none_is_not_shown(start, bench, visit):
    """A node with the robot's name whose parameters are not a robot's is not drawn, and the page says why."""
    view = start("live_view", "--port", "0", "--robot", "bench")
    page = visit(view)
    bench.node.create_publisher(Float64MultiArray, "bench/samples", 10)
    bench.spin_until(lambda: page.last("absent").get("words", "").startswith("/bench cannot be shown: it has no "
                                                                              "parameter"), "the words")
    stop(view)
