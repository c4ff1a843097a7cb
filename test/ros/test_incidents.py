"""States, pushes and faults that are requested of a running robot: impossible ones are refused in words, all others are
recorded and replayed.
"""

import math

import pytest
from observation import Operator, stop_with_whole_bag, value_of
from simulation_types import require_types
from simulator_user import Code
from std_srvs.srv import SetBool, Trigger
from test_operations import assert_replays, operations_in

from vibro_ros.recordings.summary import as_text, load_samples, summarise

types = pytest.importorskip("vibro_ros_interfaces.srv", reason="the project's own types are not built")
require_types()
entity_types = pytest.importorskip("simulation_interfaces.srv", reason="simulation_interfaces is not built")
RUNNING = ("robot", "--ros-args", "-p", "motor.speed:=100.0")


@pytest.fixture
def let(call):
    """Request something of the robot, check whether it was done, and return the message of the answer."""
    def let_one(name: str, done: bool = True, **request) -> str:
        kind = {"set_state": types.SetState, "push": types.Push, "inject_fault": types.InjectFault}[name]
        answer = call(kind, name, **request)
        assert answer.success == done, answer.message
        return answer.message
    return let_one


def test_a_run_through_a_state_a_push_and_faults_replays_to_the_last_bit(start, bench, call, let, listener, tmp_path):
    robot = start(*RUNNING)
    operator = Operator(bench)
    operator.wait_for_robot()
    let("set_state", names=["body_position", "body_velocity"], values=[0.5, -1.0])
    let("push", force_x=30.0, force_z=20.0, duration=0.0333)
    operator.spin_for_samples(20)
    assert operator.odom().pose.pose.position.x > 0.3
    let("inject_fault", fault="motor_stall", duration=60.0)
    let("inject_fault", fault="plate_stuck", of="upper", duration=0.05)
    operator.command(motor_speed=90.0, upper_gap=0.0004)
    bench.spin_until(lambda: operator.joint("crank")[1] == 0.0, "the stalled motor's stop")
    listener.wait_for_status("simulation", lambda status: any(
        pair.key == "lasting" and pair.value.startswith("motor_stall until") for pair in status.values))
    let("inject_fault", fault="motor_stall", duration=0.0)
    bench.spin_until(lambda: operator.joint("crank")[1] == 90.0, "the last command's speed")
    assert "the robot stands at its start" in let("set_state", names=["body_velocity"], values=[0.5], reset=True)
    bench.spin_until(lambda: operator.joint("crank")[1] == 100.0, "the motor as at the start")
    # while robot time stands still, and ended by a reset
    assert call(SetBool, "pause", data=True).success
    let("push", force_x=-30.0, duration=3600.0)
    assert call(Trigger, "step").success
    assert call(Trigger, "reset").success
    assert call(SetBool, "pause", data=False).success
    # commands that take effect never, and 0.3 s late
    let("inject_fault", fault="lost_commands", duration=60.0)
    operator.command(motor_speed=50.0)
    listener.wait_for_status("simulation", lambda status: value_of(status, "lost commands") == 1.0)
    let("inject_fault", fault="lost_commands", duration=0.0)
    let("inject_fault", fault="late_commands", value=0.3, duration=60.0)
    operator.spin_for_samples(1)
    samples_before = len(operator.heard["odom"])
    operator.command(motor_speed=50.0)
    bench.spin_until(lambda: operator.joint("crank")[1] < 100.0, "the late command in effect")
    assert len(operator.heard["odom"]) - samples_before >= 59  # samples at 200 Hz
    folder = tmp_path / stop_with_whole_bag(robot)
    assert " ".join(text.split()[0] for text in operations_in(folder)) == (
        "state push fault fault fault reset pause push step reset resume fault fault fault")
    summary = summarise(load_samples(folder))
    times, texts = zip(*summary["operations"], strict=True)
    assert list(texts) == operations_in(folder) and sorted(times) == list(times)
    assert all(text in as_text(summary) for text in texts)
    assert_replays(folder, 60)


