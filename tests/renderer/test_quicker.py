"""What is found out once is what Numba would find out each time."""

from __future__ import annotations

import operator
from typing import Any

import pytest
from llvmlite import ir as llvm_ir
from numba.core import ir, types
from numba.core.compiler import run_frontend
from numba.core.errors import TypingError
from numba.core.registry import cpu_target

from renderer import quicker


def _everything(values: Any, start: int, *, last: Any = None) -> Any:
    total = start
    for i, value in enumerate(values[1:]):
        total += value * values[i] if value > 0 else -value
        values[i] = (total, [value, {i: last}])
    return total


def test_the_variables_of_instructions(monkeypatch: pytest.MonkeyPatch) -> None:
    blocks = run_frontend(_everything).blocks.values()
    instructions = [instruction for block in blocks for instruction in block.body]
    found = [[variable.name for variable in instruction.list_vars()] for instruction in instructions]
    monkeypatch.setattr(ir.Inst, "_rec_list_vars", quicker._list_rest)
    assert found == [[variable.name for variable in instruction.list_vars()] for instruction in instructions]
    assert sum(map(len, found)) > 50


def test_sizes_and_places_in_memory() -> None:
    context = cpu_target.target_context
    word, byte = llvm_ir.FloatType(), llvm_ir.IntType(8)
    kinds = [word, byte, llvm_ir.VectorType(word, 8), llvm_ir.LiteralStructType([byte, word]), llvm_ir.ArrayType(word, 3)]
    for _ in range(2):
        assert [context.get_abi_sizeof(kind) for kind in kinds] == [4, 1, 32, 8, 12]
        assert [context.get_abi_alignment(kind) for kind in kinds] == [4, 1, 32, 4, 4]


def test_what_operations_make_of_types() -> None:
    context = cpu_target.typing_context
    context.refresh()
    add = context.resolve_value_type(operator.add)
    for _ in range(2):
        assert add.get_call_type(context, (types.float32, types.float32), {}).return_type == types.float32
        assert add.get_call_type(context, (types.float32, types.int64), {}).return_type == types.float64
        with pytest.raises(TypingError):
            add.get_call_type(context, (types.float32, types.none), {})
