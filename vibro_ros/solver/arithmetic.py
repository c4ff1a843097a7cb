"""What the compiled kernels make of a sum of products: it depends on the processor that they are compiled for."""

import llvmlite.binding as llvm
import numba

from vibro_ros.solver.compilation import entry_kernel

#: Features of a processor by which kernels round, or cut their loops, in another way.
_FEATURES = ("avx", "avx2", "avx512f", "avx512vl", "fma", "neon", "sve", "sve2")


@entry_kernel
def _sum_of_products(a, b, c):
    return a * b + c


def multiply_add() -> str:
    """How kernels multiply and add: `fused`, with one rounding, or `apart`, with two."""
    above_one = 1.0 + 2.0**-30  # whose square is 1 + 2^-29 and, beyond the digits of a double, 2^-60
    return "apart" if _sum_of_products(above_one, above_one, -1.0 - 2.0**-29) == 0.0 else "fused"


def processor() -> str:
    """The processor that kernels are compiled for, as LLVM calls it, and its features that matter to them."""
    name = numba.config.CPU_NAME or llvm.get_host_cpu_name()
    given = numba.config.CPU_FEATURES
    if given is None:
        found = {feature for feature, present in llvm.get_host_cpu_features().items() if present}
    else:
        found = {word[1:] for word in given.split(",") if word.startswith("+")}
    return " ".join([name, *(feature for feature in _FEATURES if feature in found)])
