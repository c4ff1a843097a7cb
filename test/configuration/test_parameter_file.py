"""Sections of ROS parameter files; that rcl reads the same from them is tested in test/ros/test_parameters.py."""

import pytest

from vibro_ros.configuration.parameter_file import applies, own_parameters, sections


def test_patterns_of_sections_apply_to_the_nodes_that_they_name():
    assert applies("/**/b", "/b") and applies("/*", "/b")
    assert not applies("/a.b", "/a/b")


def test_parameters_of_rclpy_are_left_out_and_no_others():
    values = {"use_sim_time": True, "qos_overrides./odom.publisher.depth": 3, "use_sim": 1, "a.use_sim_time": 2}
    assert own_parameters(values) == {"use_sim": 1, "a.use_sim_time": 2}


@pytest.mark.parametrize(("text", "reason"), [
    *((text, "(.*: )?holds no parameters; a parameter file begins with .*") for text in (
        "", "5", "- 1", "mass.body: 1.0", "ros__parameters: {a: 1}", "top: 1",
        "/**:\n  ros__parameters: {a: 1}\n  other: 1\n", "/**:\n  ros__parameters: 5\n")),
    # Of a parameter that one file gives a node twice, rcl takes the later value without a word.
    *((text, r"(b\.)?a: is given twice( for /\*\*(/n)?)?; keep one") for text in (
        "/**:\n  ros__parameters: {a: 1, a: 2}\n",
        "/**:\n  ros__parameters: {a: 1}\n/**:\n  ros__parameters: {a: 2}\n",
        "/**:\n  ros__parameters: {b: {a: 1}, b.a: 2}\n",
        "/**:\n  n: {ros__parameters: {a: 1}}\n/**:\n  n: {ros__parameters: {a: 1}}\n")),
    *((f"/**:\n  ros__parameters:\n    mass:\n      body: {value}\n", "mass.body: has no value; give one.*")
      for value in ("", "{}", "~"))])
def test_an_empty_or_ambiguous_file_is_refused_in_one_line(tmp_path, text, reason):
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(ValueError, match=rf"^{path}: {reason}$"):
        sections(path)
