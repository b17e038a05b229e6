"""Converts MaterialX documents (.mtlx) to USD layers, in place of Pixar's usdMtlx, which the usd-core wheels lack.

A material NAME is placed at /MaterialX/Materials/NAME, with its nodes below it.
Source: the specification of MaterialX 1.39.
"""

from __future__ import annotations

import posixpath
from collections.abc import Callable
from typing import Any
from xml.etree import ElementTree

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdShade

from renderer.errors import SceneError
from renderer.image.tonemap import decode_srgb
from renderer.library_messages import library_message
from renderer.scene.readers.usd.notes import Notes
from renderer.scene.readers.xml import refuse_entities
from renderer.scene.texture_colors import SRGB, common_space
from renderer.sentences import Sentence

__all__ = ["SUFFIX", "layer_of"]

SUFFIX = ".mtlx"
MAX_NODES = 100_000
MAX_INCLUDES = 64
_TYPES = Sdf.ValueTypeNames
_INCLUDE = "{http://www.w3.org/2001/XInclude}include"
_INHERITED = ("colorspace", "fileprefix")
_VECTORS = {
    "color3": (_TYPES.Color3f, Gf.Vec3f),
    "color4": (_TYPES.Color4f, Gf.Vec4f),
    "vector2": (_TYPES.Float2, Gf.Vec2f),
    "vector3": (_TYPES.Float3, Gf.Vec3f),
    "vector4": (_TYPES.Float4, Gf.Vec4f),
}
_OTHERS = {"float": _TYPES.Float, "integer": _TYPES.Int, "boolean": _TYPES.Bool, "filename": _TYPES.Asset}
Element = ElementTree.Element
Said = tuple[Element, dict[str, str]]  # an element with its inherited attributes


def layer_of(data: bytes, name: str, included: Callable[[str, str], tuple[str, bytes] | None], notes: Notes) -> Any:
    """Converts a MaterialX document to an anonymous USD layer.

    included: resolves a reference in a file to (name, bytes), or None if missing. Raises SceneError if a document is damaged or
    too large.
    """
    document = _Document(name, notes)
    waiting, known = [(name, data)], {name}
    while waiting:
        file, content = waiting.pop()
        for reference in document.add(file, content):
            found = included(reference, file)
            if found is None:
                notes.add_sentence(
                    Sentence(
                        "usd-materialx-include-missing",
                        "{file} includes the document {document}, which is not among the files; add it.",
                        file=file,
                        document=posixpath.basename(reference)[:120],
                    )
                )
            elif found[0] not in known and len(known) < MAX_INCLUDES:
                known.add(found[0])
                waiting.append(found)
    return document.layer()


