"""Requests of a running robot: reset, pause, step, parameters, states, pushes and faults, with their effect on stamps,
state and bag; impossible ones are refused in words, all others are recorded and replayed.
"""

import math
import signal
from pathlib import Path

import pytest
from nav_msgs.msg import Odometry
from observation import PERIOD, Operator, bags, stop_with_whole_bag, value_of
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from simulator_user import Code
from std_srvs.srv import SetBool, Trigger

from vibro_ros.bag.reader import read_bag
from vibro_ros.bag.stream import BagStream
from vibro_ros.recordings.comparison import compare
from vibro_ros.recordings.summary import as_text, load_samples, summarise


def done(answer) -> str:
    assert answer.success, answer.message
    return answer.message


def number(name: str, value: float) -> ParameterMessage:
    return Parameter(name, value=value).to_parameter_msg()


def stamps_and_places(operator: Operator) -> list[tuple[int, float]]:
    """Stamp [ns] and body position [m] of every received odometry message."""
    heard = [deserialize_message(data, Odometry) for data in operator.heard["odom"]]
    return [(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec, message.pose.pose.position.x)
            for message in heard]


def operations_in(folder: Path) -> list[str]:
    return list(read_bag(folder)["operations"]["text"])


def assert_replays(folder: Path, samples: int, commands: int = 0) -> None:
    with BagStream(folder) as stream:
        comparison = compare(stream)
    assert comparison.difference is None, str(comparison.difference)
    assert comparison.compared["/odom"] >= samples and not comparison.missing
    assert comparison.commands >= commands


def test_a_run_with_every_operation_replays_to_the_last_bit(start, bench, call, tmp_path):
    robot = start("robot", "--ros-args", "-p", "motor.speed:=100.0")
    operator = Operator(bench)
    operator.wait_for_robot()
    assert "not paused" in call(Trigger, "step").message
    operator.spin_for_samples(40)
    answer = done(call(SetBool, "pause", data=True))
    assert answer.startswith("paused at")
    done(call(SetBool, "pause", data=True))
    angle = 100.0 * float(answer.split()[2])  # [rad] of the crank then: it has turned at 100 rad/s from the start
    bench.spin_until(lambda: abs(operator.joint("crank")[0] - angle) < 1e-3, "the joints of the last sample")
    last = deserialize_message(operator.heard["joint_states"][-1], JointState).header.stamp
    bench.spin_until(lambda: operator.odom().header.stamp == last, "the odometry of the last sample")
    samples_before = len(operator.heard["odom"])
    operator.command(motor_speed=120.0)  # of the same instant as the pause
    for _ in range(3):
        done(call(Trigger, "step"))
    bench.spin_until(lambda: len(operator.heard["odom"]) == samples_before + 3, "three samples")
    bench.spin_until(lambda: operator.joint("crank")[1] > 100.0, "the command in effect")
    done(call(Trigger, "reset"))  # which shows the start, and takes a period
    bench.spin_until(lambda: len(operator.heard["odom"]) == samples_before + 4, "the start")
    bench.spin_until(lambda: operator.joint("crank")[:2] == (0.0, 100.0), "the start's crank")
    assert stamps_and_places(operator)[-1][1] == 0.0
    results = call(SetParameters, "set_parameters", parameters=[number("ground.friction", 0.1)]).results
    assert results[0].successful, results[0].reason
    assert done(call(SetBool, "pause", data=False)) == "running"
    operator.spin_for_samples(40)
    operator.command(motor_speed=80.0, upper_gap=0.0005)
    operator.spin_for_samples(20)
    result = call(SetParametersAtomically, "set_parameters_atomically", parameters=[
        number("ground.friction", 0.15), number("motor.acceleration", 500.0),
        number("rate.real_time_factor", 2.0)]).result
    assert result.successful, result.reason
    operator.spin_for_samples(40)
    done(call(Trigger, "reset"))
    operator.spin_for_samples(40)
    folder = tmp_path / stop_with_whole_bag(robot)

    stamps, places = zip(*stamps_and_places(operator), strict=True)
    assert {after - stamp for stamp, after in zip(stamps, stamps[1:], strict=False)} == {PERIOD}
    assert places.count(0.0) >= 2  # the starts
    assert operations_in(folder) == [
        "pause", "step 1", "step 1", "step 1", "reset", 'set {"ground.friction": 0.1}', "resume",
        'set {"ground.friction": 0.15, "motor.acceleration": 500.0, "rate.real_time_factor": 2.0}', "reset"]
    assert_replays(folder, 180)


