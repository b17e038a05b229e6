"""A compiler pass that fuses products with sums: exactly those products that are operands of a sum in the source.

In `a * b + c`, `c + a * b`, `a * b - c`, `c - a * b` and `c += a * b` the product is not rounded separately: one fused
multiply-add rounds the result once. Of two products in one sum the first is fused. A product that is assigned to a variable, or
computed by `product` of renderer/bvh/simd.py, is rounded. No other operations are merged: kernels are compiled without fast-math
flags, with which LLVM would fuse differently for each CPU, so that scalar code, eight lanes and other CPUs would differ in the
last bit.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from numba.core import ir, types
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.errors import TypingError
from numba.extending import intrinsic

from renderer.lane_types import called, f32x8, f64x8, lifted

__all__ = ["FuseProducts"]

_FLOATS = (types.float32, types.float64)
_ELEMENTS = {f32x8: types.float32, f64x8: types.float64}
_PLAIN: dict[Callable[..., Any], Callable[..., Any]] = {
    operator.add: operator.add,
    operator.sub: operator.sub,
    operator.iadd: operator.add,
    operator.isub: operator.sub,
}


def _is_fused(operands: tuple[Any, ...], product: Any, result: Any) -> bool:
    """Returns True if a sum of type `result` is fused with its product: for floats and for lanes.

    Operands of lanes may be scalars. Even a product of two scalars is then fused, so that one value has the same bits as eight
    lanes.
    """
    if result in _ELEMENTS:
        return all(kind in (result, _ELEMENTS[result]) for kind in operands)
    return result in _FLOATS and product == result


def _signature(typingctx: Any, function: Callable[..., Any], operands: tuple[Any, ...]) -> Any:
    """Returns the signature of an operation for operands of these types; None if there is none."""
    try:
        return typingctx.resolve_function_type(function, operands, {})
    except TypingError:
        return None


def _sum_with_product(combine: Callable[..., Any], product_first: bool) -> Any:
    """Returns the intrinsic (a, b, c) -> combine(a * b, c), or combine(c, a * b) if `product_first` is False.

    The intrinsic is fused for floating-point numbers and lanes; for other types it consists of two operations.
    """

    def sum_with_product(typingctx: Any, a: Any, b: Any, c: Any) -> Any:
        product = _signature(typingctx, operator.mul, (a, b))
        if product is None:
            return None
        pair = (product.return_type, c) if product_first else (c, product.return_type)
        function, whole = combine, _signature(typingctx, combine, pair)
        if whole is None:  # as Numba does for types without in-place operators
            function, whole = _PLAIN[combine], _signature(typingctx, _PLAIN[combine], pair)
        if whole is None:
            return None
        result = whole.return_type
        fused = _is_fused((a, b, c), product.return_type, result)

        def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            def cast(value: Any, kind: Any, wanted: Any) -> Any:
                return context.cast(builder, value, kind, wanted)

            if fused:
                if result in _ELEMENTS:
                    x, y, z = (lifted(builder, kind, value) for kind, value in zip(sig.args, args, strict=True))
                else:
                    x, y, z = (cast(value, kind, result) for kind, value in zip(sig.args, args, strict=True))
                if _PLAIN[combine] is operator.sub and product_first:
                    z = builder.fneg(z)
                elif _PLAIN[combine] is operator.sub:
                    x = builder.fneg(x)
                return called(builder, "fma", x, y, z)
            factors = [cast(*each) for each in zip(args[:2], sig.args[:2], product.args, strict=True)]
            value = context.get_function(operator.mul, product)(builder, factors)
            terms = [(value, product.return_type), (args[2], sig.args[2])]
            if not product_first:
                terms.reverse()
            summed = [cast(*term, wanted) for term, wanted in zip(terms, whole.args, strict=True)]
            return context.get_function(function, whole)(builder, summed)

        return result(a, b, c), codegen

    return intrinsic(sum_with_product)


_SUMS = {(combine, first): _sum_with_product(combine, first) for combine in _PLAIN for first in (True, False)}


@register_pass(mutates_CFG=False, analysis_only=False)
class FuseProducts(FunctionPass):
    """Replaces each sum with a product operand by one of `_SUMS`, before type inference."""

    _name = "fuse_products"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        """Runs the pass. Returns True if it changed anything."""
        changed = [_fuse(state.func_ir, block) for block in state.func_ir.blocks.values()]
        return any(changed)


def _fuse(func_ir: Any, block: Any) -> bool:
    """Fuses the products of a block that are used once, by a sum in the same expression; returns True if there were any."""
    uses: dict[str, int] = {}
    for statement in block.body:
        for variable in statement.list_vars():
            uses[variable.name] = uses.get(variable.name, 0) + 1
    products: dict[str, Any] = {}
    body: list[Any] = []
    for statement in block.body:
        body.append(statement)
        value = getattr(statement, "value", None)
        if not (isinstance(statement, ir.Assign) and isinstance(value, ir.Expr) and value.op in ("binop", "inplace_binop")):
            continue
        name = statement.target.name
        if value.fn is operator.mul and value.op == "binop":
            if statement.target.is_temp and uses[name] == 2:  # its assignment, and its use in the sum
                products[name] = statement
        elif (value.fn, True) in _SUMS:
            side = next((each for each in (value.lhs, value.rhs) if each.name in products), None)
            if side is not None:
                product = products.pop(side.name)
                body.remove(product)
                body.pop()
                body += _fused(func_ir, block.scope, statement, product, side is value.lhs)
    changed = len(body) != len(block.body) or any(a is not b for a, b in zip(body, block.body, strict=True))
    block.body[:] = body
    return changed


def _fused(func_ir: Any, scope: Any, statement: Any, product: Any, product_first: bool) -> list[Any]:
    """Returns the statements that replace a sum and the product in it by a fused operation."""
    whole, factors = statement.value, product.value
    function = _SUMS[whole.fn, product_first]
    target = scope.redefine("$sum_with_product", statement.loc)
    given = ir.Global("sum_with_product", function, statement.loc)
    call = ir.Expr.call(target, [factors.lhs, factors.rhs, whole.rhs if product_first else whole.lhs], (), statement.loc)
    definitions = func_ir._definitions
    definitions[target.name] = [given]
    definitions.pop(product.target.name, None)
    known = definitions[statement.target.name]
    known[known.index(whole)] = call
    return [ir.Assign(given, target, statement.loc), ir.Assign(call, statement.target, statement.loc)]
