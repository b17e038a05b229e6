"""A step of Numba's compiler: what a function asks of a part that its arguments do not have is answered before it is typed.

Where a field of a NamedTuple is None, `scene.has.textures is not None` is known to be False from the arguments' types alone.
Numba sees that of an argument which is itself None, and leaves out the branch; here the same is made true of fields, so that
a scene may say what it has.
"""

from __future__ import annotations

from typing import Any

from numba.core import ir, types
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.ir_utils import get_definition, guard
from numba.core.typed_passes import AnnotateTypes, IRLegalization, NopythonRewrites
from numba.core.untyped_passes import InlineInlinables
from numba.extending import intrinsic

from renderer.fused_multiply_add import FuseProducts
from renderer.linking import ChooseLibrary
from renderer.reference import Reference

__all__ = ["Compiler", "where_present"]


@register_pass(mutates_CFG=False, analysis_only=False)
class KnowWhatIsAbsent(FunctionPass):
    """Puts None in the place of every field that can be nothing else. Numba then prunes what hangs on it."""

    _name = "know_what_is_absent"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        """Whether anything was changed, as Numba asks of its passes."""
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
    """Numba's pipeline for functions without Python objects, with KnowWhatIsAbsent after templates are written into their callers
    and before branches are pruned. Two steps are left out: annotations, which nothing reads, and the search for sums of whole
    arrays, which kernels do not have.
    """

    def define_pipelines(self) -> list[Any]:
        """Returns the only way to compile."""
        pipeline = DefaultPassBuilder.define_nopython_pipeline(self.state)
        pipeline.passes = [each for each in pipeline.passes if each[0] not in (AnnotateTypes, NopythonRewrites)]
        pipeline.add_pass_after(KnowWhatIsAbsent, InlineInlinables)
        pipeline.add_pass_after(FuseProducts, KnowWhatIsAbsent)
        pipeline.add_pass_after(ChooseLibrary, IRLegalization)
        pipeline.finalize()
        return [pipeline]


@intrinsic
def where_present(typingctx: Any, part: Any, value: Any) -> Any:
    """The value where there is that part, else None: known by its type, so that what takes the value leaves out what wants it."""
    lacks = isinstance(part, types.NoneType)

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return context.get_dummy_value() if lacks else args[1]

    return (types.none if lacks else value)(part, value), codegen


def _is_field(value: Any) -> bool:
    return isinstance(value, ir.Expr) and value.op == "getattr"


def _type_of(state: Any, value: Any) -> Any:
    """The type of an argument, of a field of an argument, of a field of that ...; None of anything else."""
    if isinstance(value, ir.Arg):
        return state.args[value.index]
    if _is_field(value):
        whole: Any = _type_of(state, guard(get_definition, state.func_ir, value.value))
        if isinstance(whole, Reference):
            whole = whole.whole
        if isinstance(whole, types.NamedTuple | types.NamedUniTuple) and value.attr in whole.fields:
            return whole.types[whole.fields.index(value.attr)]
    return None
