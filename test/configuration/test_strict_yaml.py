"""A YAML file from elsewhere neither hangs nor kills: it is read, or refused in one line that names it."""

import os
import time

import pytest
import yaml

from vibro_ros.configuration.strict_yaml import LIMITS, Limits, parse_yaml, read_scalar, read_yaml

LONGEST = 10.0  # s, of the slowest document
HOSTILE = {
    "nested lists": ("[" * 100_000, "nested more than 32 deep"),
    "an alias": ("a: &a [x, x]\nb: [*a, *a]", "line 2: not read: the alias *a; write the value out"),
    "no such date": ("a: 2001-99-99", "'2001-99-99' cannot be read as timestamp"),
    "a long int": ("9" * 5000, "cannot be read as int"),
    "sexagesimal": ("1:" * 20_000 + "1", "more than 4096 bits"),
    "unhashable": ("? [a]\n: b", "a key that is a list or a mapping"),
    "many keys": ("".join(f"{i}: 1\n" for i in range(60_000)), "more than 100000 keys and values"),
    "twice": ("a: 1\nb: 2\na: 3", "'a' is given twice"),
    "two documents": ("--- a\n--- b", "another document"),
    "NUL": ("a: \0", "control characters"),
    "large": ("#" * (LIMITS.size + 1), "larger than 1048576 bytes"),
    "UTF-16": ("a: 1".encode("utf-16"), "not YAML: byte 0 is not UTF-8"),
    "Latin": (b"a: \xff", "not YAML: byte 3 is not UTF-8"), "MCAP": (b"\x89MCAP0\r\n", "not YAML: byte 0 is not UTF-8"),
}


@pytest.mark.parametrize("text, reason", HOSTILE.values(), ids=HOSTILE)
def test_documents_beyond_the_limits_are_refused_in_one_line(tmp_path, text, reason):
    path = tmp_path / "file.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    began = time.monotonic()
    with pytest.raises(ValueError, match="^[^\n]*$") as raised:
        read_yaml(path)
    assert time.monotonic() - began < LONGEST
    assert str(raised.value).startswith(f"{path}") and reason in str(raised.value)


def test_forty_thousand_keys_are_read(tmp_path):
    (tmp_path / "file.yaml").write_text("".join(f"key{i}: {i}\n" for i in range(40_000)))
    began = time.monotonic()
    assert read_yaml(tmp_path / "file.yaml") == {f"key{i}": i for i in range(40_000)}
    assert time.monotonic() - began < LONGEST  # comparing every key with every other took minutes


def test_a_limit_counts_keys_and_values():
    assert parse_yaml("a: [1, 2]\nb: 3", Limits(values=7)) == {"a": [1, 2], "b": 3}
    with pytest.raises(ValueError, match="more than 6 keys and values"):
        parse_yaml("a: [1, 2]\nb: 3", Limits(values=6))


def test_only_regular_files_are_opened(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "zero").symlink_to("/dev/zero")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    for name, reason in (("pipe", "is a named pipe"), ("zero", "is a device"), (".", "is a folder"),
                         ("loop", "Too many levels of symbolic links"), ("none", "No such file")):
        with pytest.raises(ValueError, match=reason):
            read_yaml(tmp_path / name)


def test_tags_are_ignored_and_never_make_an_object():
    """launch_ros makes tuples of lists and writes them by `yaml.dump`."""
    given = {"a": (1.0, 2.0), "b": ("x", "y"), "c": {"d": (True,)}}
    text = yaml.dump(given, default_flow_style=False)
    assert "!!python/tuple" in text
    assert parse_yaml(text) == {"a": [1.0, 2.0], "b": ["x", "y"], "c": {"d": [True]}}
    for tagged, plain in (('!!python/object/apply:os.abort ["x"]', ["x"]), ("!!python/name:os.abort ''", ""),
                          ("!!python/object:os.stat_result {a: 1}", {"a": 1}), ("!!float 1", 1), ("!!str 1", "1")):
        value = parse_yaml(tagged)
        assert value == plain and type(value) is type(plain)


def test_a_hostile_scalar_is_a_text():
    for text in ("[" * 10_000, "{", "\0", "2001-99-99"):
        assert read_scalar(text) == text
    assert (read_scalar("1e-3"), read_scalar("true"), read_scalar("x")) == (1e-3, True, "x")
