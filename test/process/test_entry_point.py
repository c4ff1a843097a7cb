"""Every executable starts and ends in the same way, whatever signals, streams and folders it meets."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from importlib import import_module
from importlib.metadata import entry_points, version
from pathlib import Path

import pytest
from real_processes import takes_signals, wait_until

from vibro_ros.process import entry_point
from vibro_ros.process.executables import EXECUTABLES

PATIENCE = 60.0  # [s] deadline of what takes a second on an idle machine
PROMPT = 10.0  # [s] deadline of what takes a few milliseconds on an idle machine

Start = Callable[..., subprocess.Popen]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    """Return a function that starts an executable in the test's folder; the process is killed at the end."""
    started: list[subprocess.Popen] = []

    def start_one(*words: str, **options: object) -> subprocess.Popen:
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "cwd": tmp_path}
        started.append(subprocess.Popen([sys.executable, *words], **pipes | options))
        return started[-1]

    yield start_one
    for process in started:
        process.kill()
        process.wait()


def module(name: str) -> tuple[str, str]:
    return "-m", EXECUTABLES[name].module


def output_after(process: subprocess.Popen, patience: float = PATIENCE) -> tuple[int, str, str]:
    """Wait for the end; return exit code, stdout and stderr."""
    out, err = process.communicate(timeout=patience)
    return process.returncode, out, err


def test_every_console_script_calls_enter():
    scripts = [script for script in entry_points(group="console_scripts")
               if script.value.startswith("vibro_ros.")]
    assert {script.name for script in scripts} == {
        name for name, executable in EXECUTABLES.items() if executable.installed}
    for script in scripts:
        assert script.value == f"vibro_ros.process.entry_point:{script.name}"
        function = script.load()
        assert (function.func, function.args) == (entry_point.enter, (script.name,))


@pytest.mark.parametrize("name", EXECUTABLES)
def test_help_begins_with_the_sentence_of_the_list_and_version_is_printed(capsys, name):
    executable, output = EXECUTABLES[name], []
    assert executable.does.endswith(".") and len(executable.does) < 100  # one line of a terminal
    for option in ("--help", "--version"):
        with pytest.raises(SystemExit) as ended:
            import_module(executable.module).main([option])
        assert not ended.value.code
        output.append(" ".join(capsys.readouterr().out.split()))
    assert executable.does in output[0]
    assert output[1] == f"{'view' if name == 'live_view' else name} {version('vibro_ros')}"


@pytest.mark.parametrize("name, number, code", [("report", signal.SIGTERM, 143), ("robot", signal.SIGHUP, 0)])
def test_a_signal_during_imports_ends_the_process_with_one_line(start, name, number, code):
    process = start(*module(name), "--help")
    wait_until(lambda: takes_signals(process.pid), "signals taken")
    process.send_signal(number)
    assert output_after(process, PROMPT) == (code, "", f"{name}: stopped while starting\n")


def test_a_signal_while_a_live_view_imports_ros_ends_the_process_with_one_line(start):
    """pybind11 makes an ImportError of a KeyboardInterrupt in the import of rclpy."""
    process = start(*module("view"), "--port", "0")
    wait_until(lambda: "_rclpy_pybind11" in Path(f"/proc/{process.pid}/maps").read_text(), "rclpy's library")
    process.send_signal(signal.SIGINT)
    assert output_after(process, PROMPT) == (0, "", "view: stopped while starting\n")


PROGRAM = """
import signal, sys, threading, time
from types import ModuleType
from vibro_ros.process import entry_point
from vibro_ros.process.executables import Executable
def main(words):
    {main}
sys.modules["planted"] = planted = ModuleType("planted")
planted.main = main
code = entry_point.enter("planted", {{"planted": Executable("planted", False, "")}})
sys.exit(code)
"""
READY = "__import__('os').write(1, b'ready\\n')"  # not by Python's own buffer, in which a signal may meet it
#: Ten minutes in short sleeps, because a signal that comes just before a sleep begins does not interrupt that sleep.
SLEEPS = "[time.sleep(0.01) for _ in range(60_000)]"


def planted_executable(start: Start, *lines: str, **options: object) -> subprocess.Popen:
    """Return an executable whose `main` consists of these lines, once it is ready."""
    process = start("-c", PROGRAM.format(main="\n    ".join([*lines, "return 0"])), **options)
    assert process.stdout.readline() == "ready\n"
    return process


def test_an_interrupt_in_a_text_that_is_executed_gives_the_same_exit_code(start, tmp_path):
    """Python run on a module would end by SIGINT itself, even if the interrupt was caught."""
    (tmp_path / "program.py").write_text(PROGRAM.format(main=f"{READY}; exec('{SLEEPS}')"))
    process = start("-m", "program")
    assert process.stdout.readline() == "ready\n"
    process.send_signal(signal.SIGINT)
    assert output_after(process, PROMPT) == (130, "", "planted: stopped\n")


def test_a_second_signal_ends_a_program_that_swallows_the_first(start):
    process = planted_executable(start, "try:", f"    {READY}", f"    {SLEEPS}", "except KeyboardInterrupt:",
                      "    __import__('os').write(1, b'no\\n')", SLEEPS)
    process.send_signal(signal.SIGTERM)
    assert process.stdout.readline() == "no\n"
    process.send_signal(signal.SIGTERM)
    assert output_after(process, PROMPT) == (143, "", "planted: stopped\n")


