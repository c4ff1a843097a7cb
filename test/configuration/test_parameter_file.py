"""Sections of ROS parameter files; that rcl reads the same from them is tested in test/ros/test_parameter_roads.py."""

import pytest

from vibro_ros.configuration.parameter_file import applies, merged, own_parameters, sections


def test_sections_in_their_order_with_dotted_names(tmp_path):
    path = tmp_path / "two.yaml"
    path.write_text("vibro_robot:\n  ros__parameters:\n    mass: {body: 2.0, upper: 1}\n    gravity: 1.6\n"
                    "/lab:\n  right/:\n    other:\n      ros__parameters: {rate: 5.0}\n"
                    "  '*':\n    ros__parameters: {}\n")
    assert sections(path) == [("vibro_robot", {"mass.body": 2.0, "mass.upper": 1, "gravity": 1.6}),
                              ("/lab/right/other", {"rate": 5.0}), ("/lab/*", {})]


@pytest.mark.parametrize(("pattern", "node", "does"), [
    ("/**", "/a/b", True), ("/a/b", "/a/b", True), ("a/b", "/a/b", True), ("/*/b", "/a/b", True),
    ("/a/*", "/a/b", True), ("/**/b", "/a/b", True), ("/**/b", "/b", True),
    ("/a/**", "/a/b", True), ("/*", "/b", True), ("/*", "/a/b", False), ("/b", "/a/b", False),
    ("/a", "/a/b", False), ("/a/b/**/x", "/a/b", False), ("/a.b", "/a/b", False)])
def test_which_nodes_a_section_is_for(pattern, node, does):
    assert applies(pattern, node) == does


def test_of_several_patterns_the_one_that_came_last_for_the_first_time_holds():
    given = [("/**", {"a": 1, "b": 1}), ("/node", {"a": 2}), ("/other", {"a": 3}), ("/**", {"a": 4, "c": 4})]
    assert merged(given, "/node") == {"a": 2, "b": 1, "c": 4}
    assert merged(given[1:], "/node") == {"a": 4, "c": 4}


def test_parameters_of_rclpy_are_no_others():
    values = {"use_sim_time": True, "qos_overrides./odom.publisher.depth": 3, "use_sim": 1, "a.use_sim_time": 2}
    assert own_parameters(values) == {"use_sim": 1, "a.use_sim_time": 2}


@pytest.mark.parametrize("text", [
    "", "5", "- 1", "mass.body: 1.0", "ros__parameters: {a: 1}", "top: 1",
    "/**:\n  ros__parameters: {a: 1}\n  other: 1\n", "/**:\n  ros__parameters: 5\n"])
def test_a_file_that_is_none_is_refused_in_one_line(tmp_path, text):
    path = tmp_path / "none.yaml"
    path.write_text(text)
    with pytest.raises(ValueError, match="holds no parameters; a parameter file begins with") as told:
        sections(path)
    assert str(told.value).startswith(f"{path}: ") and "\n" not in str(told.value)


@pytest.mark.parametrize("value", ["", "{}", "~"])
def test_a_parameter_without_a_value_is_refused_by_its_name(tmp_path, value):
    path = tmp_path / "none.yaml"
    path.write_text(f"/**:\n  ros__parameters:\n    mass:\n      body: {value}\n")
    with pytest.raises(ValueError, match="none.yaml: mass.body: has no value; give one"):
        sections(path)
