"""The table of a study: the same bytes however often it is interrupted, no foreign files accepted, damage detected."""

import errno
import math
import os
import random
from functools import partial

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from vibro_lab.study import table as tables
from vibro_lab.study.basins import main as basins
from vibro_lab.study.diagram import main as diagram
from vibro_lab.study.execution import Execution
from vibro_lab.study.map import main as command_map
from vibro_lab.study.orbits import main as orbits
from vibro_lab.study.sweep import main as sweep
from vibro_lab.study.table import NUMBERS, Field, ForeignBlockError, Study, computed

FIELDS = [Field("point", pa.int64(), "1", "number"), Field("root", pa.float64(), "m", "of the number"),
          Field("powers", NUMBERS, "1", "of the number"), Field("error", pa.string(), "1", "never", True)]


def rows_of(computed_points, number):
    """Return two rows of a point, one of them with NaN, which is not equal to itself, and note that the point was
    computed.
    """
    computed_points.append(number)
    return [{"point": number, "root": math.nan if number == 4 else number**0.5 + sign,
             "powers": [float(number), number**2.0, sign]}
            for sign in (0.0, 1.0)]


@pytest.fixture
def study():
    """Return a study of 10 points in blocks of 3, and the list of computed points."""
    done = []
    return Study("points", {"design": "roots"}, FIELDS, partial(rows_of, done), 1000.0, 10, 3), done


def changed_study(study, **changes):
    """Return a study with some other attributes."""
    return Study(**{**{name: getattr(study, name) for name in Study.__dataclass_fields__}, **changes})


def table_and_files(study, folder):
    """Return the table of a study, computed in this process, and its files, which are those beside the blocks too."""
    folder.mkdir(exist_ok=True)
    return computed(study, folder / "blocks", Execution(1)), files_in(folder)


def files_in(folder):
    """Return the bytes of each file in the folder and in its `blocks` by name."""
    return {file.name: file.read_bytes() for file in folder.rglob("*") if file.is_file()}


def test_only_what_is_missing_is_computed_and_the_bytes_stay(study, tmp_path):
    roots, done = study
    table, files = table_and_files(roots, tmp_path / "whole")
    assert table["point"].to_pylist() == sorted(2 * list(range(10))) and done == list(range(10)) and len(files) == 5
    (tmp_path / "cut" / "blocks").mkdir(parents=True)
    for name in ("blocks.json", "blocks/block_000001.parquet"):
        (tmp_path / "cut" / name).write_bytes(files[name.rpartition("/")[2]])
    done.clear()
    assert table_and_files(roots, tmp_path / "cut")[1] == files and done == [0, 1, 2, 6, 7, 8, 9]


def test_a_damaged_file_is_computed_again_or_has_its_values(study, tmp_path):
    """A changed byte may go undetected if no value depends on it, as in the file's own description of its columns."""
    roots, draw = study[0], random.Random(3)
    table_and_files(roots, tmp_path)
    path = tmp_path / "blocks" / "block_000000.parquet"
    data, table, damaged = path.read_bytes(), pq.read_table(path), 0
    for place in [0, len(data) - 1, *(draw.randrange(len(data)) for _ in range(600))]:
        path.write_bytes(data[:place] + bytes([data[place] ^ 1 << draw.randrange(8)]) + data[place + 1:])
        block = tables.read_block(roots, tmp_path / "blocks", 0)
        damaged += block is None
        assert block is None or block.equals(table, check_metadata=True)
    assert damaged > 300  # at least half of them; all others are equal
    for cut in (b"", data[:100], data[:-1]):
        path.write_bytes(cut)
        assert table_and_files(roots, tmp_path)[1][path.name] == data


@pytest.mark.parametrize(("changes", "words"), [
    ({"design": {"design": "squares"}}, "design.design is roots there, squares here"),
    ({"block": 2}, "blocks is 4 there, 5 here")])
def test_blocks_of_another_design_are_refused_and_stay(study, tmp_path, changes, words):
    _, files = table_and_files(study[0], tmp_path)
    with pytest.raises(ForeignBlockError, match=words):
        table_and_files(changed_study(study[0], **changes), tmp_path)
    assert files_in(tmp_path) == files


