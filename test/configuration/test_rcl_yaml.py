"""Values as rcl reads them from a parameter file; that rcl does is tested in test/ros/test_parameter_roads.py."""

import math

import pytest
import yaml

from vibro_ros.configuration.rcl_yaml import rcl_document, rcl_scalar


@pytest.mark.parametrize(("text", "value"), [
    ("y", True), ("Off", False), ("yES", "yES"), ("017", 15), ("0x1F", 31), ("08", 8.0), ("0o17", "0o17"),
    ("1_000", "1_000"), ("1:30", "1:30"), ("1e-3", 1e-3), ("+.5", 0.5), ("5.", 5.0), ("-0", 0), ("0x1p3", 8.0),
    ("9223372036854775807", 2**63 - 1), ("9223372036854775808", 2.0**63), ("1e999", "1e999"), ("1e-999", "1e-999"),
    ("4e-320", "4e-320"), ("0e-999", 0.0), ("infinity", math.inf), ("-.inf", -math.inf), ("~", "~"), ("null", "null"),
    ("2020-01-01", "2020-01-01"), ("0x", "0x"), ("1" + "0" * 400, "1" + "0" * 400)], ids=lambda value: str(value)[:20])
def test_a_plain_text_is_what_c_makes_of_it(text, value):
    found = rcl_scalar(text)
    assert (type(found), found) == (type(value), value)


def test_quotes_and_the_tag_of_a_text_make_a_text_and_other_tags_nothing():
    assert rcl_document("a: '1'\nb: \"y\"\nc: !!str 1\nd: !!float 1\ne: !!int '3'\nf: ''\n1: {true: 2}") == {
        "a": "1", "b": "y", "c": "1", "d": 1, "e": "3", "f": "", "1": {"true": 2}}
    assert rcl_document("") is None


@pytest.mark.parametrize("text", [
    "a:", "a: {}", "'': 1", "<<: 1", "? [a]: 1", "a: []", "a: [1, x]", "a: [1, 2.0]", "a: [[1]]", "a: [{b: 1}]",
    "a: &x 1\nb: *x", "a: 1\na: 2", "a: 1\n'a': 2"])
def test_what_is_no_value_for_rcl_is_refused_with_its_line(text):
    with pytest.raises(yaml.MarkedYAMLError) as told:
        rcl_document(text)
    assert told.value.kind == "not for ROS" and told.value.problem_mark.line == text.count("\n")
