"""Blocks that somebody else has written: one line names the file, and the block is computed again to the same bytes."""

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from vibro_ros.study import table as tables
from vibro_ros.study.basins import main as basins
from vibro_ros.study.diagram import main as diagram
from vibro_ros.study.map import main as command_map
from vibro_ros.study.orbits import main as orbits
from vibro_ros.study.sweep import main as sweep

#: Of each study one of its blocks, its `main`, and words that make it short.
STUDIES = {
    "sweep": ("blocks/block_000000.parquet", sweep, "--scene damped --vary guide.angle=0.7,1.1 --starts 2 --settling 1 "
              "--duration 0.5 --workers 1"),
    "basins": ("blocks/block_000000.parquet", basins, "--scene damped --starts 4 --workers 1"),
    "diagram": ("visits/block_000000.parquet", diagram, "--scene damped --vary motor.speed=99,100 --exponents 0 "
                "--cuts 0 --workers 1"),
    "map": ("lines/block_000001.parquet", command_map, "--scene damped --motor-speed 99:100:2 --gap=-1e-6:0:2 "
            "--curves 0 --quick --workers 1"),
    "orbits": ("branches/block_000001.parquet", orbits, "--scene damped --vary motor.speed=99.9:100.1 --from 100 "
               "--starts 1 --turns 1 --points 3 --workers 1"),
}


@pytest.fixture(scope="module", params=STUDIES)
def done(request, tmp_path_factory):
    """A study that is done: its `main`, its words, and the path of one of its blocks."""
    path, main, words = STUDIES[request.param]
    folder = tmp_path_factory.mktemp("study")
    words = [*words.split(), "--output", str(folder)]
    assert main(words) == 0
    return main, words, folder / path


def forged(path, forge):
    """Write other values into a block, with a digest that fits them."""
    table = pq.read_table(path)
    document, other = table.schema.metadata[b"vibro_ros"], forge(table)
    other = other.replace_schema_metadata({b"vibro_ros": document, b"digest": tables._digest(document, other)})
    pq.write_table(other, path, compression="zstd", write_page_checksum=True)


def with_column(table, place, values):
    """Return a table with other values of a column, as `values` has them."""
    return table.set_column(place, table.field(place).with_nullable(True), values)


def shorter_lists(table):
    """Return a table whose lists have lost their last number."""
    for place, field in enumerate(table.schema):
        if pa.types.is_list(field.type):
            lists = [one[:-1] if one else one for one in table[place].to_pylist()]
            table = with_column(table, place, pa.array(lists, field.type))
    return table


FORGERIES = {
    "no rows": lambda table: table.slice(0, 0),
    "fewer rows": lambda table: table.slice(1),
    "rows that repeat": lambda table: pa.concat_tables([table, table]),
    "one row in place of all": lambda table: table.take([0] * len(table)) if len(table) > 1 else table.slice(1),
    "no column": lambda table: table.drop_columns(table.column_names[-2:]),
    "a column of nulls": lambda table: with_column(table, 0, pa.nulls(len(table), table.schema.field(0).type)),
    "texts for numbers": lambda table: table.set_column(1, table.column_names[1], pa.array(["x"] * len(table))),
    "shorter lists": shorter_lists,
}


@pytest.mark.parametrize("forgery", FORGERIES)
def test_a_forged_block_is_named_and_computed_again(done, capsys, forgery):
    main, words, path = done
    if main is orbits and forgery == "fewer rows":
        pytest.skip("a branch has as many rows as it has, and a shorter one is a branch as well")
    whole = path.read_bytes()
    forged(path, FORGERIES[forgery])
    if pq.read_table(path).equals(pq.read_table(pa.BufferReader(whole))):
        pytest.skip("this study has no lists")
    assert main(words) == 0 and path.read_bytes() == whole
    assert f"study: {path}: is damaged; it is computed again" in capsys.readouterr().err.splitlines()


@pytest.mark.parametrize("document", [b"", b"no JSON", b"[" * 100_000, b"\xff"])
def test_a_block_whose_design_cannot_be_read_is_computed_again(tmp_path, capsys, document):
    file, main, words = STUDIES["sweep"]
    words, path = [*words.split(), "--output", str(tmp_path)], tmp_path / file
    assert main(words) == 0
    whole, table = path.read_bytes(), pq.read_table(path)
    table = table.replace_schema_metadata({b"vibro_ros": document, b"digest": tables._digest(document, table)})
    pq.write_table(table, path)
    assert main(words) == 0 and path.read_bytes() == whole
    assert f"{path}: is damaged; it is computed again" in capsys.readouterr().err