def test_a_refused_set_changes_nothing_and_a_bag_begun_later_replays_from_its_checkpoint(
        start, bench, call, listener, record, tmp_path):
    robot = start("robot", "--ros-args", "-p", "motor.speed:=100.0", "-p", "record.enabled:=false")
    operator = Operator(bench)
    operator.wait_for_robot()
    names = ["ground.friction", "motor.max_speed", "mass.body"]
    values_before = call(GetParameters, "get_parameters", names=names).values
    for wanted, words in (
            ([number("ground.friction", 0.1), number("motor.max_speed", -1.0)], "-1 is out of range"),
            ([number("ground.friction", 0.1), number("motor.max_speed", 50.0)], "the limit is motor.max_speed"),
            ([number("ground.friction", 0.1), number("mass.body", 2.0)], "read-only while the node runs"),
            ([number("ground.friction", 1e3)], "Painlevé's paradox")):
        answers = call(SetParameters, "set_parameters", parameters=wanted).results
        assert not any(answer.successful for answer in answers)
        assert all(words in answer.reason for answer in answers)
    assert call(GetParameters, "get_parameters", names=names).values == values_before
    answers = call(SetParameters, "set_parameters", parameters=[
        number("ground.friction", 0.1), number("mass.body", 1.0)]).results
    assert [answer.successful for answer in answers] == [True, True]  # 1 kg is what the body has
    listener.wait_for_status("simulation", lambda status: value_of(status, "refused requests") == 4.0)
    operator.spin_for_samples(20)
    done(call(Trigger, "reset"))
    operator.spin_for_samples(30)
    assert record(True)[0]
    operator.spin_for_samples(30)
    done(call(Trigger, "reset"))
    operator.spin_for_samples(30)
    stop_with_whole_bag(robot)
    (folder,) = bags(tmp_path)
    assert operations_in(folder) == ["reset"]  # the checkpoint has the friction that was set before
    assert_replays(folder, 50)


def test_clock_has_the_time_of_each_sample_and_resets_give_the_same_bits(
        start, bench, call, tmp_path):
    robot = start("robot", "--ros-args", "-p", "clock.publish:=true", "-p", "use_sim_time:=true", "-p",
                  "rate.publish:=50.0", "-p", "motor.speed:=100.0", "-p", "rate.real_time_factor:=0.5")
    heard: list[tuple[str, int]] = []

    def hear(name: str, stamp) -> None:
        heard.append((name, stamp.sec * 10**9 + stamp.nanosec))

    bench.node.create_subscription(Odometry, "odom", lambda message: hear("odom", message.header.stamp), 100)
    bench.node.create_subscription(Clock, "/clock", lambda message: hear("clock", message.clock), 100)
    bench.spin_until(lambda: {name for name, _ in heard} == {"odom", "clock"}, "both topics")
    heard.clear()
    bench.spin_until(lambda: len(heard) > 60, "30 samples")
    for name in ("odom", "clock"):
        stamps = [stamp for topic, stamp in heard if topic == name]
        assert {after - stamp for stamp, after in zip(stamps, stamps[1:], strict=False)} == {20_000_000}
    assert max(stamp for _, stamp in heard) < 60 * 10**9  # robot time, not the wall clock's
    odometry: list[Odometry] = []
    done(call(SetBool, "pause", data=True))
    bench.node.create_subscription(Odometry, "odom", odometry.append, QoSProfile(depth=1000))
    bench.spin_until(lambda: bench.node.count_subscribers("odom") == 2, "the second subscription")
    for _ in range(2):
        done(call(Trigger, "reset"))
        for _ in range(25):
            done(call(Trigger, "step"))
    bench.spin_until(lambda: len(odometry) >= 52, "26 samples of each")
    first, second = odometry[-52:-26], odometry[-26:]
    assert [message.pose for message in first] == [message.pose for message in second]
    assert [message.twist for message in first] == [message.twist for message in second]
    folder = tmp_path / stop_with_whole_bag(robot)
    with BagStream(folder) as stream:
        assert stream.start == 0
    assert_replays(folder, 30)


