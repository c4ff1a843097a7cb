"""Commands between two ticks: each taken once and in order, bounded, and the last one of each topic never lost."""

import threading
from functools import partial

from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from std_msgs.msg import Float64

from vibro_ros.ros.topics.subscriptions import MOST_WAITING, Gathering, Queue

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


def test_it_hands_over_all_in_the_order_of_arrival_across_topics():
    queue = Queue(("speed", "gap"))
    arrived = [("gap", b"1"), ("speed", b"2"), ("speed", b"3"), ("gap", b"4")]
    for name, data in arrived:
        queue.add(name, data)
    assert queue.take() == arrived
    assert queue.take() == []
    assert queue.dropped == 0


def test_a_full_line_drops_its_oldest_and_leaves_the_others_alone():
    queue = Queue(("speed", "gap"), most=3)
    queue.add("gap", b"only")
    for number in range(10):
        queue.add("speed", b"%d" % number)
    assert queue.take() == [("gap", b"only"), ("speed", b"7"), ("speed", b"8"), ("speed", b"9")]
    assert queue.dropped == 7


def test_every_message_is_taken_or_counted_when_two_threads_meet():
    queue, count, taken, flooded = Queue(("speed",)), 50_000, [], threading.Event()

    def flood() -> None:
        for number in range(count):
            queue.add("speed", b"%d" % number)
        flooded.set()

    thread = threading.Thread(target=flood)
    thread.start()
    while not flooded.is_set():
        batch = queue.take()
        assert len(batch) <= MOST_WAITING
        taken += batch
    thread.join()
    taken += queue.take()
    numbers = [int(data) for _, data in taken]
    assert numbers == sorted(numbers) and numbers[-1] == count - 1
    assert len(taken) + queue.dropped == count
