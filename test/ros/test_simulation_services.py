"""A live robot as a simulator to a program that knows simulation_interfaces and nothing of this robot."""

import signal
import textwrap
from pathlib import Path
from types import SimpleNamespace

import pytest
from asking import known_client, wait_until_known
from observation import bags
from simulator_user import Simulator, ended
from std_srvs.srv import SetBool, Trigger

from vibro_ros.ros.node.node import SteadyNode
from vibro_ros.ros.robot.simulation_rules import FEATURES, Code, State
from vibro_ros.ros.robot.simulation_services import NAMES


def test_the_features_are_those_of_what_is_offered(simulator):
    features = simulator.answer(simulator.begin("GetSimulatorFeatures")).features
    assert list(features.features) == sorted({feature for name in NAMES for feature in FEATURES[name]})
    assert list(features.spawn_formats) == []
    assert "publish period" in features.custom_info


def test_states_follow_one_another_as_the_definitions_say(simulator):
    assert simulator.state == State.PLAYING
    assert simulator.become(State.PLAYING) == Code.ALREADY_IN_TARGET_STATE
    assert simulator.become(State.PAUSED) == Code.OK
    assert simulator.state == State.PAUSED
    assert simulator.become(State.PAUSED) == Code.ALREADY_IN_TARGET_STATE
    assert simulator.become(State.STOPPED) == Code.OK
    assert simulator.state == State.STOPPED
    assert simulator.become(State.PAUSED) == Code.INCORRECT_TRANSITION
    assert simulator.call("StepSimulation", steps=1) == (Code.OK, "")
    assert simulator.state == State.PAUSED
    assert simulator.become(State.LOADING_WORLD) == Code.FEATURE_UNSUPPORTED
    assert simulator.become(255) == Code.NOT_FOUND
    assert simulator.become(State.PLAYING) == Code.OK
    assert simulator.state == State.PLAYING
    assert simulator.become(State.STOPPED) == Code.OK
    assert simulator.state == State.STOPPED


def test_the_other_services_lead_to_the_same_states(simulator, bench):
    pause, reset = known_client(bench, SetBool, "pause"), known_client(bench, Trigger, "reset")
    assert simulator.answer(pause.call_async(SetBool.Request(data=True))).success
    assert simulator.state == State.PAUSED
    assert simulator.answer(reset.call_async(Trigger.Request())).success
    assert simulator.state == State.STOPPED


def test_a_reset_puts_the_state_back_and_lets_the_clock_go_on(simulator, listener):
    listener.spin_for_samples(20)
    assert simulator.call("ResetSimulation", scope=2) == (Code.OK, "")
    assert simulator.state == State.PLAYING
    assert simulator.become(State.PAUSED) == Code.OK
    for scope in (0, 2, 255):
        simulator.call("StepSimulation", steps=3)
        assert simulator.state == State.PAUSED
        assert simulator.call("ResetSimulation", scope=scope) == (Code.OK, "")
        assert simulator.state == State.STOPPED
    for scope, code in ((1, Code.FEATURE_UNSUPPORTED), (4, Code.FEATURE_UNSUPPORTED), (8, Code.NOT_FOUND)):
        simulator.call("StepSimulation", steps=1)
        assert simulator.call("ResetSimulation", scope=scope)[0] == code
        assert simulator.state == State.PAUSED
    assert all(earlier < later for earlier, later in zip(listener.stamps, listener.stamps[1:], strict=False))


def test_without_the_package_one_line_says_so(start, tmp_path, monkeypatch):
    shadow(monkeypatch, tmp_path, "raise ImportError('not here')")
    robot = start("robot")
    robot.wait_for("ready: ")
    said = [line.split("]: ")[1] for line in robot.lines if "simulation_interfaces" in line]
    assert said == ["simulation_interfaces is not installed: without " + ", ".join(NAMES.values())]
    robot.send(signal.SIGINT)
    ended(robot)
    assert len(bags(tmp_path)) == 1


def test_a_type_that_is_missing_is_left_out_of_the_features(types, bench, start, tmp_path, monkeypatch):
    real = Path(types.srv.__file__).parents[1]
    package = shadow(monkeypatch, tmp_path, f"__path__.append({str(real)!r})")
    (package / "action.py").write_text("")
    robot = start("robot")
    robot.wait_for("ready: ")
    said = [line.split("]: ")[1] for line in robot.lines if "simulation_interfaces" in line]
    assert said == ["simulation_interfaces lacks SimulateSteps: without ~/simulate_steps"]
    simulator = Simulator(bench, types)
    client = simulator.clients["GetSimulatorFeatures"]
    bench.spin_until(client.service_is_ready, "service")
    wait_until_known(bench)
    features = simulator.answer(simulator.begin("GetSimulatorFeatures")).features.features
    assert list(features) == sorted({feature for name in simulator.clients for feature in FEATURES[name]})
    simulator.action.destroy()
    robot.send(signal.SIGINT)
    ended(robot)


def shadow(monkeypatch, folder: Path, text: str) -> Path:
    """Let robots find another package simulation_interfaces first."""
    package = folder / "shadow" / "simulation_interfaces"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(textwrap.dedent(text))
    monkeypatch.setenv("PYTHONPATH", str(package.parent), prepend=":")
    return package


def test_a_callback_that_fails_is_answered_all_the_same(types):
    async def fail(request, response):
        raise KeyError("nobody foresaw it")

    caught: list[str] = []
    node = SimpleNamespace(refusals=SimpleNamespace(catch=lambda name, error: caught.append(name)),
                           _counted=lambda name, response: response)
    kind = types.srv.StepSimulation
    answering = SteadyNode._answer_later(node, "/step", fail, kind.Request(), kind.Response())
    with pytest.raises(StopIteration) as end:
        answering.send(None)
    result = end.value.value.result
    assert (result.result, result.error_message) == (Code.OPERATION_FAILED, "KeyError; the node's log says more")
    assert caught == ["/step"]
