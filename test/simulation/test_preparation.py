"""Preparation before a run: its progress, its failures, and its interruption."""

import signal
import sys
import threading
import time

import pytest

from vibro_ros.process import entry_point
from vibro_ros.simulation import preparation
from vibro_ros.simulation.preparation import Preparation
from vibro_ros.solver.compilation import Progress

PATIENCE = 60.0  # [s]


@pytest.fixture
def progress(monkeypatch) -> Progress:
    """Progress that the test controls, reported without a delay."""
    planted = Progress()
    monkeypatch.setattr(preparation, "progress", planted)
    monkeypatch.setattr(preparation, "REPORTS", 0.0)
    return planted


def test_work_that_compiles_nothing_says_nothing(progress):
    said: list[str] = []
    progress.loaded.append("advance")
    assert Preparation(lambda: 7, said.append).wait() == 7
    assert said == []


def test_how_far_it_is(progress):
    said: list[str] = []
    go_on = threading.Event()
    progress.under_way.append("advance")
    work = Preparation(lambda: go_on.wait(PATIENCE), said.append)
    assert not work.done()
    assert said.pop() == "compiling: the first start after an update takes a minute; Ctrl-C stops it"
    assert not work.done()
    assert said.pop() == "compiling advance, 0 s so far"
    go_on.set()
    assert work.wait() is True


def test_on_a_terminal_one_line_renews_itself(progress, monkeypatch, capsys):
    monkeypatch.setattr(preparation, "RENEWAL", 0.0)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    said: list[str] = []
    go_on = threading.Event()
    progress.under_way.append("advance")
    work = Preparation(lambda: go_on.wait(PATIENCE), said.append)
    assert not any([work.done(), work.done(), work.done()])
    go_on.set()
    work.wait()
    lines = capsys.readouterr().err
    assert len(said) == 1 and lines.startswith("compiling advance, 0 s so far\x1b[K\r" * 2)
    assert lines.endswith("\r\x1b[K\r") and "\n" not in lines


def test_a_python_program_is_told_what_it_waits_for_on_stderr(progress, monkeypatch, capsys):
    told = threading.Event()

    def compile_for_a_while(method):
        assert method == "rk4"
        progress.under_way.append("advance")
        assert told.wait(PATIENCE)

    def say(program, text):
        entry_point.say(program, text)
        if "so far" in text:
            told.set()

    monkeypatch.setattr(preparation, "compiled_methods", set())
    monkeypatch.setattr(preparation, "compile_kernels", compile_for_a_while)
    monkeypatch.setattr(preparation, "say", say)
    preparation.provide_kernels("rk4")
    first, second, *_ = capsys.readouterr().err.splitlines()
    assert first.startswith("vibro_ros: compiling: the first start after an update takes")
    assert second == "vibro_ros: compiling advance, 0 s so far"


def test_kernels_that_cannot_be_kept_are_told_with_a_remedy(progress):
    said: list[str] = []

    def compile_one():
        progress.done.append("advance")
        progress.unwritable = "/full: No space left on device"

    Preparation(compile_one, said.append).wait()
    assert said == ["the compiled kernels cannot be kept: /full: No space left on device; every start compiles them "
                    "again. Set NUMBA_CACHE_DIR to a folder that only you can write and that has room"]
    Preparation(lambda: None, said.append).wait()  # which compiles nothing
    assert len(said) == 1


def test_its_error_is_raised_where_it_is_waited_for(progress):
    def fail():
        raise ValueError("no such scene")

    with pytest.raises(ValueError, match="no such scene"):
        Preparation(fail, print).wait()


def test_an_interrupt_leaves_it_alone(progress):
    released = threading.Event()
    work = Preparation(lambda: released.wait(PATIENCE), print)
    threading.Timer(0.1, signal.raise_signal, [signal.SIGINT]).start()
    begun = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        work.wait()
    assert time.monotonic() - begun < PATIENCE / 2
    released.set()
