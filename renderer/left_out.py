"""Steps of Numba's compiler that no function of ours has something for, or hardly any: these are taken where one has.

Numba looks through each function for closures and sums of arrays, and works out anew each time where its variables end: a
twentieth of the time that kernels take to compile.
"""

from __future__ import annotations

from typing import Any

from numba.core.compiler_machinery import register_pass
from numba.core.typed_passes import AnnotateTypes, IRLegalization, NopythonRewrites
from numba.core.untyped_passes import InlineClosureLikes

__all__ = ["LEFT_OUT", "InlineClosures", "Legalize"]

# Nobody reads annotations, and they are kept with the machine code. What is rewritten after typing are sums of whole arrays,
# which ours, whose loops are written out, do not have: where one is, it is worked out an operation at a time.
LEFT_OUT = (AnnotateTypes, NopythonRewrites)


@register_pass(mutates_CFG=True, analysis_only=False)
class InlineClosures(InlineClosureLikes):
    """Numba's, where there are any."""

    _name = "inline_closures"

    def run_pass(self, state: Any) -> bool:
        """Whether anything was changed, as Numba asks of its passes."""
        for block in state.func_ir.blocks.values():
            if any(expression.op == "make_function" for expression in block.find_exprs()):
                return bool(super().run_pass(state))
        return False


@register_pass(mutates_CFG=False, analysis_only=True)
class Legalize(IRLegalization):
    """Numba's, which says where each variable ends, where anybody asks: where the references to arrays are counted."""

    _name = "legalize"

    def run_pass(self, state: Any) -> bool:
        """Whether anything was changed, as Numba asks of its passes."""
        return bool(state.flags.nrt and super().run_pass(state))
