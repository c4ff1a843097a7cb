"""A map at work: finds the lines that are done, sweeps the others, and writes each as soon as it is whole."""

from functools import partial
from pathlib import Path
from typing import cast

from vibro_ros.simulation.preparation import prepare_kernels
from vibro_ros.simulation.processes import in_processes
from vibro_ros.study.map.design import Line, MapDesign
from vibro_ros.study.map.record import LineRecord
from vibro_ros.study.map.visit import Visit, visits
from vibro_ros.study.progress import Progress


class MapRun:
    """The lines of a design in a folder that nobody else writes into.

    Parameters
    ----------
    design : MapDesign
        What is swept.
    folder : Path
        Of the lines.
    """

    def __init__(self, design: MapDesign, folder: Path):
        self._design, self._record = design, LineRecord(folder, design)
        self._done: dict[Line, list[Visit]] = {}

    @property
    def in_words(self) -> str:
        """How much is done."""
        return (f"{len(self._done)} of {len(self._design.lines())} lines are kept; the same command goes on from there")

    @property
    def visits(self) -> list[Visit]:
        """All that was found, line by line."""
        return [visit for line in self._design.lines() for visit in self._done[line]]

    def find_done(self) -> None:
        """Read the lines that are there (ValueError for files of another study, OSError for what cannot be read)."""
        self._record.check_folder()
        for line in self._design.lines():
            if (found := self._record.read(line)) is not None:
                self._done[line] = found

    def do_missing(self, workers: int) -> None:
        """Sweep the lines that are missing (RuntimeError when the disk refuses; what is done is kept)."""
        lines = self._design.lines()
        missing = [line for line in lines if line not in self._done]
        if not missing:
            return
        prepare_kernels("study", "exact")
        jobs = in_processes(partial(visits, self._design), missing, min(workers, len(missing)))
        try:
            with Progress("lines swept", "line", len(lines), len(self._done)) as progress:
                for line, job in zip(missing, jobs, strict=True):
                    self._keep(line, cast(list[Visit], job.outcome()))
                    progress.add(1)
        finally:
            jobs.close()

    def _keep(self, line: Line, found: list[Visit]) -> None:
        try:
            self._record.write(line, found)
        except OSError as error:
            raise RuntimeError(f"{self._record.path(line)}: {error.strerror}; free some room. "
                               f"{self.in_words}") from error
        self._done[line] = found
