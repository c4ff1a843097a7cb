"""The numerical kernels, compiled before a clock starts."""

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.simulation.motion import Motion


def kernel_count(method: str) -> int:
    """Number of kernels that `compile_kernels` sees to."""
    own = {"exact": 2}.get(method, 3)  # of the method's family
    return 3 + (2 + 3 if method == "auto" else own)  # three are shared by all


def compile_kernels(method: str = "exact") -> None:
    """Compile the numerical kernels of a `solver.method`, or load them from the cache."""
    for name in ("exact", "rk4") if method == "auto" else (method,):  # all steps of fixed length are one kernel
        motion = Motion(Scene(parameters={"solver.method": name}))
        motion.sampled(np.array([0.001]))
        motion.command(1.0, {"upper": 0.001})
        motion.sampled(np.array([0.001]))
