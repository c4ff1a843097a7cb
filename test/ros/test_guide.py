"""docs/guide compared with running robots: a name that only one of them has is an error in one of them."""

from functools import partial

import guide
from asking import answer_of
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from observation import bags, stop
from rcl_interfaces.srv import ListParameters
from rclpy.action import get_action_server_names_and_types_by_node
from rclpy.qos import ReliabilityPolicy
from sensor_msgs.msg import JointState

from vibro_ros.bag.reader import read_bag
from vibro_ros.configuration.parameter_file import own_parameters
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.messages.topics import OF_DC_MOTOR, SENSOR_TOPICS
from vibro_ros.messages.urdf import robot_joints
from vibro_ros.ros.robot.services import installed_types

NODE, PACKAGE = "vibro_robot", "simulation_interfaces"
OF_RCLPY = {"parameter_events", "rosout"}
OF_ACTIONS = "/_action/"  # in the names of the topics and services that make up an action
SERVICES_OF_RCLPY = {"describe_parameters", "get_parameter_types", "get_parameters", "get_type_description",
                     "list_parameters", "set_parameters", "set_parameters_atomically"}
KINDS_OF_ROBOT = [  # parameters of each robot, and the solver that its custom data name
    (("solver.method:=rk4", "solver.step:=5.0e-5"), "rk4, step 5e-05 s"),
    (("rate.real_time_factor:=0.0", "solver.accounts:=true"), "exact")]


def parameters(words) -> list[str]:
    return [word for text in ("motor.speed:=100.0", *words) for word in ("-p", text)]


def documented_topics() -> dict[str, tuple[str, str]]:
    """Direction and type of each topic of a robot that publishes no clock, by its name in the graph without `/`."""
    rows = guide.table("topic", "direction", "type", "depth", "content")
    return {guide.names(name)[0].replace("~", NODE).lstrip("/"): (direction, kind)
            for name, direction, kind, _, content in rows if "`clock.publish` only" not in content}


def names_by_node(names_and_kinds) -> dict[str, str]:
    type_of = {name.lstrip("/"): kind for name, [kind] in names_and_kinds}
    return {name: kind for name, kind in type_of.items()
            if name.removeprefix(f"{NODE}/") not in OF_RCLPY | SERVICES_OF_RCLPY and OF_ACTIONS not in name}


def documented_controls() -> dict[str, dict[str, str]]:
    """Type of each service and action of `simulation_interfaces` that can be offered here, by its kind and name."""
    rows = guide.table("name", "type", "does")
    installed = installed_types(PACKAGE, [kind.partition("/")[2] for _, kind, _ in rows])
    named = {kind: {guide.names(name)[0].replace("~", NODE): f"{PACKAGE}/{of_package}" for name, of_package, _ in rows
                    if of_package.startswith(f"{kind}/") and of_package.partition("/")[2] in installed}
             for kind in ("srv", "action")}
    assert sum(map(len, named.values())) == len(installed)
    return named


def test_topics_services_parameters_joints_and_frames_are_those_of_a_running_robot(start, bench):
    robot = start("robot", "--ros-args", "-p", "record.enabled:=false", *parameters(()))
    robot.wait_for("ready:")
    topics = {name: topic for name, topic in documented_topics().items()
              if name not in (*OF_DC_MOTOR, *SENSOR_TOPICS.values())}
    published, subscribed = ({name: kind for name, (direction, kind) in topics.items() if direction == wanted}
                             for wanted in ("out", "in"))
    rows = guide.table("service", "type", "does")
    controls = documented_controls()
    services = {guide.names(name)[0].replace("~", NODE): kind for name, kind, _ in rows} | controls["srv"]
    the_graph_becomes(bench, (published, subscribed, services, controls["action"]))
    for name in topics:
        reliability_is_documented(bench, name)
    names = answer_of(bench, ListParameters, f"/{NODE}/list_parameters").result.names
    rows = guide.first_column("name", "default", "unit", "allowed", "meaning")
    rows += guide.first_column("name", "default", "`device`", "unit", "allowed", "meaning")
    assert set(own_parameters(dict.fromkeys(names))) == set(rows)
    joints_and_frames_are_documented(bench, robot)


