"""Messages that are gathered: each once, and every topic's in its order."""

from functools import partial

from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from std_msgs.msg import Float64

from vibro_ros.ros.node.gathering import Gathering

SENT = {"a": 300, "b": 200, "c": 1}
"""How many messages go to each topic: 0.0, 1.0, …"""
DEPTH = QoSProfile(depth=1000)


def test_each_message_is_handed_on_once_and_in_its_topics_order(bench):
    heard: dict[str, list[float]] = {topic: [] for topic in SENT}

    def hear(topic: str, data: bytes) -> None:
        heard[topic].append(deserialize_message(data, Float64).data)

    gathering = Gathering(hear)
    gathering.subscriptions = {
        topic: bench.node.create_subscription(Float64, topic, partial(gathering.take, topic), DEPTH, raw=True)
        for topic in SENT}
    publishers = {topic: bench.node.create_publisher(Float64, topic, DEPTH) for topic in SENT}
    bench.spin_until(lambda: all(one.get_subscription_count() for one in publishers.values()), "match")
    for number in range(max(SENT.values())):
        for topic in SENT:
            if number < SENT[topic]:
                publishers[topic].publish(Float64(data=float(number)))
        bench.spin_once()
    bench.spin_until(lambda: all(len(heard[topic]) >= SENT[topic] for topic in SENT), "all messages")
    for _ in range(10):  # nothing comes twice
        bench.spin_once()
    assert heard == {topic: [*map(float, range(count))] for topic, count in SENT.items()}
