"""A Numba compiler pass that replaces NamedTuple fields of type None by the constant None before type inference.

So `scene.has.textures is not None` is False by the arguments' types alone. Numba removes a branch only if an argument itself is
None; this pass extends that to fields, so that kernels omit features that a scene lacks.
"""

from __future__ import annotations

from typing import Any

from numba.core import ir, types
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.ir_utils import get_definition, guard
from numba.core.typed_passes import AnnotateTypes, IRLegalization, NopythonRewrites
from numba.core.untyped_passes import InlineClosureLikes, InlineInlinables, IRProcessing, MakeFunctionToJitFunction
from numba.extending import intrinsic

from renderer.fused_multiply_add import FuseProducts
from renderer.inline_templates import InlineTemplates
from renderer.linking import ChooseLibrary
from renderer.reference import Reference

__all__ = ["Compiler", "function_if", "where_present"]

_OMITTED = (AnnotateTypes, NopythonRewrites, InlineClosureLikes, InlineInlinables)


@register_pass(mutates_CFG=False, analysis_only=False)
class PruneNoneFields(FunctionPass):
    """Replaces every field whose type is None by the constant None, so that Numba prunes the branches on it."""

    _name = "know_what_is_absent"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        """Runs the pass. Returns True if it changed anything."""
        found = False
        for block in state.func_ir.blocks.values():
            for statement in block.find_insts(ir.Assign):
                value = statement.value
                if _is_field(value) and isinstance(_type_of(state, value), types.NoneType):
                    statement.value = ir.Const(None, statement.loc)
                    definitions = state.func_ir._definitions[statement.target.name]
                    definitions[definitions.index(value)] = statement.value
                    found = True
        return found


class Compiler(CompilerBase):
    """Numba's nopython pipeline with InlineTemplates first, and PruneNoneFields before branches are pruned.

    Omitted are annotations, which nothing reads, rewriting of array expressions and inlining of closures, which kernels do not
    have, and Numba's own inlining of functions.
    """

    def define_pipelines(self) -> list[Any]:
        """Returns the nopython pipeline."""
        pipeline = DefaultPassBuilder.define_nopython_pipeline(self.state)
        pipeline.passes = [each for each in pipeline.passes if each[0] not in _OMITTED]
        pipeline.add_pass_after(InlineTemplates, IRProcessing)
        pipeline.add_pass_after(PruneNoneFields, MakeFunctionToJitFunction)
        pipeline.add_pass_after(FuseProducts, PruneNoneFields)
        pipeline.add_pass_after(ChooseLibrary, IRLegalization)
        pipeline.finalize()
        return [pipeline]


@intrinsic
def where_present(typingctx: Any, part: Any, value: Any) -> Any:
    """Returns `value` if `part` is present, else None. Decided at compile time by type, so that unused code is not compiled."""
    lacks = isinstance(part, types.NoneType)

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return context.get_dummy_value() if lacks else args[1]

    return (types.none if lacks else value)(part, value), codegen


@intrinsic
def function_if(typingctx: Any, part: Any, present: Any, absent: Any) -> Any:
    """Returns the function `present` if `part` is present, else the function `absent`. Decided by type: only one is compiled."""
    chosen = absent if isinstance(part, types.NoneType) else present
    return chosen(part, present, absent), lambda context, builder, sig, args: context.get_dummy_value()


def _is_field(value: Any) -> bool:
    return isinstance(value, ir.Expr) and value.op == "getattr"


def _type_of(state: Any, value: Any) -> Any:
    """Returns the type of an argument, or of a (nested) field of an argument; None for other variables."""
    if isinstance(value, ir.Arg):
        return state.args[value.index]
    if _is_field(value):
        whole: Any = _type_of(state, guard(get_definition, state.func_ir, value.value))
        if isinstance(whole, Reference):
            whole = whole.whole
        if isinstance(whole, types.NamedTuple | types.NamedUniTuple) and value.attr in whole.fields:
            return whole.types[whole.fields.index(value.attr)]
    return None
