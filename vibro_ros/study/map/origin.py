"""What the motions of a map come from: the version, and the text of all modules that decide them."""

import functools
import hashlib
import pkgutil

from vibro_ros.simulation.provenance import software

# Modules whose text decides what is found, beside those of the robot (`provenance`).
_MODULES = (*(("orbits", name) for name in ("turn_map", "stroboscope", "recurrence")), ("study", "standing"),
            *(("study.map", name) for name in ("design", "visit")))


@functools.cache
def sources() -> dict[str, str]:
    """Version of the package, and a digest of all that decides the motions; equal where a map may be continued."""
    digest = hashlib.sha256(software()["sources"].encode())
    for room, name in _MODULES:
        digest.update(b"\n".join((pkgutil.get_data(f"vibro_ros.{room}", f"{name}.py") or b"").splitlines()))
    return {"version": software()["version"], "sources": digest.hexdigest()[:16]}
