"""The line of commands between two ticks: bounded, in order, and the last command of each topic is never lost."""

import threading

from vibro_ros.ros.topics.waiting import MOST_WAITING, Waiting


def test_it_hands_over_all_in_the_order_of_arrival_across_topics():
    waiting = Waiting(("speed", "gap"))
    arrived = [("gap", b"1"), ("speed", b"2"), ("speed", b"3"), ("gap", b"4")]
    for name, data in arrived:
        waiting.add(name, data)
    assert waiting.take() == arrived
    assert waiting.take() == []
    assert waiting.dropped == 0


def test_a_full_line_drops_its_oldest_and_leaves_the_others_alone():
    waiting = Waiting(("speed", "gap"), most=3)
    waiting.add("gap", b"only")
    for number in range(10):
        waiting.add("speed", b"%d" % number)
    assert waiting.take() == [("gap", b"only"), ("speed", b"7"), ("speed", b"8"), ("speed", b"9")]
    assert waiting.dropped == 7


def test_every_message_is_taken_or_counted_when_two_threads_meet():
    waiting, count, taken, flooded = Waiting(("speed",)), 50_000, [], threading.Event()

    def flood() -> None:
        for number in range(count):
            waiting.add("speed", b"%d" % number)
        flooded.set()

    thread = threading.Thread(target=flood)
    thread.start()
    while not flooded.is_set():
        batch = waiting.take()
        assert len(batch) <= MOST_WAITING
        taken += batch
    thread.join()
    taken += waiting.take()
    numbers = [int(data) for _, data in taken]
    assert numbers == sorted(numbers) and numbers[-1] == count - 1
    assert len(taken) + waiting.dropped == count
