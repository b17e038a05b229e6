"""A step of Numba's compiler: what a function asks of a part that its arguments do not have is answered before it is typed.

Where a field of a NamedTuple is None, `scene.has.textures is not None` is known to be False from the arguments' types alone.
Numba sees that of an argument which is itself None, and leaves out the branch; here the same is made true of fields, so that
a scene may say what it has.
"""

from __future__ import annotations

from typing import Any

from numba.core import ir, types
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import FunctionPass, PassManager, _pass_registry, register_pass
from numba.core.ir_utils import get_definition, guard
from numba.core.typed_passes import IRLegalization, NopythonTypeInference
from numba.core.untyped_passes import InlineClosureLikes, InlineInlinables
from numba.extending import intrinsic

from renderer.left_out import LEFT_OUT, InlineClosures, Legalize
from renderer.linking import ChooseLibrary
from renderer.reference import Reference
from renderer.typed_before import TypeOnce

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


class _Steps(PassManager):
    """Numba's, which tells nobody of each step: to describe twenty for each of four hundred functions takes a twentieth of the
    time.
    """

    @global_compiler_lock
    def run(self, state: Any) -> None:
        """All of them, in their order."""
        for kind, _ in self.passes:
            step = _pass_registry.get(kind).pass_inst
            step.analysis = self._analysis
            step.run_initialization(state)
            step.run_pass(state)
            step.run_finalizer(state)


class Compiler(CompilerBase):
    """Numba's own, with that step after the templates are written into their callers, and before branches are pruned; operations
    are typed once, and steps are left out that find nothing.
    """

    def define_pipelines(self) -> list[Any]:
        """The steps of one way to compile."""
        steps = _Steps("nopython")
        own = {NopythonTypeInference: TypeOnce, InlineClosureLikes: InlineClosures, IRLegalization: Legalize}
        steps.passes = [
            (own.get(step, step), said)
            for step, said in DefaultPassBuilder.define_nopython_pipeline(self.state).passes
            if step not in LEFT_OUT
        ]
        steps.add_pass_after(KnowWhatIsAbsent, InlineInlinables)
        steps.add_pass_after(ChooseLibrary, Legalize)
        steps.finalize()
        return [steps]


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