REQUEST = ("with entry_point.StopRequest() as stop:", "    {held}", f"    {READY}", "    while {condition}:",
           "        time.sleep(0.01)", "    print('asked', flush=True)", "    time.sleep({rest})", "return 7")


def stoppable_executable(start: Start, held: str = "pass", condition: str = "not stop",
                         rest: float = 0.0) -> subprocess.Popen:
    """Return an executable that waits for a request to stop, and works for `rest` seconds after it."""
    return planted_executable(start, *(line.format(held=held, condition=condition, rest=rest) for line in REQUEST))


def test_a_signal_that_a_finaliser_swallowed_before_is_a_request(start):
    finaliser = f"lambda _: ({READY}, {SLEEPS})"
    process = planted_executable(start, f"type('Dying', (), {{'__del__': {finaliser}}})()", *(
        line.format(held="pass", condition="not stop", rest=0.0) for line in REQUEST))
    process.send_signal(signal.SIGINT)
    code, output, ignored = output_after(process, PROMPT)
    assert (code, output) == (7, "ready\nasked\n") and "Exception ignored" in ignored


def test_a_signal_while_the_context_is_entered_is_a_request(start):
    process = planted_executable(start, "take = entry_point._on_stop_signals", "entry_point._on_stop_signals = lambda "
                                 "receive: (take(receive), signal.raise_signal(signal.SIGTERM))", *(
        line.format(held="pass", condition="not stop", rest=0.0) for line in REQUEST))
    code, _, error = output_after(process, PROMPT)
    assert (code, error) == (7, "")


def test_a_second_signal_ends_a_start_that_does_not_poll(start):
    process = stoppable_executable(start, condition="True")
    process.send_signal(signal.SIGINT)
    process.send_signal(signal.SIGTERM)
    code, _, _ = output_after(process, PROMPT)
    assert code in (130, 143)  # two signals that wait have no order


def test_a_held_resource_is_closed_whatever_signals_come(start):
    process = stoppable_executable(start, held="stop.hold()", rest=0.5)
    process.send_signal(signal.SIGINT)
    assert process.stdout.readline() == "asked\n"
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        process.send_signal(number)
    assert output_after(process, PROMPT) == (7, "", "")


def test_an_ignored_sighup_stays_ignored_and_an_ignored_sigint_does_not(start):
    def as_nohup_in_a_script():
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        signal.signal(signal.SIGINT, signal.SIG_IGN)

    process = planted_executable(start, READY, SLEEPS, preexec_fn=as_nohup_in_a_script)
    process.send_signal(signal.SIGHUP)
    time.sleep(0.2)  # it must not end, however long one waits
    assert process.poll() is None
    process.send_signal(signal.SIGINT)
    assert output_after(process, PROMPT) == (130, "", "planted: stopped\n")


def test_a_thread_that_works_on_does_not_delay_the_end(start):
    process = planted_executable(start, "threading.Thread(target=time.sleep, args=(600,), daemon=True).start()", READY,
                      "sys.stdin.read()", "print('last word', end='')", "return 5", stdin=subprocess.PIPE)
    assert output_after(process, PROMPT) == (5, "last word", "")


@pytest.mark.parametrize("error, code, output", [
    (ValueError("a: b\n  c"), 2, "a: b c"), (RuntimeError("no"), 1, "no"),
    (FileNotFoundError(2, "No such file", "none"), 1, "none: No such file"),
    (MemoryError(), 1, "not enough memory; free some, or give less at a time")])
def test_an_expected_error_is_one_line(capsys, error, code, output):
    def body():
        raise error

    assert entry_point.exit_code("planted", body) == code
    assert capsys.readouterr().err == f"planted: {output}\n"


def test_help_is_printed_on_a_terminal_without_greek_letters(start):
    process = start(*module("robot"), "--help", env={**os.environ, "LC_ALL": "C", "PYTHONIOENCODING": "ascii"})
    code, out, err = output_after(process)
    assert (code, err) == (0, "")
    assert "angle of the inclined guide from the vertical, \\u03c6" in out


def run_shell(command: str, folder: Path) -> subprocess.CompletedProcess:
    return subprocess.run(["bash", "-c", f"set -o pipefail; {command}"], cwd=folder, capture_output=True, text=True,
                          timeout=PATIENCE)


HELP = f"{sys.executable} -m vibro_ros.recordings.recover --help"
STREAMS = {
    "closed pipe": (f"{HELP} | head -0", 0, ""),
    "full disk": (f"{HELP} > /dev/full", 1, "recover: standard output: No space left on device\n"),
    "closed pipe for errors": (f"{sys.executable} -m vibro_ros.recordings.recover none none 2>&1 | head -0", 2, ""),
}


@pytest.mark.parametrize("command, code, output", STREAMS.values(), ids=STREAMS)
def test_missing_streams_and_folders_give_a_line_and_an_exit_code(tmp_path, command, code, output):
    done = run_shell(command, tmp_path)
    assert (done.returncode, done.stderr) == (code, output.format(folder=tmp_path))


def test_without_ros_the_message_names_the_remedy(start):
    program = ("import sys; sys.modules['rclpy'] = None; from vibro_ros.process import entry_point; "
               "sys.exit(entry_point.enter('robot'))")
    code, out, err = output_after(start("-c", program, "--help"))
    assert (code, out) == (1, "")
    assert err == ("robot: rclpy: no such Python module here; ROS 2 is missing. Source an installation of it "
                   "(. /opt/ros/jazzy/setup.bash), or run `make setup` in a clone and then .venv/bin/robot, or add the "
                   "wheels to this Python: pip install '.[ros]' in a clone\n")
