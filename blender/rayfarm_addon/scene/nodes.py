"""Finds the node from which a socket gets its value, through reroutes, groups and muted nodes."""

from __future__ import annotations

from typing import Any, NamedTuple

from .temperature import blackbody

__all__ = [
    "Blend",
    "ConstantValue",
    "Product",
    "SocketInGroups",
    "Source",
    "SquareRoot",
    "constant_value",
    "output_of",
    "source_of",
]

PASSED = ("REROUTE",)
DEEPEST = 64


class SocketInGroups(NamedTuple):
    """A node socket, and the node groups that enclose it."""

    socket: Any
    groups: tuple[Any, ...] = ()

    def input(self, node: Any, *names: str) -> SocketInGroups | None:
        """Returns the first input with one of these names of a node in the same groups; None if the node has none of them."""
        for name in names:
            found = node.inputs.get(name)
            if found is not None:
                return SocketInGroups(found, self.groups)
        return None


class Source(NamedTuple):
    """A shader node, with the one of its outputs that is used, and the node groups that enclose the node."""

    node: Any
    output: Any
    groups: tuple[Any, ...]

    def input(self, *names: str) -> SocketInGroups | None:
        """Returns the node's first input that has one of these names; None if no input has."""
        return SocketInGroups(self.output, self.groups).input(self.node, *names)

    def input_at(self, number: int) -> SocketInGroups:
        """Returns the node's input with this index, from 0."""
        return SocketInGroups(self.node.inputs[number], self.groups)


class ConstantValue(NamedTuple):
    """A constant used in place of a socket: a number or a list of three."""

    value: Any


class Blend(NamedTuple):
    """A mix of two sockets, used in place of a socket. share: weight of the second."""

    share: Any
    first: Any
    second: Any


class Product(NamedTuple):
    """The product of the values of two sockets, used in place of a socket."""

    first: Any
    second: Any


class SquareRoot(NamedTuple):
    """The square root of a socket's colour, used in place of a socket."""

    of: Any


def source_of(socket: Any) -> tuple[Source | None, SocketInGroups | None]:
    """Returns what determines an input's value: a connected Source, or the input's own setting.

    The result is (Source, None), or (None, socket) if no node is connected, where `socket` has the value.
    """
    if isinstance(socket, ConstantValue | Blend | Product | SquareRoot):
        return None, None
    for _ in range(DEEPEST):
        if socket is None or not socket.socket.is_linked:
            return None, socket
        link = socket.socket.links[0]
        node, output = link.from_node, link.from_socket
        if not link.is_valid or link.is_muted:
            return None, socket
        if node.type in PASSED:
            socket = SocketInGroups(node.inputs[0], socket.groups)
        elif node.mute:
            through = next((each.from_socket for each in node.internal_links if each.to_socket == output), None)
            if through is None:
                return None, None
            socket = SocketInGroups(through, socket.groups)
        elif node.type == "GROUP" and node.node_tree is not None:
            inner = next((each for each in node.node_tree.nodes if each.type == "GROUP_OUTPUT" and each.is_active_output), None)
            found = None if inner is None else next((s for s in inner.inputs if s.identifier == output.identifier), None)
            if found is None:
                return None, None
            socket = SocketInGroups(found, (*socket.groups, node))
        elif node.type == "GROUP_INPUT" and socket.groups:
            outer = socket.groups[-1]
            found = next((s for s in outer.inputs if s.identifier == output.identifier), None)
            if found is None:
                return None, None
            socket = SocketInGroups(found, socket.groups[:-1])
        else:
            return Source(node, output, socket.groups), None
    return None, None


def output_of(tree: Any) -> Source | None:
    """Returns the Source connected to the surface output of a material's or a world's node tree."""
    for engine in ("CYCLES", "ALL", "EEVEE"):
        output = tree.get_output_node(engine)
        if output is not None:
            return source_of(SocketInGroups(output.inputs["Surface"]))[0]
    return None


def constant_value(socket: Any) -> Any:
    """Returns the value of a socket, a number or a list of three, if it depends on constants only; else None."""
    if isinstance(socket, ConstantValue):
        return socket.value
    if isinstance(socket, Blend):
        return _blended(*(constant_value(each) for each in socket))
    if isinstance(socket, Product):
        return _product(constant_value(socket.first), constant_value(socket.second))
    if isinstance(socket, SquareRoot):
        return _root(constant_value(socket.of))
    source, last = source_of(socket)
    if source is not None:
        if source.node.type in ("VALUE", "RGB"):
            return _number_or_list(source.output.default_value)
        kelvin = constant_value(source.input("Temperature")) if source.node.type == "BLACKBODY" else None
        return blackbody(kelvin) if isinstance(kelvin, float) else None
    return None if last is None else _number_or_list(getattr(last.socket, "default_value", None))


def _product(first: Any, second: Any) -> Any:
    if first is None or second is None:
        return None
    if isinstance(first, list) or isinstance(second, list):
        a, b = (each if isinstance(each, list) else [each] * 3 for each in (first, second))
        return [x * y for x, y in zip(a, b, strict=True)]
    return first * second


def _root(value: Any) -> Any:
    if value is None:
        return None
    return [max(c, 0.0) ** 0.5 for c in value] if isinstance(value, list) else max(value, 0.0) ** 0.5


def _blended(share: Any, first: Any, second: Any) -> Any:
    if first == second and first is not None:
        return first
    if share is None or first is None or second is None or isinstance(share, list):
        return None
    if isinstance(first, list) or isinstance(second, list):
        a, b = (each if isinstance(each, list) else [each] * 3 for each in (first, second))
        return [x + share * (y - x) for x, y in zip(a, b, strict=True)]
    return first + share * (second - first)


def _number_or_list(value: Any) -> Any:
    if value is None or isinstance(value, str | bool):
        return None
    if isinstance(value, int | float):
        return float(value)
    return [float(c) for c in value][:3]
