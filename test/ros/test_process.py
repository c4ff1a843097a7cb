"""The loop of a node's process: a signal ends its wait, however long it would be."""

import os
import signal
from threading import Timer

import pytest

from vibro_ros.ros.node import process

PATIENCE = 30.0  # [s]


def test_a_signal_ends_the_wait_of_the_loop(domain_id):
    came = []
    before = signal.signal(signal.SIGUSR1, lambda number, frame: came.append(number))
    with process.node_running("waiting", []) as (_, executor):
        sending = Timer(0.2, os.kill, (os.getpid(), signal.SIGUSR1))
        giving_up = Timer(PATIENCE, executor.create_task, (pytest.fail, f"still waiting after {PATIENCE} s"))
        sending.start()
        giving_up.start()
        try:
            process.spin_until(executor, lambda: bool(came) or not giving_up.is_alive(), poll=10.0 * PATIENCE)
        finally:
            giving_up.cancel()
            signal.signal(signal.SIGUSR1, before)
    assert came == [signal.SIGUSR1]


def test_what_heard_of_signals_before_hears_of_them_again(domain_id):
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    before = signal.set_wakeup_fd(writing)
    try:
        with process.node_running("passing", []):
            pass
        assert signal.set_wakeup_fd(before) == writing
    finally:
        os.close(reading)
        os.close(writing)
