"""Commands taken from DDS by the stepping thread: each once and in order; the last command of a topic is never lost."""

from std_msgs.msg import Float64

import vibro_ros
from vibro_ros.messages.codec import new_message, serialised
from vibro_ros.ros.node.node import PollingSubscription
from vibro_ros.ros.robot.subscriptions import CommandSubscriptions


def test_rclpy_hands_out_bytes_and_instant_of_a_message(bench):
    """`take_message` is not documented, so this test fails if rclpy changes or removes it."""
    subscription = PollingSubscription(bench.node, Float64, "numbers", 10)
    (publisher,) = bench.publishers({"numbers": Float64}).values()
    for number in range(3):
        publisher.publish(Float64(data=float(number)))
    taken = []
    bench.spin_until(lambda: taken.extend(subscription.take(2)) or len(taken) == 3, "messages")
    message = new_message("std_msgs/msg/Float64")
    for number, (data, instant) in enumerate(taken):
        message.data = float(number)
        assert data == serialised(message, "std_msgs/msg/Float64")
        assert number == 0 or instant >= taken[number - 1][1] > 1.7e18
    assert subscription.take(10) == []


def test_a_message_whose_publisher_came_and_left_between_two_polls_arrives(bench):
    subscription, taken = PollingSubscription(bench.node, Float64, "numbers", 10), []
    for number in range(3):  # also after a publisher that has left, which was polled in vain
        (publisher,) = bench.publishers({"numbers": Float64}).values()
        publisher.publish(Float64(data=float(number)))
        assert publisher.wait_for_all_acked()
        bench.node.destroy_publisher(publisher)
        bench.spin_until(lambda: not bench.node.count_publishers("numbers"), "the publisher's end")
        bench.spin_until(lambda n=number: taken.extend(subscription.take(2)) or len(taken) > n, "the message")
        assert subscription.take(2) == []
    assert len(taken) == 3


def test_commands_are_recorded_in_the_order_of_arrival_and_of_a_flood_the_last_ones_stand(bench):
    scene = vibro_ros.load_scene("device")
    device, commands, recorded = vibro_ros.Simulator(scene), CommandSubscriptions(bench.node, scene), []
    publishers = bench.publishers({"motor_speed": Float64, "upper_gap": Float64}, depth=1000)

    def received(most: int) -> bool:
        commands.apply(device, 7, lambda topic, stamp, data: recorded.append((topic, stamp)))
        return len(recorded) >= most

    for number in range(4):  # the order across topics is that of arrival
        publishers[("motor_speed", "upper_gap")[number % 2]].publish(Float64(data=1e-4 * number))
        bench.spin_until(lambda number=number: received(number + 1), "a command")
    assert recorded == [("/motor_speed", 7), ("/upper_gap", 7)] * 2
    for number in range(301):
        publishers["motor_speed"].publish(Float64(data=0.25 * number))
    bench.spin_until(lambda: received(len(recorded)) and device.commanded_motor_speed == 75.0, "the last of a flood")
    assert commands.refused == 0 and commands.accepted["motor_speed"] == len(recorded) - 2
