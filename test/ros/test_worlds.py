"""A live robot that goes into other scenes, as a program asks that knows simulation_interfaces and nothing of it."""

import json
import signal
from pathlib import Path

import pytest
from asking import answer_of
from observation import bags, stamps_of, whole_bag
from operated_robot import stop
from rcl_interfaces.srv import GetParameters
from rclpy.serialization import serialize_message
from simulator_user import Simulator
from std_msgs.msg import Float64, String

from vibro_ros import load_scene
from vibro_ros.bag.metadata import Topic, read_metadata
from vibro_ros.bag.writer import Storage
from vibro_ros.configuration.scene_file import shipped_scenes
from vibro_ros.recordings import replay
from vibro_ros.ros.node import qos
from vibro_ros.ros.robot.recording import Plan, open_recording
from vibro_ros.ros.robot.services import Code, State
from vibro_ros.ros.robot.worlds import NO_RESOURCE, RESOURCE_PARSE_ERROR, UNSUPPORTED_ELEMENTS

HEAVY = "/**:\n  ros__parameters:\n    scene: device\n    mass.body: 2.5\n"


def resource(types, uri: str = "", text: str = ""):
    return types.msg.Resource(uri=uri, resource_string=text)


def current(simulator) -> tuple[str, str, str]:
    """Name, uri and text of the world that the robot says it is in."""
    world = simulator.answer(simulator.begin("GetCurrentWorld")).world
    return world.name, world.world_resource.uri, world.world_resource.resource_string


def load(simulator, types, **given) -> tuple[int, str]:
    return simulator.call("LoadWorld", world_resource=resource(types, **given))


def parameter(bench, name: str):
    (value,) = answer_of(bench, GetParameters, "/vibro_robot/get_parameters", names=[name]).values
    return value


def custom_data(bag: Path) -> dict[str, str]:
    return read_metadata(bag)["custom_data"]


def test_worlds_are_the_shipped_scenes_and_the_robot_says_which_it_is_in(simulator, types):
    answer = simulator.answer(simulator.begin("GetAvailableWorlds"))
    assert answer.result.result == Code.OK
    assert [world.name for world in answer.worlds] == [world.world_resource.uri for world in answer.worlds]
    assert {world.name for world in answer.worlds} == set(shipped_scenes())
    assert all(world.description and "\n" not in world.description for world in answer.worlds)
    assert current(simulator) == ("device", "device", "")
    asked = types.msg.TagsFilter(tags=["indoor"])
    assert simulator.call("GetAvailableWorlds", filter=asked)[0] == Code.FEATURE_UNSUPPORTED
    code, words = simulator.call("GetAvailableWorlds", additional_sources=["file:///etc"])
    assert code == Code.FEATURE_UNSUPPORTED and "'file:///etc' is not searched" in words
    assert simulator.call("GetAvailableWorlds", additional_sources=["file:///etc"],
                          continue_on_error=True) == (Code.OK, "")


