"""Entries from Python for kernels that only other kernels call, so that tests can call them one by one."""

from types import ModuleType

import numba


class FromPython:
    """The kernels of a module, each compiled with an entry from Python when it is first named."""

    def __init__(self, module: ModuleType) -> None:
        self._module = module

    def __getattr__(self, name: str):
        kernel = getattr(self._module, name)
        entry = numba.njit(lambda *arguments: kernel(*arguments), error_model="numpy", _nrt=False)
        setattr(self, name, entry)
        return entry
