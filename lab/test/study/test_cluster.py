"""A sweep on a Dask cluster of real processes: the bytes are those of one machine, also if a worker is killed."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from vibro_lab.study import execution
from vibro_lab.study.sweep import main

PATIENCE = 60.0  # [s] deadline of what takes a few seconds on an idle machine
WORDS = ["--scene", "unilateral", "--vary", "guide.angle=0.7:1.5:24", "--starts", "3", "--settling", "4",
         "--duration", "20", "--measure", "mean_speed", "upper_impacts"]


@pytest.fixture
def started(tmp_path: Path) -> Iterator:
    """Start one of Dask's programs; all are killed at the end."""
    processes: list[subprocess.Popen] = []

    def start(module: str, *words: str) -> subprocess.Popen:
        with (tmp_path / f"{module}_{len(processes)}.log").open("w") as log:
            processes.append(subprocess.Popen([sys.executable, "-m", f"distributed.cli.{module}", *words], stdout=log,
                                              stderr=log, cwd=tmp_path))
        return processes[-1]

    yield start
    for process in processes:
        process.kill()
        process.wait()


@pytest.fixture
def scheduler(started, tmp_path) -> subprocess.Popen:
    """Start a scheduler on a free port of this machine, which it writes into a file."""
    return started("dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file",
                   str(tmp_path / "scheduler.json"))


@pytest.fixture
def address(scheduler, tmp_path) -> str:
    """Return the scheduler's address."""
    file = tmp_path / "scheduler.json"
    deadline = time.monotonic() + PATIENCE
    while True:
        assert time.monotonic() < deadline and scheduler.poll() is None
        with suppress(OSError, ValueError):  # not there yet, or half of it
            return json.loads(file.read_text())["address"]
        time.sleep(0.02)


def add_worker(started, address) -> subprocess.Popen:
    """Start a worker with one thread."""
    return started("dask_worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1")


def when_begun(blocks: Path) -> int:
    """Wait for the first blocks in a folder; return how many there are."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline and not list(blocks.glob("block_*")):
        time.sleep(0.002)
    return len(list(blocks.glob("block_*")))


def test_a_cluster_of_which_a_worker_is_killed_writes_the_bytes_of_one_machine(
        started, address, bytes_of, tmp_path, monkeypatch):
    monkeypatch.setattr("vibro_lab.study.sweep._BLOCK_TIME", 220.0)
    monkeypatch.setattr(execution, "_CLUSTER_GROUP", (60.0, 256))
    workers = [add_worker(started, address) for _ in range(2)]
    blocks, killed = tmp_path / "there" / "blocks", []

    def kill_one() -> None:
        killed.append(when_begun(blocks))
        os.kill(workers[0].pid, signal.SIGKILL)

    killer = threading.Thread(target=kill_one)
    killer.start()
    assert main([*WORDS, "--scheduler", address, "--output", str(tmp_path / "there")]) == 0
    killer.join()
    assert workers[0].wait(PATIENCE) == -signal.SIGKILL and workers[1].poll() is None
    assert main([*WORDS, "--output", str(tmp_path / "here")]) == 0
    whole = bytes_of(tmp_path / "here")
    assert 0 < killed[0] < sum("block_" in name for name in whole), "the worker was killed before the end"
    assert bytes_of(tmp_path / "there") == whole


def test_workers_that_compute_otherwise_are_refused(started, address, tmp_path, monkeypatch, capsys):
    add_worker(started, address)
    monkeypatch.setattr(execution, "computes_with", lambda: {"processor": "another"})
    assert main([*WORDS, "--duration", "1", "--scheduler", address, "--output", str(tmp_path)]) == 1
    output = capsys.readouterr().err
    assert "a worker of the cluster has another processor" in output and "bits may differ" in output


def test_a_scheduler_that_goes_is_told(started, scheduler, address, tmp_path, monkeypatch, capfd):
    """If the scheduler disappears, the study reports it, nothing hangs, and finished blocks are kept."""
    monkeypatch.setattr("vibro_lab.study.sweep._BLOCK_TIME", 220.0)
    monkeypatch.setattr(execution, "_CLUSTER_GROUP", (60.0, 256))
    add_worker(started, address)
    blocks = tmp_path / "blocks"
    killer = threading.Thread(target=lambda: (when_begun(blocks), scheduler.kill()))
    killer.start()
    assert main([*WORDS, "--scheduler", address, "--output", str(tmp_path)]) == 1
    killer.join()
    assert "the scheduler went away" in capfd.readouterr().err
    assert 0 < len(list(blocks.iterdir())) < 8
