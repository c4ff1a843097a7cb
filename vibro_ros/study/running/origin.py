"""What the numbers of a study come from: the version, and the text of all modules that decide them."""

import functools
import hashlib
import pkgutil

from vibro_ros.simulation.provenance import software

_TURNS = tuple(("orbits", name) for name in ("turn_map", "stroboscope", "recurrence"))
_BRANCHES = (*_TURNS, *(("orbits", name) for name in (
    "branch_point", "continuation", "crossing", "event_order", "family", "newton", "passage", "special_points")))
#: By study, the modules whose text decides what is measured, beside those of the robot (`provenance`).
MODULES = {
    "sweep": (("accuracy", "starts"),
              *(("study", name) for name in ("lyapunov", "measures", "observation", "standing", "window")),
              *(("study.sweep", name) for name in ("design", "rows", "variation"))),
    "diagram": (*(("orbits", name) for name in ("cut", "lyapunov_spectrum", "newton", "recurrence", "stroboscope",
                                                "turn_map", "zero_one")),
                *(("study.diagram", name) for name in ("chain", "design", "nature"))),
    "orbits": (*_BRANCHES, *(("orbits", name) for name in ("branch", "cut", "follow_orbit", "orbit", "search",
                                                           "whole_branch")),
               *(("study.orbits", name) for name in ("branch_files", "plan", "run", "work"))),
    "basins": (*(("orbits", name) for name in ("cut", "fatal_shock", "recurrence", "stroboscope", "turn_map")),
               *(("study.basins", name) for name in ("rows", "shocks", "starts"))),
    "map": (*_TURNS, ("study", "standing"), ("study.map", "design"), ("study.map", "visit")),
    "map_curves": (*_BRANCHES, ("study.map", "curves")),
}


@functools.cache
def sources(study: str) -> dict[str, str]:
    """Version of the package, and a digest of all that decides the numbers of a study; equal where it may go on."""
    digest = hashlib.sha256(software()["sources"].encode())
    for room, name in MODULES[study]:
        digest.update(b"\n".join((pkgutil.get_data(f"vibro_ros.{room}", f"{name}.py") or b"").splitlines()))
    return {"version": software()["version"], "sources": digest.hexdigest()[:16]}


@functools.cache
def computes_with(study: str) -> dict[str, str]:
    """All that the bits of a study's run depend on besides its scene: where it is equal, numbers are equal to the last
    bit."""
    return {**software(), **sources(study)}
