"""A record gives back what it was given, however its writer was stopped, and refuses the files of others."""

import os

import numpy as np
import pytest

from vibro_ros.study.optimise.search import Record

SEARCH = {"seed": 3, "scene": {"guide.angle": 0.1}}
POINTS = np.array([[0.1, 0.2], [0.3, 1.0 / 3.0]])
VALUES = np.array([[[1.0, np.nan, 3.0]], [[0.1, -0.2, 1e-300]]])


@pytest.fixture
def path(tmp_path):
    """Return a file with two groups."""
    file = tmp_path / "evaluations.jsonl"
    record = Record(file, SEARCH)
    record.append(POINTS, VALUES)
    record.append(POINTS + 0.01, 2.0 * VALUES)
    record.close()
    return file


def opened_and_closed(path, search=SEARCH):
    record = Record(path, search)
    record.close()
    return record


def test_gives_back_every_bit(path):
    record = opened_and_closed(path)
    np.testing.assert_array_equal(record.recorded(0, POINTS), VALUES)
    np.testing.assert_array_equal(record.recorded(1, POINTS + 0.01), 2.0 * VALUES)
    assert record.recorded(2, POINTS) is None


def test_a_torn_last_line_is_cut_at_every_byte(path):
    whole = path.read_bytes()
    first = whole[:whole.rindex(b"\n", 0, -1) + 1]
    for end in range(len(first), len(whole)):
        path.write_bytes(whole[:end])
        assert opened_and_closed(path).recorded(1, POINTS + 0.01) is None
        assert path.read_bytes() == first


def test_goes_on_after_a_torn_line(path):
    whole = path.read_bytes()
    path.write_bytes(whole[:-7])
    record = Record(path, SEARCH)
    record.append(POINTS + 0.01, 2.0 * VALUES)
    record.close()
    assert path.read_bytes() == whole


@pytest.mark.parametrize("line", [b"nonsense", b"[]", b'{"points": [[0.1]]}', b"[" * 100_000, b"1" * 10_000,
                                  b'{"points": [[1e999]], "values": [[[0.0]]]}', b'{"points": "a", "values": 1}',
                                  b'{"points": [[0.1], [0.2]], "values": [[[0.0]]]}', b"\xff\xfe"])
def test_a_damaged_line_is_named(path, line):
    head, _, last = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(head + line + b"\n" + last)
    with pytest.raises(ValueError, match="line 2 is no group of candidates; delete"):
        Record(path, SEARCH)
    assert path.read_bytes() == head + line + b"\n" + last


def test_another_search_is_refused(path):
    with pytest.raises(ValueError, match="not the record of this search.*give another --output"):
        Record(path, {**SEARCH, "seed": 4})


@pytest.mark.parametrize("content", [b"", b"{}\n", b"\x00" * 100, b"points,values\n"])
def test_a_file_of_another_kind_is_refused_and_left(tmp_path, content):
    path = tmp_path / "evaluations.jsonl"
    path.write_bytes(content)
    with pytest.raises(ValueError, match="not the record of this search"):
        Record(path, SEARCH)
    assert path.read_bytes() == content


def test_other_candidates_are_refused(path):
    record = opened_and_closed(path)
    with pytest.raises(ValueError, match="its group 0 is of other candidates"):
        record.recorded(0, POINTS + 1e-12)


def test_a_link_and_a_pipe_are_refused(tmp_path, path):
    link, pipe = tmp_path / "link", tmp_path / "pipe"
    link.symlink_to(path)
    os.mkfifo(pipe)
    for other in (link, pipe):
        with pytest.raises(OSError, match="not a regular file"):
            Record(other, SEARCH)
