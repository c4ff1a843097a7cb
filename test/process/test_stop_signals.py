"""What a signal means for the exit code."""

import signal

import pytest

from vibro_ros.process.stop_signals import Process


@pytest.mark.parametrize(("program", "has_an_end", "code"), [
    ("robot", False, 0), ("view", False, 0), ("view", True, 130), ("report", False, 130),
])
def test_a_signal_is_the_end_of_what_has_none_and_an_interruption_of_what_has_one(program, has_an_end, code):
    process = Process()
    process.program, process.has_an_end = program, has_an_end
    assert process.code_after(signal.SIGINT) == code