def test_a_running_robot_goes_into_another_scene_and_each_bag_replays_to_the_bit(simulator, types, listener, bench,
                                                                                 tmp_path):
    described = []
    bench.node.create_subscription(String, "robot_description", lambda one: described.append(one.data), qos.LASTING)
    bench.spin_until(lambda: described, "the first description")
    publisher = bench.node.create_publisher(Float64, "motor_speed", 10)
    bench.spin_until(publisher.get_subscription_count, "the robot listens")
    publisher.publish(Float64(data=120.0))
    listener.spin_for_samples(60)
    assert load(simulator, types, uri="damped") == (Code.OK, "")
    assert simulator.state == State.STOPPED
    assert current(simulator) == ("damped", "damped", "")
    assert parameter(bench, "scene").string_value == "damped"
    assert parameter(bench, "effects.motor").string_value == load_scene("damped")["effects.motor"] != "ramp"
    assert simulator.call("StepSimulation", steps=30) == (Code.OK, "")
    assert load(simulator, types, text=HEAVY) == (Code.OK, "")  # from PAUSED
    assert current(simulator) == ("resource_string", "", HEAVY)
    assert parameter(bench, "mass.body").double_value == 2.5
    assert parameter(bench, "scene").string_value == "device"  # which the text changes
    bench.spin_until(lambda: len(set(described)) == 2 and 'value="2.5"' in described[-1], "the description of the mass")
    assert simulator.become(State.PLAYING) == Code.OK
    publisher.publish(Float64(data=90.0))
    listener.spin_for_samples(60)
    assert simulator.call("ResetSimulation", scope=0) == (Code.OK, "")
    listener.spin_for_samples(20)
    stop(simulator.robot)
    recorded = sorted(bags(tmp_path))
    by_scene = {custom_data(bag)["scene"]: bag for bag in recorded}
    assert list(by_scene) == ["device", "damped", "resource_string"]
    assert json.loads(custom_data(by_scene["resource_string"])["parameters"])["mass.body"] == 2.5
    assert len(stamps_of(by_scene["damped"])) == 31
    stamps = [stamp for bag in recorded for stamp in stamps_of(bag)]
    assert all(earlier < later for earlier, later in zip(stamps, stamps[1:], strict=False))
    assert f"; {(len(stamps) - len(recorded)) / 200.0:.3f} s simulated, " in simulator.robot.lines[-1]  # in all worlds
    for bag in recorded:
        assert replay.main([str(bag)]) == 0


def test_what_cannot_be_loaded_is_refused_in_a_line_and_changes_nothing(simulator, types, listener, tmp_path):
    own = tmp_path / "own.yaml"
    own.write_text(HEAVY)
    head = "/**:\n  ros__parameters:\n"
    bomb = "a: &a [x]\nb: [*a, *a]\n"
    for given, code, words in (
            ({}, NO_RESOURCE, "uri and resource_string are empty"),
            ({"uri": "nowhere"}, Code.NOT_FOUND, "uri: 'nowhere' is no shipped scene; give one of"),
            ({"uri": str(own)}, Code.NOT_FOUND, "is no shipped scene"),
            ({"uri": "/etc/passwd", "text": HEAVY}, Code.NOT_FOUND, "is no shipped scene"),  # a uri counts first
            ({"uri": "x\ny" * 10_000}, Code.NOT_FOUND, "…"),
            ({"text": bomb}, RESOURCE_PARSE_ERROR, "the alias *a"),
            ({"text": "[" * 100_000}, RESOURCE_PARSE_ERROR, "nested more than 32 deep"),
            ({"text": "#" * 2**21}, RESOURCE_PARSE_ERROR, "give at most 1048576"),
            ({"text": "{"}, RESOURCE_PARSE_ERROR, "not YAML"),
            ({"text": head + "    scene: /etc/passwd\n"}, RESOURCE_PARSE_ERROR, "'/etc/passwd' is no shipped scene"),
            ({"text": head + "    mass.body: -1.0\n"}, RESOURCE_PARSE_ERROR, "mass.body"),
            ({"text": head + "    no.such: 1.0\n"}, RESOURCE_PARSE_ERROR, "no.such"),
            ({"text": "/other:\n  ros__parameters:\n    mass.body: 2.0\n"}, RESOURCE_PARSE_ERROR, "/vibro_robot"),
            ({"uri": "machine"}, Code.OPERATION_FAILED, "has other commands and topics of the motor"),
            ({"text": head + "    sensors.imu.rate: 100.0\n"}, Code.OPERATION_FAILED, "has other sensors"),
            ({"uri": "no_impact"}, Code.OPERATION_FAILED, "has other joints")):
        found, why = load(simulator, types, **given)
        assert (found, words in why, "\n" in why, len(why) < 700) == (code, True, False, True), why
    strict = head + "    rate.publish: 100.0\n    mass.body: 2.0\n"
    code, why = simulator.call("LoadWorld", world_resource=resource(types, text=strict),
                               fail_on_unsupported_element=True)
    assert code == UNSUPPORTED_ELEMENTS and why.startswith("rate.publish: ")
    assert current(simulator) == ("device", "device", "") and simulator.state == State.PLAYING
    # nor while steps are taken, and of two that come together one waits for nobody
    simulator.become(State.PAUSED)
    steps = simulator.begin_many_steps(listener)
    assert load(simulator, types, uri="rigid")[0] == Code.INCORRECT_STATE
    simulator.become(State.STOPPED)
    simulator.answer(steps)
    together = [simulator.begin("LoadWorld", world_resource=resource(types, uri=uri)) for uri in ("rigid", "paper")]
    codes = sorted(simulator.answer(future).result.result for future in together)
    assert codes in ([Code.OK, Code.INCORRECT_STATE], [Code.OK, Code.OK])
    stop(simulator.robot)
    for bag in bags(tmp_path):
        assert replay.main([str(bag)]) == 0


