"""Bad parameters, files, names and arguments of the robot: one line with the reason, and exit code 2."""

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node

from vibro_ros.configuration.scene_file import DEVICE_PARAMETERS
from vibro_ros.ros.node.arguments import check_names, own_arguments
from vibro_ros.ros.robot import robot

BAD = {  # what a parameter of the table can be refused for, test/model asks
    "misspelt": (["-p", "mass.boddy:=1.0"], "mass.boddy: unknown parameter; did you mean mass.body?"),
    "no such scene": (["-p", "scene:=moon"], "moon: neither a shipped scene nor a file; shipped scenes are"),
    "no assignment": (["-p", "mass.body=1.0"], "parameter override rule: '-p mass.body=1.0'; write name:=value"),
    "folder": (["-p", "record.directory:=/proc/none"], "record.directory: cannot record to /proc/none"),
    "namespace": (["-r", "__ns:=r1"], "remap rule: '-r __ns:=r1'; write old:=new, such as odom:=/lab/odom or __ns:="),
    "two topics on /tf": (["-r", "/tf_static:=/tf"], "have one name, /tf; remap one of them to another"),
    "use_sim_time": (["-p", "use_sim_time:=sometimes"], "use_sim_time: 'sometimes' is not true or false; give true"),
    "lock-step without a clock": (["-p", "clock.lock_step:=[/vibro_controller]"],
                                  "has no effect without robot time on /clock"),
    "lock-step with no node": (["-p", "clock.publish:=true", "-p", "clock.lock_step:=[a b]"], "a b is no node's name"),
    "lock-step with itself": (["-p", "clock.publish:=true", "-p", "clock.lock_step:=[vibro_robot]"],
                              "the robot cannot wait for itself"),
    "five variances": (["-p", "odom.pose_covariance_diagonal:=[1.0,2.0,3.0,4.0,5.0]"], "is not a list of 6 numbers"),
    "quality of service": (["-p", "qos_overrides./odom.publisher.reliability:=perhaps"],
                           "'perhaps' is unknown; choose one of reliable, best_effort"),
    "no depth": (["-p", "qos_overrides./odom.publisher.depth:=0"], "0 is no depth; give a whole number from 1"),
    "no such topic": (["-p", "qos_overrides./odm.publisher.depth:=5"], "this node has no publisher /odm; give one of"),
    "no such policy": (["-p", "qos_overrides./odom.publisher.deadline:=5"], "deadline cannot be overridden here; give"),
    "no topic": (["-p", "qos_overrides.odom:=5"], "qos_overrides.odom: not understood; write qos_overrides./TOPIC"),
    "mixed list": (["-p", "odom.pose_covariance_diagonal:=[0.1, 2, 3, 4, 5, 6]"], "Sequence should be of same type. "
                   "Value type 'integer' do not belong at line_num 1; write every number of a list with a point"),
    "empty list": (["-p", "record.topics:=[]"], "record.topics: its list is empty, which has no type in ROS; give a"),
    "mixed list in a file": (["--params-file", "mixed.yaml"], "mixed.yaml: odom.pose_covariance_diagonal: its list "
                             "mixes a number with a point (0.1) and an integer (2), and ROS takes lists of one type; "
                             "write each number with a point, such as 2.0"),
    "file without a name": (["--params-file"], "trailing --params-file flag. No file path provided"),
    "ROS argument": (["--log-level", "loud"], "ROS refuses the arguments: Couldn't parse log level"),
    "missing file": (["--params-file", "none.yaml"], "none.yaml: No such file or directory"),
    "malformed file": (["--params-file", "malformed.yaml"], "malformed.yaml, line 4: not YAML"),
    "file of another node": (["--params-file", "other.yaml"], "holds parameters for /vibro_robt, none for this node; "
                             "address them to /vibro_robot or to /**"),
}


@pytest.mark.parametrize("words, reason", BAD.values(), ids=BAD)
def test_bad_arguments_and_files_give_one_line_and_exit_code_2(refusal, tmp_path, words, reason):
    (tmp_path / "malformed.yaml").write_text("/**:\n  ros__parameters:\n    mass: [1,\n")
    (tmp_path / "other.yaml").write_text("vibro_robt:\n  ros__parameters:\n    gravity: 9.81\n")
    (tmp_path / "mixed.yaml").write_text(
        "/**:\n  ros__parameters:\n    odom.pose_covariance_diagonal: [0.1, 2, 3, 4, 5, 6]\n")
    assert_refused(refusal(robot.main, "--ros-args", *words), reason)


ENVIRONMENTS = {
    "RMW_IMPLEMENTATION=rmw_zenoh_cpp": "RMW_IMPLEMENTATION=rmw_zenoh_cpp: is not installed, but rmw_fastrtps_cpp is; "
                                        "unset RMW_IMPLEMENTATION, or install",
    "ROS_DOMAIN_ID=233": "ROS_DOMAIN_ID=233: no ROS domain; set it to a whole number from 0 to 232, or unset it",
    "ROS_STATIC_PEERS=nobody.invalid": "Unable to resolve peer nobody.invalid",
    "RCUTILS_LOGGING_USE_STDOUT=perhaps": "unexpected value [perhaps] specified for RCUTILS_LOGGING_USE_STDOUT. Valid",
}


