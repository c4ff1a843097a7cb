"""Real processes and a real rclpy node for the tests of this folder, each with an end of its own."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
from asking import call
from observation import Listener
from page_client import PageClient
from random_run import FASTER, record_run
from real_processes import Executable, bench, refusal, start, udp_only
from simulation_types import require_types
from simulator_user import SimulationClient
from std_srvs.srv import SetBool
from web_client import address_of

__all__ = ["bench", "call", "refusal", "start", "udp_only"]


@pytest.fixture
def record(call):
    """Call the robot's service ~/record; returns whether it succeeded, and the answer's message."""
    def record_or_not(on: bool) -> tuple[bool, str]:
        answer = call(SetBool, "record", data=on)
        return answer.success, answer.message
    return record_or_not


@pytest.fixture
def listener(bench):
    return Listener(bench)


@pytest.fixture(scope="session")
def shelf(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("recorded")


@pytest.fixture
def recorded(request, shelf, tmp_path) -> Path:
    """A copy of a recording that the first test to request it makes."""
    if not list(shelf.glob("vibro_robot_*")):
        record_run(request.getfixturevalue("start"), request.getfixturevalue("bench"), shelf,
                   f"rate.real_time_factor:={FASTER}")
    (bag,) = shelf.glob("vibro_robot_*")
    return Path(shutil.copytree(bag, tmp_path / bag.name))


@pytest.fixture
def view(start) -> Executable:
    """A live view, at a port that is free."""
    return start("live_view", "--port", "0")


@pytest.fixture
def visit(start) -> Iterator[Callable[[Executable], PageClient]]:
    """Open a page of a view; pages are closed at the end of the test, before the view is killed."""
    pages: list[PageClient] = []

    def visit_view(view: Executable) -> PageClient:
        pages.append(PageClient(address_of(view)))
        return pages[-1]

    yield visit_view
    for page in pages:
        page.close()


@pytest.fixture
def types() -> SimpleNamespace:
    """The modules of simulation_interfaces, which are not installed without a compiler."""
    require_types()
    return SimpleNamespace(**{name: pytest.importorskip(f"simulation_interfaces.{name}")
                              for name in ("msg", "srv", "action")})


@pytest.fixture
def simulator(types, start, bench) -> Iterator[SimulationClient]:
    """A program that uses simulation_interfaces, with its robot as `robot`."""
    simulator = SimulationClient(bench, types)
    simulator.robot = start("robot")
    simulator.wait()
    yield simulator
    simulator.action.destroy()
