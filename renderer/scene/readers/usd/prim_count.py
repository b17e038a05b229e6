"""Limits the number of prims in a stage before USD composes it.

Each level of references can double the number of prims, and USD expands all of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pxr import Sdf

from renderer.scene.readers.expansion_limits import check_expansion

__all__ = ["MAX_COMPOSED", "check_composition"]

MAX_COMPOSED = 4_000_000

Key = tuple[str, str]  # a layer's identifier, and a prim's path


def check_composition(layers: dict[str, Any], root: Any, file: str) -> None:
    """Checks the number of prims of the stage to compose. layers: by identifier; root: the root layer; file: name for errors.

    Raises SceneError if there are too many prims, or they are nested too deeply.
    """

    def children(key: Key) -> Iterator[Key]:
        layer = layers[key[0]]
        if key[1] == "/":
            yield from ((each, "/") for each in layer.subLayerPaths if each in layers)
            yield from ((key[0], str(prim.path)) for prim in layer.rootPrims)
            return
        prim = layer.GetPrimAtPath(key[1])
        if prim is None:
            return
        yield from ((key[0], str(child.path)) for child in prim.nameChildren)
        for info, given in (("references", "referenceList"), ("payload", "payloadList")):
            if prim.HasInfo(info):
                for arc in getattr(prim, given).GetAddedOrExplicitItems():
                    yield from _target(layers, arc.assetPath or key[0], arc.primPath)
        for info, given in (("inheritPaths", "inheritPathList"), ("specializes", "specializesList")):
            if prim.HasInfo(info):
                yield from ((key[0], str(path)) for path in getattr(prim, given).GetAddedOrExplicitItems())
        if prim.HasInfo("variantSetNames"):
            for variants in prim.variantSets:
                chosen = prim.variantSelections.get(variants.name) or next(iter(variants.variants.keys()), "")
                if chosen in variants.variants:
                    yield key[0], str(variants.variants[chosen].primSpec.path)

    check_expansion((root.identifier, "/"), children, file, MAX_COMPOSED, is_circle_error=False)


def _target(layers: dict[str, Any], identifier: str, path: Any) -> Iterator[Key]:
    if identifier not in layers:
        return
    if path == Sdf.Path.emptyPath:
        default = layers[identifier].defaultPrim
        if default:
            yield identifier, default if default.startswith("/") else f"/{default}"
    else:
        yield identifier, str(path)
