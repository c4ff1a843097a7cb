"""What the numbers of a study come from: the version, and the text of all modules that decide them."""

import functools
import hashlib
import pkgutil

from vibro_ros.simulation.provenance import software

# Modules whose text decides what is measured, beside those of the robot (`provenance`).
_MODULES = (("accuracy", "starts"),
            *(("study", name) for name in ("lyapunov", "measures", "observation", "standing", "window")),
            *(("study.sweep", name) for name in ("design", "rows", "variation")))


@functools.cache
def sources() -> dict[str, str]:
    """Version of the package, and a digest of all that decides the numbers; equal where a study may be continued."""
    digest = hashlib.sha256(software()["sources"].encode())
    for room, name in _MODULES:
        digest.update(b"\n".join((pkgutil.get_data(f"vibro_ros.{room}", f"{name}.py") or b"").splitlines()))
    return {"version": software()["version"], "sources": digest.hexdigest()[:16]}


@functools.cache
def computes_with() -> dict[str, str]:
    """All that the bits of a run depend on besides its scene: where it is equal, numbers are equal to the last bit."""
    return {**software(), **sources()}
