"""Refuses the lab, and what only the lab needs, in every Python that has this folder in PYTHONPATH: `make check`."""

import sys

REFUSED = {"vibro_lab", "benchmark", "research", "cma", "dask", "distributed", "gymnasium", "heyoka", "pyarrow"}


class WithoutLab:
    """A finder that finds nothing, first of all."""

    @staticmethod
    def find_spec(name: str, *_: object) -> None:
        """Raise what `import` raises where the package is not installed."""
        if name.partition(".")[0] in REFUSED:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


sys.meta_path.insert(0, WithoutLab)  # type: ignore[arg-type]
