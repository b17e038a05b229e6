"""A reference (pointer) to a NamedTuple of arrays, for passing scenes between functions of kernels.

Numba passes tuples by value: a scene of fifty arrays as some 350 words, which each call unpacks and each function packs again, in
as many instructions to emit, parse and optimise. A `Reference` is one word. Its fields are accessed like the tuple's, and are
loaded at each access.

A kernel that Python calls takes the tuple itself or, compiled faster, a `Packed` one: Numba's code that unpacks
a scene's arrays from Python objects takes as long to compile as a small kernel.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Callable, Hashable
from typing import Any

import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba import typeof
from numba.core import cgutils, types
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    intrinsic,
    lower_getattr_generic,
    models,
    register_model,
    typeof_impl,
    unbox,
)

__all__ = ["Packed", "Reference", "by_reference", "packed"]

_TUPLES = (types.NamedTuple, types.NamedUniTuple)
_TUPLE: Any = types.BaseTuple  # which Numba's annotations do not declare as iterable
# The codes of Python's module `struct` for the types of numbers; None is a pointer.
_CODES = {"bool": "?", "none": "Q", "float32": "f", "float64": "d", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H"}
_CODES |= {"int32": "i", "uint32": "I", "int64": "q", "uint64": "Q"}
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
    """Returns a reference to a NamedTuple, valid until the calling function returns; a reference itself is returned unchanged.

    May be passed only to functions that are called out of line, which treat the tuple as constant.
    """
    if isinstance(whole, Reference):
        return whole(whole), lambda context, builder, sig, args: args[0]

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


class Packed:
    """A NamedTuple in the layout that kernels read, to which kernels called with it get a reference.

    It must not be freed before they return. Changes of the arrays' elements are seen by kernels.
    """

    def __init__(self, whole: Any) -> None:
        self.type, layout = _type_and_layout(whole)
        self._whole = whole  # keeps the arrays
        self._bytes = np.frombuffer(layout.pack(*_words(whole, _address_of)), np.uint8)
        self.address = _address_of(self._bytes)


@typeof_impl.register(Packed)
def _type_of_packed(value: Packed, context: Any) -> Reference:
    return value.type


@unbox(Reference)
def _unpack(kind: Reference, value: Any, c: Any) -> Any:
    number = c.pyapi.object_getattr_string(value, "address")
    address = c.pyapi.long_as_voidptr(number)
    c.pyapi.decref(number)
    return NativeValue(address, is_error=c.pyapi.c_api_error())


def packed(value: Any, place: Callable[[npt.NDArray[Any]], int]) -> bytes:
    """Returns a NamedTuple's bytes in the layout that kernels read: a C struct, in which each array is a Numba array structure.

    place: returns the address of an array's data.
    """
    return _type_and_layout(value)[1].pack(*_words(value, place))


_known: dict[Hashable, tuple[Reference, struct.Struct]] = {}


def _type_and_layout(whole: Any) -> tuple[Reference, struct.Struct]:
    """Returns the type of references to a NamedTuple, and its layout; cached by what decides its type."""
    key = _key(whole)
    if key not in _known:
        kind, codes = typeof(whole), ["<"]
        end = _add_codes(codes, 0, kind)
        codes.append(f"{-end % _alignment(kind)}x")
        _known[key] = Reference(kind), struct.Struct("".join(codes))
    return _known[key]


def _key(value: Any) -> Hashable:
    """Returns a key that is equal for values of equal Numba types, in a twentieth of the time that `typeof` takes."""
    if isinstance(value, np.ndarray):
        flags = value.flags
        return value.dtype, value.ndim, flags.c_contiguous, flags.f_contiguous, flags.writeable, flags.aligned
    if isinstance(value, tuple):
        return type(value), *map(_key, value)
    return type(value)


def _add_codes(codes: list[str], end: int, kind: Any) -> int:
    """Adds a type's codes of the module `struct` to those of the `end` bytes before it; returns the new end."""
    alignment = _alignment(kind)
    start = -(-end // alignment) * alignment
    codes.append(f"{start - end}x")
    if isinstance(kind, _TUPLE):
        after = start
        for each in kind:
            after = _add_codes(codes, after, each)
        codes.append(f"{-after % alignment}x")
        return after + -after % alignment
    # Numba's array structure: two owners, which kernels do not read; count, item size, data, shape, strides.
    code, size = (f"{5 + 2 * kind.ndim}q", 8 * (5 + 2 * kind.ndim)) if isinstance(kind, types.Array) else (_code(kind), alignment)
    codes.append(code)
    return start + size


def _words(value: Any, place: Callable[[npt.NDArray[Any]], int]) -> list[Any]:
    """Returns the numbers that a NamedTuple's layout consists of."""
    if isinstance(value, np.ndarray):
        return [0, 0, value.size, value.itemsize, place(value), *value.shape, *value.strides]
    if isinstance(value, tuple):
        return [word for each in value for word in _words(each, place)]
    return [0 if value is None else value]


def _address_of(array: npt.NDArray[Any]) -> int:
    return int(array.__array_interface__["data"][0])


def _code(kind: Any) -> str:
    """Returns the code of a number in the module `struct`. Raises TypeError if a packed tuple cannot contain its type."""
    if kind.name not in _CODES:
        raise TypeError(f"packed tuples cannot contain {kind}")
    return _CODES[kind.name]


def _alignment(kind: Any) -> int:
    if isinstance(kind, _TUPLE):
        return max((_alignment(each) for each in kind), default=1)
    return 8 if isinstance(kind, types.Array) else struct.calcsize("<" + _code(kind))