class _Document:
    """The elements of a MaterialX document and of the documents that it includes."""

    def __init__(self, name: str, notes: Notes) -> None:
        self._name, self._notes = name, notes
        self._scopes: dict[str, dict[str, Said]] = {"": {}}  # elements by name, for each graph and the document itself
        self._count = 0
        self._color_config = ""  # the first that a document names

    def add(self, file: str, data: bytes) -> list[str]:
        """Adds a file's elements; returns the names of the files that it includes. Raises SceneError if the file is damaged."""
        refuse_entities(data, file)
        try:
            root = ElementTree.fromstring(data)
        except (ElementTree.ParseError, ValueError, LookupError) as error:
            raise SceneError(
                Sentence(
                    "usd-materialx-damaged",
                    "{file} is not a valid MaterialX document ({error}); export it again",
                    file=file,
                    error=library_message(error),
                )
            ) from error
        if root.tag != "materialx":
            raise SceneError(
                Sentence(
                    "usd-materialx-root-wrong",
                    "{file} is not a MaterialX document; it begins with {tag}",
                    file=file,
                    tag=root.tag[:40],
                )
            )
        if _number(root.get("version", "")) < 1.38:
            self._notes.add(
                Sentence(
                    "usd-materialx-too-old",
                    "MaterialX documents before 1.38 may be read incompletely; save them with a newer program",
                ),
                file,
            )
        self._color_config = self._color_config or root.get("cmsconfig", "")
        said = _inherited(root, {"fileprefix": ""})
        self._gather("", root, said)
        for graph in root.iter("nodegraph"):
            name = graph.get("name", "")
            self._scopes.setdefault(name, {})
            self._gather(name, graph, _inherited(graph, said))
        return [found for each in root.iter(_INCLUDE) if (found := each.get("href"))]

    def _gather(self, scope: str, parent: Element, attributes: dict[str, str]) -> None:
        for each in parent:
            self._scopes[scope].setdefault(each.get("name", ""), (each, attributes))

    def layer(self) -> Any:
        """Returns a layer that contains all materials of the document."""
        layer = Sdf.Layer.CreateAnonymous(".usda")
        if self._color_config:
            layer.colorConfiguration = Sdf.AssetPath(self._color_config)
        stage = Usd.Stage.Open(layer)
        stage.SetDefaultPrim(stage.DefinePrim("/MaterialX"))
        for element, said in list(self._scopes[""].values()):
            if element.tag in ("surfacematerial", "material"):
                self._material(stage, element, said)
        return layer

    def _material(self, stage: Any, element: Element, attributes: dict[str, str]) -> None:
        path = f"/MaterialX/Materials/{_identifier(element.get('name', ''))}"
        material = UsdShade.Material.Define(stage, path)
        waiting: list[tuple[Any, Element, dict[str, str], str]] = []
        known: dict[str, Any] = {}

        def node(scope: str, name: str) -> Any:
            """Returns the shader prim of a node, to be filled later; None if there is no such node."""
            found = self._scopes.get(scope, {}).get(name)
            if found is None or found[0].tag in ("nodegraph", "input", "output"):
                return None
            place = f"{path}/{_identifier(f'{scope}_{name}' if scope else name)}"
            if place not in known:
                self._count += 1
                if self._count > MAX_NODES:
                    raise SceneError(
                        Sentence(
                            "usd-materialx-nodes-too-many",
                            "{name}: its materials have more than {most} nodes in total; simplify them",
                            name=self._name,
                            most=MAX_NODES,
                        )
                    )
                known[place] = UsdShade.Shader.Define(stage, place)
                known[place].CreateIdAttr(f"ND_{found[0].tag}_{found[0].get('type', '')}")
                waiting.append((known[place], *found, scope))
            return known[place]

        for given in element.findall("input"):
            shader = node("", given.get("nodename", ""))
            if given.get("type") == "surfaceshader" and shader is not None:
                material.CreateSurfaceOutput("mtlx").ConnectToSource(shader.CreateOutput("out", _TYPES.Token))
            elif given.get("type") == "displacementshader" and shader is not None:
                material.CreateDisplacementOutput("mtlx").ConnectToSource(shader.CreateOutput("out", _TYPES.Token))
        while waiting:
            shader, own, told, scope = waiting.pop()
            told = _inherited(own, told)
            for given in own.findall("input"):
                self._input(shader, given, _inherited(given, told), scope, node)

    def _input(
        self, shader: Any, given: Element, attributes: dict[str, str], scope: str, node: Callable[[str, str], Any]
    ) -> None:
        """Sets an input of a shader to a connection or a value."""
        name, kind = given.get("name", ""), given.get("type", "")
        own = given.get("interfacename")
        if own is not None:
            outer = self._scopes.get(scope, {}).get(own)
            if outer is None or outer[0].tag != "input":
                return
            given, attributes, scope = outer[0], _inherited(outer[0], outer[1]), ""  # a graph's input continues outside the graph
        output, source = given.get("output"), None
        graph = given.get("nodegraph")
        if graph is not None:
            outputs = [each for each, _ in self._scopes.get(graph, {}).values() if each.tag == "output"]
            chosen = next((each for each in outputs if output in (None, each.get("name"))), None)
            if chosen is not None:
                source, output = node(graph, chosen.get("nodename", "")), chosen.get("output")
        elif given.get("nodename") is not None:
            source = node(scope, given.get("nodename", ""))
        if source is not None:
            type_name = _VECTORS[kind][0] if kind in _VECTORS else _OTHERS.get(kind, _TYPES.Token)
            shader.CreateInput(_identifier(name), type_name).ConnectToSource(
                source.CreateOutput(_identifier(output or "out"), type_name)
            )
        elif given.get("value") is not None:
            self._value(shader, _identifier(name), kind, given.get("value", ""), attributes)

    def _value(self, shader: Any, name: str, kind: str, text: str, attributes: dict[str, str]) -> None:
        space = attributes.get("colorspace", "")
        if kind == "filename":
            made = shader.CreateInput(name, _TYPES.Asset)
            made.Set(Sdf.AssetPath(attributes["fileprefix"] + text))
            if space:
                made.GetAttr().SetColorSpace(space)
            return
        if kind == "string":
            shader.CreateInput(name, _TYPES.String).Set(text)
            return
        if kind == "boolean":
            shader.CreateInput(name, _TYPES.Bool).Set(text.strip().lower() == "true")
            return
        try:
            numbers = [float(word) for word in text.replace(",", " ").split()]
            if kind in _VECTORS:
                type_name, vector = _VECTORS[kind]
                common = common_space(space)
                if kind.startswith("color") and common == SRGB:
                    numbers[:3] = decode_srgb(np.maximum(numbers[:3], 0.0)).tolist()
                made = shader.CreateInput(name, type_name)
                made.Set(vector(*numbers))
                if kind.startswith("color") and space and common is None:
                    made.GetAttr().SetColorSpace(space)
            elif kind in ("float", "integer"):
                shader.CreateInput(name, _OTHERS[kind]).Set(numbers[0] if kind == "float" else int(numbers[0]))
            else:
                self._notes.add(
                    Sentence("usd-materialx-value-types-unknown", "MaterialX values of these types are left out"),
                    f"{name} ({kind})",
                )
        except (ValueError, IndexError, OverflowError, TypeError, Tf.ErrorException):
            self._notes.add(
                Sentence("usd-materialx-values-not-numbers", "MaterialX values that are not numbers are left out"),
                f"{self._name} {name}",
            )


def _inherited(element: Element, attributes: dict[str, str]) -> dict[str, str]:
    """Returns the attributes that the children of an element inherit. attributes: those that the element itself inherits."""
    own = {name: value for name in _INHERITED if (value := element.get(name)) is not None}
    if "fileprefix" in own:
        own["fileprefix"] = attributes.get("fileprefix", "") + own["fileprefix"]
    return {**attributes, **own} if own else attributes


def _identifier(name: str) -> str:
    return str(Tf.MakeValidIdentifier(name.replace(":", "_")))


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return 0.0