@pytest.mark.parametrize("word", ["record.enabled:=false", "record.snapshot:=5.0", "record.max_bytes:=1e9"])
def test_a_change_of_scene_begins_no_bag_that_was_not_asked_for_and_loses_none(word, types, start, bench, listener,
                                                                               record, tmp_path):
    robot = start("robot", "--ros-args", "-p", word, "-p", "motor.speed:=100.0", "-p", "clock.publish:=true")
    simulator = Simulator(bench, types)
    simulator.wait()
    listener.spin_for_samples(100)
    assert load(simulator, types, uri="unilateral") == (Code.OK, "")
    assert simulator.become(State.PLAYING) == Code.OK
    listener.spin_for_samples(30)
    assert record(True)[0]
    listener.spin_for_samples(30)
    stop(robot)
    simulator.action.destroy()
    scenes = [custom_data(bag)["scene"] for bag in sorted(bags(tmp_path))]
    assert scenes == (["unilateral"] if word == "record.enabled:=false" else ["device", "unilateral"])
    assert listener.stamps == sorted(set(listener.stamps))
    for bag in bags(tmp_path):
        assert replay.main([str(bag)]) == 0


def test_where_no_bag_can_begin_the_present_one_goes_on(bench, tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError("cannot record to bags: No space left on device")

    plan = Plan(tmp_path, (Topic("/motor_power", "std_msgs/msg/Float64", 1),), Storage(), {"scene": "device"})
    message = serialize_message(Float64(data=1.0))
    with open_recording(plan, True, bench.node.get_logger()) as recording:
        recording.record("/motor_power", 1, message)
        bag = recording.latest
        with monkeypatch.context() as patch, pytest.raises(ValueError, match="^record.directory: cannot .* No space"):
            patch.setattr("vibro_ros.ros.robot.recording.Recorder", full)
            recording.begin_run({"scene": "rigid"})
        recording.record("/motor_power", 2, message)
        assert recording.latest is bag
        recording.begin_run({"scene": "rigid"})
        recording.record("/motor_power", 3, message)
        with pytest.raises(ValueError, match="^more than 5 bags were asked for at once"):
            for _ in range(10):
                recording.begin_run({"scene": "rigid again"})
    found = {custom_data(folder)["scene"]: stamps_of(folder, "/motor_power") for folder in bags(tmp_path)}
    assert found == {"device": [1, 2], "rigid": [3], "rigid again": []}


def test_who_waits_for_a_world_when_the_robot_ends_is_answered(simulator, types):
    future = simulator.begin("LoadWorld", world_resource=resource(types, uri="rigid"))
    simulator.robot.send(signal.SIGINT)
    assert simulator.answer(future).result.result in (Code.OK, Code.INCORRECT_STATE, Code.OPERATION_FAILED)
    whole_bag(simulator.robot)
