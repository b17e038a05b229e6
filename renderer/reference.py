"""A reference (pointer) to a NamedTuple of arrays, for passing scenes between functions of kernels.

Numba passes tuples by value: a scene of fifty arrays as some 350 words, which each call unpacks and each function packs again, in
as many instructions to emit, parse and optimise. A `Reference` is one word. Its fields are accessed like the tuple's, and are
loaded at each access.
"""

from __future__ import annotations

import hashlib
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import AttributeTemplate
from numba.extending import infer_getattr, intrinsic, lower_getattr_generic, models, register_model

__all__ = ["Reference", "by_reference"]

_TUPLES = (types.NamedTuple, types.NamedUniTuple)
_USED = ("nitems", "itemsize", "data", "shape", "strides")  # the array fields that kernels without a heap use


class Reference(types.Type):
    """The Numba type of a reference to a NamedTuple. whole: the tuple's type."""

    def __init__(self, whole: types.NamedTuple | types.NamedUniTuple) -> None:
        self.whole = whole
        # Short, since it is part of the names of all functions that take one.
        digest = hashlib.sha256(_type_name(whole).encode()).hexdigest()[:12]
        super().__init__(f"Reference({whole.instance_class.__name__} {digest})")

    def field(self, name: str) -> types.Type | None:
        """Returns the type of a field: for a nested tuple of arrays, a reference to it. None if there is no such field."""
        if name not in self.whole.fields:
            return None
        found = self.whole.types[self.whole.fields.index(name)]
        return Reference(found) if isinstance(found, _TUPLES) and _has_arrays(found) else found


def _type_name(kind: types.Type) -> str:
    if not isinstance(kind, _TUPLES):
        return str(kind)
    fields = ", ".join(f"{name}: {_type_name(each)}" for name, each in zip(kind.fields, kind.types, strict=True))
    return f"{kind.instance_class.__name__}({fields})"


def _has_arrays(kind: types.Type) -> bool:
    return isinstance(kind, types.Array) or (isinstance(kind, _TUPLES) and any(map(_has_arrays, kind.types)))


register_model(Reference)(models.OpaqueModel)


@intrinsic
def by_reference(typingctx: Any, whole: Any) -> Any:
    """Returns a reference to a NamedTuple, valid until the calling function returns.

    May be passed only to functions that are called out of line, which treat the tuple as constant.
    """

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.bitcast(cgutils.alloca_once_value(builder, args[0]), cgutils.voidptr_t)

    return Reference(whole)(whole), codegen


@infer_getattr
class _Fields(AttributeTemplate):
    key = Reference

    def generic_resolve(self, reference: Any, name: str) -> Any:  # type: ignore[override]
        return reference.field(name)


@lower_getattr_generic(Reference)
def _read_field(context: Any, builder: Any, reference: Reference, value: Any, name: str) -> Any:
    whole = builder.bitcast(value, context.get_value_type(reference.whole).as_pointer())
    place = cgutils.gep_inbounds(builder, whole, 0, reference.whole.fields.index(name))
    found = reference.field(name)
    if isinstance(found, Reference):
        return builder.bitcast(place, cgutils.voidptr_t)
    if isinstance(found, types.Array):
        return _read_array(context, builder, found, place)
    return _read(builder, place)


def _read_array(context: Any, builder: Any, array: types.Array, place: Any) -> Any:
    model = context.data_model_manager[array]
    view = context.make_array(array)(context, builder)
    for member in _USED:
        setattr(view, member, _read(builder, cgutils.gep_inbounds(builder, place, 0, model.get_field_position(member))))
    return view._getvalue()


def _read(builder: Any, place: Any) -> Any:
    """Emits code that loads the value at a pointer, each number separately, so that the optimiser removes unused loads."""
    kind = place.type.pointee
    if isinstance(kind, ir.Aggregate):
        whole = ir.Constant(kind, ir.Undefined)
        for i in range(len(kind)):
            whole = builder.insert_value(whole, _read(builder, cgutils.gep_inbounds(builder, place, 0, i)), i)
        return whole
    loaded = builder.load(place)
    loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
    return loaded
