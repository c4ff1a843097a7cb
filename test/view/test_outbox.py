"""What waits for a page is bounded, and what is late is dropped first."""

import numpy as np
import pytest

from vibro_ros.view.protocol import COLUMNS, MOST_BYTES, MOST_TEXTS, Outbox

ROW = 8 * len(COLUMNS)


def rows(count: int, value: float = 0.0) -> bytes:
    return np.full((count, len(COLUMNS)), value).tobytes()


def taken(outbox: Outbox) -> list[str | bytes]:
    found = []
    while outbox:
        found.append(outbox.take())
    return found


def test_rows_that_follow_one_another_make_one_frame_and_texts_keep_their_place():
    outbox = Outbox()
    outbox.add_text("robot", "R")
    outbox.add_samples(rows(2))
    outbox.add_samples(rows(3))
    outbox.add_text("log", "L")
    outbox.add_samples(rows(1))
    frames = taken(outbox)
    assert [one if isinstance(one, str) else (np.frombuffer(one[:8], "<u4").tolist(), len(one)) for one in frames] == [
        "R", ([1, 5], 8 + 5 * ROW), "L", ([1, 1], 8 + ROW)]


def test_a_page_that_does_not_read_keeps_the_latest_samples_within_bounds():
    outbox = Outbox()
    for number in range(3000):
        outbox.add_samples(rows(10, float(number)))
        outbox.add_text("log", str(number))
        outbox.add_text("status", str(number))
    frames = taken(outbox)
    samples = [np.frombuffer(one, offset=8) for one in frames if isinstance(one, bytes)]
    assert MOST_BYTES / 2 < sum(one.nbytes for one in samples) <= MOST_BYTES
    assert samples[-1][-1] == 2999.0 and samples[0][0] > 1000.0
    texts = [one for one in frames if isinstance(one, str)]
    assert len(texts) <= MOST_TEXTS + 1 and texts[-1] == "2999"


@pytest.mark.parametrize("kind", ["robot", "absent"])
def test_another_standing_makes_void_what_waits_of_the_one_before(kind):
    outbox = Outbox()
    outbox.add_text("robot", "before")
    outbox.add_samples(rows(2))
    outbox.add_text("impacts", "blows")
    outbox.add_text("answer", "done")
    outbox.add_text(kind, "now")
    assert taken(outbox) == ["done", "now"]


def test_a_motion_replaces_the_one_that_waits():
    outbox = Outbox()
    outbox.add_motion("first", b"1")
    outbox.add_motion("second", b"2")
    assert taken(outbox) == ["second", b"2"]
