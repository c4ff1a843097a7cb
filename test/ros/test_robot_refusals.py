"""Bad parameters, files and arguments of the robot: one line with the reason, and exit code 2."""

import pytest

BAD_PARAMETERS = {
    "out of range": (["-p", "mass.body:=-1.0"], "mass.body: -1 is out of range; give a number above 0"),
    "wrong type": (["-p", "mass.body:=heavy"], "mass.body: 'heavy' is not a number; give a number above 0"),
    "not a number": (["-p", "gravity:=.nan"], "gravity: nan is not finite; give a number from 0"),
    "infinite": (["-p", "motor.speed:=.inf"], "motor.speed: inf is not finite"),
    "negative speed": (["-p", "motor.speed:=-1.0"], "motor.speed: -1 is out of range; give a number from 0"),
    "too fast": (["-p", "motor.speed:=600.0"], "motor.speed: 600 is out of range; give a number from 0 to 500 rad/s"),
    "gap beyond the mechanism": (["-p", "upper.gap:=1.0"],
                                 "upper.gap: 1 is out of range; give a number from -0.06 to 0.06 m"),
    "unknown effect": (["-p", "effects.motor:=rocket"], "'rocket' is unknown; choose one of ideal, ramp"),
    "misspelt": (["-p", "mass.boddy:=1.0"], "mass.boddy: unknown parameter; did you mean mass.body?"),
    "no such scene": (["-p", "scene:=moon"], "moon: neither a shipped scene nor a file; shipped scenes are"),
    "list": (["-p", "mass.body:=[1.0]"], "mass.body: [1.0] is not a number"),
    "no assignment": (["-p", "mass.body=1.0"], "-p mass.body=1.0: not a parameter; write name:=value"),
    "folder": (["-p", "record.directory:=/proc/none"], "record.directory: cannot record to /proc/none"),
    "remapping": (["-r", "odom:=9x"], "-r odom:=9x: '9x' cannot stand for odom; give a topic's or service's name"),
    "namespace": (["-r", "__ns:=r1"], "-r __ns:=r1: 'r1' cannot stand for __ns; give a namespace: / before each part"),
    "one name of two topics": (["-r", "odom:=joint_states"], "odom and joint_states have one name, /joint_states"),
    "ROS argument": (["--log-level", "loud"], "ROS refuses the arguments: Couldn't parse log level"),
    "missing file": (["--params-file", "none.yaml"], "none.yaml: No such file or directory"),
}


@pytest.mark.parametrize("words, reason", BAD_PARAMETERS.values(), ids=BAD_PARAMETERS)
def test_bad_parameters_are_one_line_and_exit_code_2(start, words, reason):
    assert_refused(start("robot", "--ros-args", *words), reason)


BAD_FILES = {
    "malformed": ("/**:\n  ros__parameters:\n    mass: [1,\n", "params.yaml, line 4: not YAML"),
    "other node": ("vibro_robt:\n  ros__parameters:\n    gravity: 9.81\n",
                   "holds parameters for /vibro_robt, none for this node; address them to /vibro_robot or to /**"),
    "misspelt": ("/**:\n  ros__parameters:\n    gravitty: 9.81\n", "gravitty: unknown parameter; did you mean gravity"),
    "wrong type": ("/**:\n  ros__parameters:\n    gravity: yes\n", "gravity: True is not a number"),
    "twice": ("/**:\n  ros__parameters:\n    gravity: 1.0\n    gravity: 2.0\n", "'gravity' is given twice"),
    "empty": ("", "holds no parameters"),
}


@pytest.mark.parametrize("text, reason", BAD_FILES.values(), ids=BAD_FILES)
def test_bad_parameter_files_are_one_line_and_exit_code_2(start, tmp_path, text, reason):
    (tmp_path / "params.yaml").write_text(text)
    assert_refused(start("robot", "--ros-args", "--params-file", "params.yaml"), reason)


def test_an_unknown_argument_is_refused(start):
    assert_refused(start("robot", "--sceen", "paper"), "unrecognized arguments: --sceen paper; `robot --help`")


def assert_refused(robot, reason: str) -> None:
    assert robot.end() == 2, robot.text
    (line,) = [line for line in robot.lines if "]: scene " not in line]  # the folder is tried after the scene is known
    assert line.startswith("robot: ")
    assert reason in line
