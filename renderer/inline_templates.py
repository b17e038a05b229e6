"""A Numba compiler pass that inlines templates (renderer/jit.py) into their callers before type inference.

It replaces Numba's InlineInlinables, which runs all untyped passes on each callee, copies all variables of the callee with
each of its blocks, and inlines what a callee calls once more in each of its callers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba.core import ir, postproc
from numba.core.analysis import compute_cfg_from_blocks
from numba.core.bytecode import FunctionIdentity
from numba.core.compiler import StateDict
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.inline_closurecall import InlineWorker
from numba.core.ir_utils import get_definition, guard, require, simplify_CFG
from numba.core.untyped_passes import ExtractByteCode, FixupArgs, IRProcessing, TranslateByteCode

__all__ = ["InlineTemplates"]


class _Inliner(InlineWorker):
    """Numba's inliner for callees on which no pass has run: all passes run on the caller afterwards."""

    def run_untyped_passes(self, func: Callable[..., Any], enable_ssa: bool = False) -> Any:
        """Returns a function's IR as translated from its byte code, for one inlining."""
        state: Any = StateDict()
        state.func_ir = None
        state.func_id = FunctionIdentity.from_function(func)
        state.args = (None,) * len(state.func_id.pysig.parameters)
        for each in (ExtractByteCode, TranslateByteCode, FixupArgs, IRProcessing):
            each().run_pass(state)
        for block in state.func_ir.blocks.values():
            _share_in_copies(block.scope)
        return state.func_ir


@register_pass(mutates_CFG=True, analysis_only=False)
class InlineTemplates(FunctionPass):
    """Inlines all calls of templates, including those in the templates that it has inlined."""

    _name = "inline_templates"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        """Runs the pass. Returns True if it changed anything."""
        caller = state.func_ir
        inliner = _Inliner(state.typingctx, state.targetctx, state.locals, state.pipeline, state.flags)
        found = False
        waiting = list(caller.blocks.values())
        while waiting:
            block = waiting.pop()
            for position, statement in enumerate(block.body):
                template = guard(_called_template, caller, statement)
                if template is not None:  # the rest of the block is moved to one of the new blocks
                    *_, new_blocks = inliner.inline_function(caller, block, position, template)
                    waiting += [new for _, new in new_blocks]
                    found = True
                    break
        if found:
            for dead in compute_cfg_from_blocks(caller.blocks).dead_nodes():
                del caller.blocks[dead]
            postproc.PostProcessor(caller).run()
            caller.blocks = simplify_CFG(caller.blocks)
        return found


def _share_in_copies(scope: Any) -> None:
    """Makes copies of IR refer to this scope: `copy.deepcopy` returns the scope itself.

    The inliner copies the callee block by block, and each copy of a block would contain a copy of all variables.
    """
    scope.__deepcopy__ = lambda memo: scope


def _called_template(caller: Any, statement: Any) -> Callable[..., Any] | None:
    """Returns the Python function of the template that a statement calls, or None. To be called by `guard`."""
    require(isinstance(statement, ir.Assign) and isinstance(statement.value, ir.Expr) and statement.value.op == "call")
    called = get_definition(caller, statement.value.func)
    require(isinstance(called, ir.Global | ir.FreeVar))
    is_template = getattr(called.value, "targetoptions", {}).get("inline") == "always"
    return called.value.py_func if is_template else None