@pytest.mark.parametrize("variable, reason", ENVIRONMENTS.items(), ids=ENVIRONMENTS)
def test_an_environment_without_ros_is_one_line(start, variable, reason):
    started = start("robot", wrapper=["env", variable])
    assert started.end() == 2, started.text
    (line,) = started.lines
    assert_refused(line, reason)


def test_a_robot_that_cannot_be_secured_does_not_start(start, tmp_path):
    """Under `Enforce`, an enclave without keys is an error and not a robot without security."""
    (tmp_path / "keys" / "enclaves" / "robot").mkdir(parents=True)
    started = start("robot", "--ros-args", "--enclave", "/robot", wrapper=[
        "env", "ROS_SECURITY_ENABLE=true", "ROS_SECURITY_STRATEGY=Enforce", f"ROS_SECURITY_KEYSTORE={tmp_path}/keys"])
    assert started.end() == 2, started.text
    (line,) = started.lines
    assert_refused(line, "robot: ROS refuses the arguments: ")


def test_warnings_of_the_middleware_are_lines_of_the_log(start):
    started = start("robot", wrapper=["env", "FASTRTPS_DEFAULT_PROFILES_FILE=none.xml",
                                      "RMW_FASTRTPS_PUBLICATION_MODE=pigeons"])
    started.wait_for("ready")
    lines = [line.partition("[vibro_robot]: the middleware says: ")[2] for line in started.lines if "[WARN]" in line]
    assert [line for line in lines if line.startswith("Value pigeons unknown for")]
    assert "realpath failed No such file or directory" in lines
    assert all(line.startswith("[") and "\x1b" not in line for line in started.lines)


def assert_refused(line: str, reason: str) -> None:
    assert line.startswith("robot: ")
    assert reason in line


def test_a_process_ends_with_the_line_and_the_code(start):
    for words, reason in ((("--sceen", "paper"), "unrecognized arguments: --sceen paper; `robot --help`"),
                          (("--ros-args", "-p", "record.topics:=[odm]"), "'odm' is not a topic of the robot")):
        started = start("robot", *words)
        assert started.end() == 2, started.text
        (line,) = started.lines
        assert_refused(line, reason)


@pytest.mark.parametrize("words, expected", [
    (["crawl"], ["crawl"]),
    (["crawl", "--ros-args", "-p", "a:=1"], ["crawl"]),
    (["--ros-args", "-p", "a:=1", "--", "crawl"], ["crawl"]),
    (["-h", "--ros-args", "-r", "x:=y", "--", "a", "--ros-args", "--log-level", "warn"], ["-h", "a"]),
])
def test_own_arguments_are_those_outside_ros_args(words: list[str], expected: list[str]):
    assert own_arguments(words) == expected


@pytest.mark.parametrize("words, remedy", [
    *([[option, "scene:=paper", "--ros-args", "-p", "a:=1"],
       f"{option}: is an option of ROS; write --ros-args before it, such as --ros-args {option} "]
      for option in ("-p", "-r", "--params-file")),
    (["--scene", "damped"], "--scene: is a parameter of ROS; write --ros-args -p scene:=damped"),
    (["--scene=damped"], "--scene=damped: is a parameter of ROS; write --ros-args -p scene:=damped"),
    (["scene:=damped", "x"], "scene:=damped: is a parameter of ROS; write --ros-args -p scene:=damped"),
    (["__ns:=/r1"], "__ns:=/r1: is an argument of ROS; write --ros-args -r __ns:=/r1"),
    (["odom:=o"], "odom:=o: is an argument of ROS; write --ros-args -p odom:=o for a parameter, -r odom"),
])
def test_an_argument_of_ros_outside_ros_args_is_shown_as_it_is_written(words, remedy):
    with pytest.raises(ValueError, match="^[^\n]*$") as refusal:
        own_arguments(words, DEVICE_PARAMETERS)
    assert str(refusal.value).startswith(remedy)
    assert own_arguments(["scene"], DEVICE_PARAMETERS) == ["scene"]


@pytest.mark.parametrize(("rule", "words"), {
    "odom:=joint_states": "odom and joint_states have one name, /lab/joint_states; remap one of them",
    "odom:=/diagnostics": "odom: has the name /diagnostics, which stands for something else; remap it",
    f"odom:={'a' * 300}": "odom: its full name is too long; give a namespace or a remapping that leaves it at most 247",
}.items(), ids=["two", "taken", "long"])
def test_ambiguous_and_reserved_names_are_refused(rule, words, domain_id):
    context = Context()
    rclpy.init(args=["--ros-args", "-r", "__ns:=/lab", "-r", rule], context=context)
    node = Node("vibro_robot", context=context)
    with pytest.raises(ValueError, match=words[:40]) as refusal:
        check_names(node, ("motor_speed", "odom", "joint_states"))
    assert words in str(refusal.value)
    node.destroy_node()
    context.try_shutdown()
