"""Compiles a kernel that is only inlined into other kernels, and never called by itself.

numba optimises every function that it compiles, with all that is inlined into it, and makes machine code of it: nine
tenths of that would never run. A part is compiled to intermediate code alone; the kernel that Python calls is optimised
once, as a whole.
"""

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.typed_passes import NativeLowering

from vibro_ros.solver.progress import progress


class _PartLibrary(JITCodeLibrary):
    """The intermediate code of a part, together with that of the parts which it calls."""

    def finalize(self):
        """Link in what the part calls; leave optimisation and machine code to the kernel that the part belongs to."""
        for library in dict.fromkeys(self._linking_libraries):
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)
class _OfferToCallers(LoweringPass):
    """Let other kernels call the part, which numba itself does once there is machine code."""

    _name = "offer_to_callers"

    def __init__(self):
        super().__init__()

    def run_pass(self, state):
        """Register the part."""
        # numba wants a built-in function here, for Python to call. Whatever it is called with, this one raises.
        state.cr = state.cr._replace(cfunc=[].remove)
        state.targetctx.insert_user_function(state.cr.cfunc, state.cr.fndesc, [state.library])
        progress.parts.add(state.func_id.func)
        return True


class PartCompiler(CompilerBase):
    """What numba's option `pipeline_class` takes, for a kernel that is part of others."""

    def define_pipelines(self):
        """numba's passes, but for the last: no machine code."""
        state = self.state
        state.flags.no_compile = True
        state.library = _PartLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        passes = DefaultPassBuilder.define_nopython_pipeline(state)
        passes.add_pass_after(_OfferToCallers, NativeLowering)
        passes.finalize()
        return [passes]