def test_the_motor_stops_without_commands_at_the_same_instant_as_in_the_replay(start, bench, listener, tmp_path):
    robot = start("robot", "--ros-args", "-p", "command.timeout:=0.1")
    operator = Operator(bench)
    operator.wait_for_robot()
    for speed in (50.0, 60.0, 70.0):  # commands in time keep it running
        operator.command(motor_speed=speed)
        operator.spin_for_samples(5)
    robot.wait_for("command.timeout: no command of the motor on /motor_speed or /joint_commands for 0.1 s")
    bench.spin_until(lambda: operator.joint("crank")[1] == 0.0, "the motor's stop")
    listener.wait_for_status("simulation", lambda status: value_of(status, "stops by command.timeout") >= 1.0)
    operator.command(motor_speed=30.0)
    bench.spin_until(lambda: operator.joint("crank")[1] > 0.0, "the motor running again")
    bench.spin_until(lambda: operator.joint("crank")[1] == 0.0, "the motor's next stop")
    folder = tmp_path / stop_with_whole_bag(robot)
    assert set(operations_in(folder)) == {"timeout"}
    assert_replays(folder, 40)


def test_operations_and_signals_work_at_the_lowest_rate(start, call):
    robot = start("robot", "--ros-args", "-p", "rate.publish:=0.1", "-p", "motor.speed:=50.0")
    robot.wait_for("ready")
    assert "the sample at 10 s of robot time" in done(call(Trigger, "reset"))  # long before that sample
    done(call(SetBool, "pause", data=True))
    assert "to 10 s" in done(call(Trigger, "step"))
    stop_with_whole_bag(robot, signal.SIGTERM)


RUNNING = ("robot", "--ros-args", "-p", "motor.speed:=100.0")


@pytest.fixture
def let(call):
    """Request something of the robot, check whether it was done, and return the message of the answer."""
    types = pytest.importorskip("vibro_ros_interfaces.srv", reason="the project's own types are not built")

    def let_one(name: str, done: bool = True, **request) -> str:
        kind = {"set_state": types.SetState, "push": types.Push, "inject_fault": types.InjectFault}[name]
        answer = call(kind, name, **request)
        assert answer.success == done, answer.message
        return answer.message
    return let_one


def test_a_run_with_a_state_a_push_and_faults_replays_to_the_last_bit(start, bench, call, let, listener, tmp_path):
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


def test_impossible_disturbances_are_refused_and_the_robot_has_an_entity_state(
        start, bench, call, let, types, tmp_path):
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
        state = types.srv.SetEntityState.Request().state
        state.header.frame_id = frame
        state.pose.position.x, state.pose.position.y = numbers.get("x", 0.0), numbers.get("y", 0.0)
        state.pose.orientation.w, state.twist.linear.x = numbers.get("w", 1.0), numbers.get("speed", 0.0)
        return call(types.srv.SetEntityState, "set_entity_state", entity=entity, state=state, set_pose=pose,
                    set_twist=twist).result

    assert put(pose=True, x=5.0, frame="r1/odom").result == Code.OK
    answer = call(types.srv.GetEntityState, "get_entity_state", entity="vibro_robot")
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
    other = call(types.srv.GetEntityState, "get_entity_state", entity="")
    assert other.result.result == Code.NOT_FOUND
    folder = tmp_path / stop_with_whole_bag(robot)
    assert operations_in(folder) == ['state {"body_position": 5.0, "body_height": 0.0}']
    assert_replays(folder, 5)


def test_a_script_starts_faults_and_ends_where_the_robot_refuses_one(start, let, tmp_path):
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