def test_what_cannot_be_is_refused_in_the_device_s_words_and_the_robot_is_an_entity_with_a_state(
        start, bench, call, let, tmp_path):
    robot = start("robot", "--ros-args", "-p", "frame_prefix:=r1/", "-p", "motor.speed:=50.0")
    operator = Operator(bench)
    operator.wait_for_robot()
    for name, request, words in (
            ("set_state", {"names": ["body_velocity"], "values": []}, "1 names, 1 of them different, and 0 values"),
            ("set_state", {"names": ["mass"], "values": [1.0]}, "'mass': cannot be given; give any of"),
            ("set_state", {}, "a state: no number is given; give any of body_position"),
            ("set_state", {"names": ["upper_position"], "values": [0.5]}, "0.5 m lies beyond the plate at 0.06 m"),
            ("push", {"force_x": 5.0}, "duration: 0 s with a force of 5 N along x"),
            ("inject_fault", {"fault": "lost_commands"}, "duration: 0 s ends a lost_commands, and none lasts"),
            ("push", {"force_x": math.nan, "duration": 1.0}, "force_x: nan is not finite"),
            ("inject_fault", {"fault": "quake\n", "duration": 1.0}, "'quake\\n' is unknown; choose one of motor_stall"),
            ("inject_fault", {"fault": "plate_stuck", "of": "x" * 1000, "duration": 1.0}, "give upper or inclined"),
            ("inject_fault", {"fault": "friction_patch", "duration": 1.0, "value": 999.0, "to_x": 1.0}, "on a patch"),
            ("inject_fault", {"fault": "sensor_freeze", "of": "imu", "duration": 1.0}, "befalls sensors"),
            ("inject_fault", {"fault": "motor_stall", "duration": -math.inf}, "duration: -inf is not finite")):
        answer = let(name, done=False, **request)
        assert words in answer and len(answer) < 600

    def put(entity: str = "vibro_robot", frame: str = "", pose: bool = False, twist: bool = False, **numbers: float):
        state = entity_types.SetEntityState.Request().state
        state.header.frame_id = frame
        state.pose.position.x, state.pose.position.y = numbers.get("x", 0.0), numbers.get("y", 0.0)
        state.pose.orientation.w, state.twist.linear.x = numbers.get("w", 1.0), numbers.get("speed", 0.0)
        return call(entity_types.SetEntityState, "set_entity_state", entity=entity, state=state, set_pose=pose,
                    set_twist=twist).result

    assert put(pose=True, x=5.0, frame="r1/odom").result == Code.OK
    answer = call(entity_types.GetEntityState, "get_entity_state", entity="vibro_robot")
    assert answer.result.result == Code.OK and answer.state.header.frame_id == "r1/odom"
    assert answer.state.pose.position.x == pytest.approx(5.0, abs=0.2)
    assert math.isnan(answer.state.acceleration.linear.x)
    for result, code, words in (
            (put(entity="other", pose=True), Code.NOT_FOUND, "entity: 'other' is not here; give vibro_robot"),
            (put(pose=True, y=1.0), 101, "give y = 0"), (put(pose=True, w=math.nan), 101, "turn"),
            (put(pose=True, x=math.inf), Code.OPERATION_FAILED, "body_position: inf is not finite"),
            (put(), Code.OPERATION_FAILED, "nothing to set"),
            (put(twist=True, frame="map"), Code.OPERATION_FAILED, "give r1/odom")):
        assert result.result == code and words in result.error_message
    other = call(entity_types.GetEntityState, "get_entity_state", entity="")
    assert other.result.result == Code.NOT_FOUND
    folder = tmp_path / stop_with_whole_bag(robot)
    assert operations_in(folder) == ['state {"body_position": 5.0, "body_height": 0.0}']
    assert_replays(folder, 5)


def test_a_script_lets_the_robot_fail_and_ends_where_it_refuses(start, bench, tmp_path):
    robot = start(*RUNNING)
    robot.wait_for("ready")
    (tmp_path / "script.yaml").write_text("""
entries:
  - {motor_speed: 100.0, for: 0.2}
  - {fault: plate_stuck, of: upper, upper_gap: 0.001, for: 0.3}
  - {fault: friction_patch, value: 0.05, from_x: -0.5, to_x: 0.25, for: 0.2}
  - {fault: sensor_freeze, of: imu, for: 0.5}
  - {motor_speed: 50.0, for: 30.0}
""")
    controller = start("controller", "script.yaml")
    controller.wait_for("entry 4: /vibro_robot refuses the fault: fault: sensor_freeze befalls sensors")
    assert controller.end() == 1
    folder = tmp_path / stop_with_whole_bag(robot)
    assert [text for text in operations_in(folder) if text.startswith("fault")] == [
        'fault {"fault": "plate_stuck", "duration": 0.3, "of": "upper", "value": 0.0, "from_x": 0.0, "to_x": 0.0}',
        'fault {"fault": "friction_patch", "duration": 0.2, "of": "", "value": 0.05, "from_x": -0.5, "to_x": 0.25}']
    assert_replays(folder, 50)
