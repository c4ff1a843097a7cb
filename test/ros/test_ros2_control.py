"""A robot under ros2_control: the test reads its description and acts as its hardware, by the rules of the hardware's
sources, over DDS. `TopicSystem` does what JointStateTopicSystem of joint_state_topic_hardware_interface does in `read`
and `write`.
"""

import math
from xml.etree import ElementTree

from observation import stop_with_whole_bag, value_of
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from test_operations import assert_replays

from vibro_ros.bag.reader import read_bag
from vibro_ros.ros.node.node import qos_profile

PLUGIN = "joint_state_topic_hardware_interface/JointStateTopicSystem"
KINDS = ("position", "velocity", "effort")


class TopicSystem:
    """The hardware of a `<ros2_control>` block: states and commands of its joints by name and interface."""

    def __init__(self, bench, description: str):
        (block,) = ElementTree.fromstring(description).iter("ros2_control")
        assert block.get("type") == "system" and block.findtext("hardware/plugin") == PLUGIN
        given = {parameter.get("name"): parameter.text for parameter in block.iter("param")}
        self.threshold = float(given["trigger_joint_command_threshold"])
        self.joints = {joint.get("name"): [interface.get("name") for interface in joint.findall("command_interface")]
                       for joint in block.findall("joint")}
        self.states = {(joint.get("name"), interface.get("name")): math.nan
                       for joint in block.findall("joint") for interface in joint.findall("state_interface")}
        self.commands = {(joint, kind): math.nan for joint, kinds in self.joints.items() for kind in kinds}
        self._publisher = bench.node.create_publisher(JointState, given["joint_commands_topic"],
                                                      qos_profile_sensor_data)  # best effort; others are reliable
        bench.node.create_subscription(JointState, given["joint_states_topic"], self._read, qos_profile_sensor_data)
        bench.spin_until(lambda: self._publisher.get_subscription_count() and all(
            map(math.isfinite, self.states.values())), "the robot and its states")

    def _read(self, message: JointState) -> None:
        for i, name in enumerate(message.name):
            for kind in KINDS:
                if (name, kind) in self.states and (values := getattr(message, kind)) and math.isfinite(values[i]):
                    self.states[name, kind] = values[i]

    def write(self) -> None:
        difference = sum(abs(self.states[key] - command) for key, command in self.commands.items())
        if difference <= self.threshold:  # false for NaN
            return
        message = JointState()
        for joint, kinds in self.joints.items():
            message.name.append(joint)
            for kind in kinds:
                getattr(message, kind).append(self.commands[joint, kind])
        self._publisher.publish(message)


def test_topic_based_hardware_drives_the_robot_and_the_run_replays(start, bench, listener,
                                                                                             tmp_path):
    robot = start("robot", "--ros-args", "-p", "ros2_control:=true", "-p", "command.timeout:=0.5", "-r",
                  "joint_states:=robot_joint_states")
    robot.wait_for("ready")
    heard: list[String] = []
    bench.node.create_subscription(String, "robot_description", heard.append, qos_profile("robot_description"))
    bench.spin_until(lambda: heard, "the description")
    system = TopicSystem(bench, heard[0].data)
    assert system.joints == {
        "crank": ["velocity"], "upper_plate": ["position"], "inclined_plate": ["position"]}
    for _ in range(5):  # no controller is active yet
        system.write()
        bench.spin_once()

    def commanded() -> bool:
        system.write()
        return all(abs(system.states[key] - command) < 1e-12 for key, command in system.commands.items())

    system.commands = {("crank", "velocity"): 40.0, ("upper_plate", "position"): 0.0602,
                       ("inclined_plate", "position"): 0.0599}
    bench.spin_until(commanded, "speed and plates where they were commanded")
    system.commands["crank", "velocity"] = math.nan  # its controller is switched off: the robot's timeout stops it
    bench.spin_until(lambda: commanded() or system.states["crank", "velocity"] == 0.0, "the motor's stop")
    status, values = listener.wait_for_status("simulation", lambda status: value_of(
        status, "stops by command.timeout") == 1.0)
    assert values["rejected commands"] == "0"
    (publisher,) = bench.publishers({"joint_commands": JointState}).values()
    wheels = [JointState(name=["crank", "wheel"], velocity=[10.0])] * 3  # another robot's, counted and told once
    for message in (*wheels, JointState(name=["elbow\n"], position=[1.0]), JointState(name=["crank"], velocity=[1e300]),
                    JointState(name=["crank"], velocity=[-501.0]), JointState(name=["crank"] * 3, velocity=[1.0] * 2),
                    JointState(name=["upper_plate"], position=[5.0]), JointState(name=["x" * 2000], velocity=[1.0])):
        publisher.publish(message)
    publisher.publish(JointState(name=["crank", "upper_plate"], velocity=[20.0], position=[-1.0]))
    bench.spin_until(lambda: system.states["crank", "velocity"] == 20.0, "the good half of a command")
    listener.wait_for_status("simulation", lambda status: value_of(status, "rejected commands") == 10.0)
    assert len([line for line in robot.lines if "/joint_commands: 'wheel' is no joint of this robot" in line]) == 1
    robot.wait_for("command refused: /joint_commands: 'elbow\\n' is not commanded by position")
    folder = tmp_path / stop_with_whole_bag(robot)
    assert_replays(folder, 50, commands=3)  # each sent in one message with the others
    assert "time" in read_bag(folder)["joint_commands"]
