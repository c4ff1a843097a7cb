"""Who computes the pieces of a study: processes of this machine, or the workers of a cluster."""

from collections.abc import Iterator
from typing import Protocol

from vibro_ros.simulation.preparation import prepare_kernels
from vibro_ros.study.running.local import in_local_processes
from vibro_ros.study.running.pieces import Piece, Result, Work


class Runner(Protocol):
    """Who computes."""

    def __call__(self, work: Work[Result], methods: tuple[str, ...], items: Iterator[Piece]) -> Iterator[Result]:
        """What `work` makes of each piece, in order; `methods` are those whose kernels are needed."""


def on_this_machine(workers: int) -> Runner:
    """A runner with so many processes."""
    def run(work: Work[Result], methods: tuple[str, ...], items: Iterator[Piece]) -> Iterator[Result]:
        for method in methods:
            prepare_kernels("study", method)
        return in_local_processes(work, items, workers)

    return run


def on_cluster(address: str) -> Runner:
    """A runner on the Dask cluster at `address` (ValueError where `distributed` is not installed)."""
    def run(work: Work[Result], methods: tuple[str, ...], items: Iterator[Piece]) -> Iterator[Result]:
        return cluster.run_on_cluster(address, work, methods, items)

    try:
        from vibro_ros.study.running import cluster  # needs a package that only clusters need
    except ModuleNotFoundError as error:
        raise ValueError(f"{error.name}: not installed; `pip install vibro_ros[cluster]` brings what --scheduler "
                         "needs") from error
    return run
