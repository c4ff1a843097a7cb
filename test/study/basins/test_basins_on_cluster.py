"""Basins on a Dask cluster: the bytes of one machine."""

import pytest
from distributed import LocalCluster

from vibro_ros.study.basins.command import main

WORDS = ["--scene", "damped", "--set", "effects.normal_force=printed", "--set", "mass.inclined=0.25", "--set",
         "guide.angle=1.3962634015954636", "--over", "body_velocity=-2:2:12", "--over", "crank_angle=0:6:12",
         "--shocks", "20"]


@pytest.fixture
def address():
    """A scheduler with two workers, which are processes of this machine."""
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        yield cluster.scheduler_address


def test_a_cluster_writes_the_bytes_of_one_machine(address, tmp_path):
    assert main([*WORDS, "--workers", "1", "--output", str(tmp_path / "here")]) == 0
    assert main([*WORDS, "--scheduler", address, "--output", str(tmp_path / "there")]) == 0
    here, there = ({str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*") if file.is_file()}
                   for folder in (tmp_path / "here", tmp_path / "there"))
    assert here == there and "shocks_20/block_000001.parquet" in here
