"""The three ways of a parameter file, `--params-file`, the parameter `scene` and `load_scene`, give the same robot."""

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node

from vibro_ros.configuration.parameter_file import merged, own_parameters, sections
from vibro_ros.ros.node.arguments import folder_of

NODE = "/lab/vibro_robot"


def section(pattern: str, *lines: str) -> str:
    return f"{pattern}:\n  ros__parameters:\n" + "".join(f"    {line}\n" for line in lines)


def own_parameters_by_rcl(words: list[str], domain_id: int) -> dict[str, object]:
    context = Context()
    rclpy.init(context=context, domain_id=domain_id, args=["--ros-args", "-r", "__ns:=/lab", *words])
    node = Node("vibro_robot", context=context, automatically_declare_parameters_from_overrides=True)
    given = {name: parameter.value for name, parameter in node.get_parameters_by_prefix("").items()}
    node.destroy_node()
    rclpy.shutdown(context=context)
    return own_parameters(given)


@pytest.mark.parametrize("text", [
    section("/**", "a: 1", "b: 1") + section(NODE, "a: 2"),
    section(NODE, "a: 2") + section("/**", "a: 1", "b: 1"),
    section("/lab/*", "a: 1") + section("/*/vibro_robot", "a: 2") + section("/**/vibro_robot", "a: 3"),
    section("/**/vibro_robot", "a: 3") + section("/lab/*", "a: 1") + section("/hall/*", "a: 2"),
    section("lab/vibro_robot", "a: 2") + section("/**", "a: 1") + section("/lab/vibro_robot", "a: 3"),
    section("vibro_controller", "rate: 2") + section("/**", "a: {b: 1, c: {d: 2}}", "e.f: 3"),
    "/lab:\n  vibro_robot:\n    ros__parameters: {a: 1}\n  other:\n    ros__parameters: {a: 2}\n",
    "lab/:\n  vibro_robot:\n    ros__parameters: {a: 1}\n", "/*:\n  '*':\n    ros__parameters: {a: 1}\n",
    section("/**", "a: 1e-3", "b: .5", "c: 0x10", "d: 010", "e: true", "f: text", "g: [p, q]", "h: 'yes'", "i: -0.0",
            "j: 1.0e+3", "k: +2", "l: 1.", "m: ~/x", "n: off"),
    "/lab/:\n  '**':\n    ros__parameters: {}\n  '*':\n    ros__parameters: {a: 1}\n",
    '{"/**": {"ros__parameters": {"a": 1}}}', section("vibro_robot", "a: 1"), section("/lab", "a: 1"),
    section("/lab/**", "a: 1") + section("/vibro_robot", "b: 1") + section("/*", "c: 1"),
    section("/**", "a: !!str 1", "b: !!float 1", "c: !!python/name:os.abort ''", "d: !!set {e: 1}"),
    section("/**", "a: !!python/object/apply:os.abort [p, q]", "b: !!python/tuple\n    - 1.0\n    - 2.0"),
    section("/**", "a: 1") + section("/hall/*", "a: 2") + section("/**", "b: 3", "c: [1.0, 2.0]"),
    "/**:\n  other:\n    ros__parameters: {a: 1}\n" + "/**:\n  vibro_robot:\n    ros__parameters: {a: 2}\n",
    section("/**", "a: 1") + "/**:\n  vibro_robot:\n    ros__parameters: {a: 2}\n" + section("/lab/*", "a: 3"),
    section("/**", "a: {b: 1}", "c: 2", "a: {d: 3}") + section("/hall/*", "e: [[1]]", "f: []"),
    "/lab:\n  '**': {ros__parameters: {a: 1}}\n/lab:\n  '**': {ros__parameters: {b: 2}}\n",
    "/**:\n  vibro_robot: {ros__parameters: {a: 1}}\n  ros__parameters: {b: 2}\n",
    section("/lab/*/vibro_robot", "a: 1") + section("vibro_robt", "b: 1") + section(f"{NODE}/**/x", "c: 1"),
], ids=range(24))
def test_rcl_reads_the_same_from_a_file(text, tmp_path, domain_id):
    file = tmp_path / "file.yaml"
    file.write_text(text)
    assert merged(sections(file), NODE) == own_parameters_by_rcl(["--params-file", str(file)], domain_id)


@pytest.mark.parametrize("text", [
    section("/**", "a:"), section("/**", "a: {}"), section("/**", "a: &x 1", "b: *x"), "/**:\n  ros__parameters:\n",
    section("/**", "a: [0.5, 1]"), section("/hall/*", "a: [1, b]"), section("/**", "a: [true, 1]"),
    section("/**", "a: [x, 1e-3]"), "/lab:\n  /**:\n    ros__parameters: {a: 1}\n",
    "/**:\n  ros__parameters: {a: 1}\n  vibro_robot:\n    ros__parameters: {b: 1}\n",
    section("/**", "a: 1") + "  b: 1\n", "- a\n", "a: [1\n", section("/**", "a: b: c"),
], ids=range(14))
def test_what_rcl_refuses_is_refused_by_every_road(text, tmp_path, domain_id):
    file = tmp_path / "file.yaml"
    file.write_text(text)
    with pytest.raises(ValueError, match=str(file)):
        sections(file)
    with pytest.raises((RuntimeError, ValueError)):
        own_parameters_by_rcl(["--params-file", str(file)], domain_id)


@pytest.mark.parametrize("order", [
    "1 2", "2 1", "12", "21", "1 p", "p 1", "2 p", "21 p", "p 12", "2 p 2", "1 q", "q p", "3 p", "1 r", "none"])
def test_rcl_takes_the_value_from_the_same_place(order, tmp_path, domain_id, monkeypatch):
    """Each file is alone in its folder, whose name is the value; `-p` has the value `.`."""
    monkeypatch.chdir(tmp_path)
    sections_of = {"1": "/**", "2": NODE, "3": "/hall/*"}
    overrides = {"p": "scene:=.", "q": "vibro_robot:scene:=.", "r": "gravity:=9.81"}
    words = []
    for name in order.split() if order != "none" else []:
        if name in overrides:
            words += ["-p", overrides[name]]
            continue
        (tmp_path / name).mkdir(exist_ok=True)
        file = tmp_path / name / "file.yaml"
        file.write_text("".join(section(sections_of[letter], f"scene: '{name}'") for letter in name))
        words += ["--params-file", f"{name}/file.yaml"]
    given = own_parameters_by_rcl(words, domain_id)
    assert str(folder_of("scene", ["--ros-args", *words], NODE)) == given.get("scene", ".")