def the_graph_becomes(bench, documented: tuple[dict[str, str], ...]) -> None:
    """Wait until the robot has the documented publishers, subscriptions, services and actions, and no others."""
    def graph() -> tuple[dict[str, str], ...]:
        return tuple(names_by_node(ask(NODE, "/")) for ask in (
            bench.node.get_publisher_names_and_types_by_node, bench.node.get_subscriber_names_and_types_by_node,
            bench.node.get_service_names_and_types_by_node,
            partial(get_action_server_names_and_types_by_node, bench.node)))

    def is_documented() -> bool:
        try:
            return graph() == documented
        except RuntimeError:  # NodeNameNonExistentError: not discovered yet
            return False

    try:
        bench.spin_until(is_documented, "the documented topics and services", patience=20.0)
    except AssertionError:
        assert graph() == documented


def reliability_is_documented(bench, name: str) -> None:
    endpoints = [*bench.node.get_publishers_info_by_topic(f"/{name}"),
                 *bench.node.get_subscriptions_info_by_topic(f"/{name}")]
    reliabilities = [endpoint.qos_profile.reliability for endpoint in endpoints if endpoint.node_name == NODE]
    rows = guide.table("topic", "direction", "type", "depth", "content")
    is_best_effort = any(f"`{name}`" in row[0] and "best effort" in row[4] for row in rows)
    assert reliabilities == [ReliabilityPolicy.BEST_EFFORT if is_best_effort else ReliabilityPolicy.RELIABLE], name


def joints_and_frames_are_documented(bench, robot) -> None:
    latest = {"odom": None, "joint_states": None, "ground_contact": None, "impacts": set()}
    for name, kind in (("odom", Odometry), ("joint_states", JointState), ("ground_contact", WrenchStamped)):
        bench.node.create_subscription(kind, name, lambda message, name=name: latest.update({name: message}), 10)
    bench.node.create_subscription(WrenchStamped, "impacts",
                                   lambda message: latest["impacts"].add(message.header.frame_id), 10)
    bench.spin_until(lambda: all(latest.values()) and len(latest["impacts"]) == 2, "a message of each topic")
    stop(robot)
    assert latest["joint_states"].name == guide.first_column("joint", "position", "velocity", "effort")
    frames = {latest["odom"].header.frame_id, latest["odom"].child_frame_id, latest["joint_states"].header.frame_id,
              latest["ground_contact"].header.frame_id, *latest["impacts"]}
    documented_frames = set(guide.first_column("frame", "in", "is"))
    assert frames < documented_frames
    assert documented_frames == {"odom", "base_link", *(joint.child for joint in robot_joints(load_scene("device")))}


def test_keys_of_diagnostics_and_of_custom_data_are_those_of_running_robots(start, listener, tmp_path):
    """Each robot has some of the documented keys; all robots together have all of them, and no other key."""
    seen: dict[str, set[str]] = {"simulation": set(), "recorder": set()}
    for number, (words, solver) in enumerate(KINDS_OF_ROBOT, start=1):
        listener.parts.clear()
        robot = start("robot", "--ros-args", *parameters(words))
        robot.wait_for("ready:")
        for status, keys in seen.items():
            _, values = listener.wait_for_status(status, lambda part: bool(part.values))
            if "rate.real_time_factor:=0.0" in words:
                assert not [key for key in values if key.startswith("lateness")]
            keys |= set(values)
            if status == "simulation":
                assert values["solver method"] == solver.split(",")[0]
                assert values["accuracy in force"].startswith("rounding" if solver == "exact" else "not known")
        stop(robot)
        assert len(bags(tmp_path)) == number
        metadata = read_bag(bags(tmp_path)[-1], {}).metadata
        assert set(metadata) == guide.custom_data()
        assert metadata["solver"] == solver
    # `test_diagnostics.py` has the keys that depend on a longer motion.
    seen["simulation"] |= {"pitch index", "rms current over continuous"}
    assert seen == guide.diagnostics()