def test_blocks_of_another_version_are_refused(study, tmp_path, monkeypatch):
    table_and_files(study[0], tmp_path)
    monkeypatch.setattr(tables, "fingerprint", lambda: {"version": "0.0.1", "sources": "0"})
    with pytest.raises(ForeignBlockError, match="version is"):
        table_and_files(study[0], tmp_path)


@pytest.mark.parametrize("design", [None, b"", b"no JSON", b"[" * 100_000, b"\xff", b"[]"])
def test_blocks_without_a_readable_design_are_refused_and_stay(study, tmp_path, design):
    _, files = table_and_files(study[0], tmp_path)
    del files["blocks.json"]
    (tmp_path / "blocks.json").unlink()
    if design is not None:
        (tmp_path / "blocks.json").write_bytes(design)
    with pytest.raises(ForeignBlockError, match="give another --output, or delete blocks and blocks.json there"):
        table_and_files(study[0], tmp_path)
    assert files.items() <= files_in(tmp_path).items()


def test_files_of_others_are_refused_and_stay(study, tmp_path):
    (tmp_path / "blocks").mkdir()
    (tmp_path / "blocks" / "mine.parquet").write_text("mine")
    with pytest.raises(ForeignBlockError, match=r"mine.parquet: is no block of this study"):
        table_and_files(study[0], tmp_path)
    assert (tmp_path / "blocks" / "mine.parquet").read_text() == "mine"


@pytest.mark.parametrize("make", [os.mkfifo, lambda path: path.symlink_to("/etc/passwd")])
def test_a_block_that_is_no_file_is_refused(study, tmp_path, make):
    table_and_files(study[0], tmp_path)
    (tmp_path / "blocks" / "block_000000.parquet").unlink()
    make(tmp_path / "blocks" / "block_000000.parquet")
    with pytest.raises((OSError, ValueError), match=r"block_000000\.parquet"):
        table_and_files(study[0], tmp_path)


@pytest.mark.parametrize("left", ["blocks/.block_000000.parquet.0123456789abcdef", ".blocks.json.0123456789abcdef"])
def test_what_an_interrupted_write_left_is_cleared(study, tmp_path, left):
    (tmp_path / "blocks").mkdir()
    (tmp_path / left).write_text("half")
    assert left.rpartition("/")[2] not in table_and_files(study[0], tmp_path)[1]


def test_a_full_disk_keeps_what_is_done_and_says_so(study, tmp_path, monkeypatch):
    real = tables.replace_file

    def full_after_two(path, data):
        if path.name.startswith("block_000002"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        real(path, data)

    monkeypatch.setattr(tables, "replace_file", full_after_two)
    with pytest.raises(RuntimeError, match="No space left on device; free some room. The blocks before it are kept"):
        table_and_files(study[0], tmp_path)
    assert sorted(files_in(tmp_path)) == ["block_000000.parquet", "block_000001.parquet", "blocks.json"]


#: Of each study one of its blocks, its `main`, and words that make it short.
STUDIES = {
    "sweep": ("blocks/block_000000.parquet", sweep, "--scene damped --vary guide.angle=0.7,1.1 --starts 2 --settling 1 "
              "--duration 0.5 --workers 1"),
    "basins": ("blocks/block_000000.parquet", basins, "--scene damped --over upper_velocity=0:1:2 "
               "--over crank_angle=0:1:2 --workers 1"),
    "diagram": ("visits/block_000000.parquet", diagram, "--scene damped --vary motor.speed=99,100 --exponents 0 "
                "--workers 1"),
    "map": ("lines/block_000001.parquet", command_map, "--scene damped --motor-speed 99:100:2 --gap=-1e-6:0:2 "
            "--quick --workers 1"),
    "orbits": ("branches/block_000001.parquet", orbits, "--scene damped --vary motor.speed=99.9:100.1 --from 100 "
               "--starts 1 --turns 1 --points 3 --workers 1"),
}


@pytest.mark.parametrize("name", STUDIES)
def test_each_study_computes_a_damaged_block_again_to_the_same_bytes(name, bytes_of, tmp_path, capsys):
    file, main, words = STUDIES[name]
    words = [*words.split(), "--output", str(tmp_path)]
    assert main(words) == 0
    content_before = bytes_of(tmp_path)
    (tmp_path / file).write_bytes(content_before[file][:-100])
    assert main(words) == 0 and bytes_of(tmp_path) == content_before
    assert f"study: {tmp_path / file}: is damaged; it is computed again" in capsys.readouterr().err.splitlines()
