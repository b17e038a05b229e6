"""Traverses a stage, and yields its geometry, lights and cameras with their transforms."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom, UsdLux, UsdPhysics, UsdShade, UsdSkel

from renderer.errors import SceneError
from renderer.scene.matrices import Matrix, product
from renderer.scene.readers.up_axis import Z_UP
from renderer.scene.readers.usd.metadata import is_z_up, unit_of
from renderer.scene.readers.usd.notes import Notes
from renderer.scene.visible_surfaces import all_hidden_note
from renderer.sentences import Sentence

__all__ = ["MAX_INSTANCES", "PlacedPrim", "matrix", "placed_prims"]

MAX_PRIMS = 2_000_000
MAX_INSTANCES = 500_000
MAX_DEPTH = 400
_LEVELS = "LODRootAPI"  # of UsdLod, new in usd-core 26
_DRAWN_PURPOSES = ("default", "render")
_DEFINED = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
# Prototypes may be `over` or `class` prims, which only their instancer draws.
_UNDEFINED = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsLoaded & ~Usd.PrimIsAbstract)
_ABSTRACT = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsLoaded)


@dataclass
class PlacedPrim:
    """A prim with its (N, 4, 4) transforms to metres with Y up, one per instance."""

    prim: Any
    places: Matrix
    moves: bool = False  # whether its transform or visibility is animated
    shown: bool = True
    name: str = ""


def upright(stage: Any, notes: Notes | None = None) -> Matrix:
    """Returns the (4, 4) transform from the stage's units and up axis to metres with Y up."""
    notes = Notes() if notes is None else notes
    unit = unit_of(stage, notes)
    turn = Z_UP if is_z_up(stage, notes) else np.eye(4)
    return product(turn, np.diag([unit, unit, unit, 1.0]))


def matrix(given: Any) -> Matrix:
    """Returns a USD matrix, which is for row vectors, transposed for column vectors."""
    return np.asarray(given, np.float64).T.copy()


def placed_prims(stage: Any, time: Any, notes: Notes) -> list[PlacedPrim]:
    """Returns the stage's geometry, lights, cameras and skeleton roots, in stage order.

    Prims with the purpose proxy are included only if no other geometry is visible.
    """
    walked = _Walk(stage, time, notes)
    found = list(walked.prims_below(stage.GetPseudoRoot(), upright(stage, notes)[None]))
    if walked.proxies and not walked.stands_in:
        if not any(each.prim.IsA(UsdGeom.Gprim) for each in found):
            notes.add_sentence(
                Sentence(
                    "usd-proxy-drawn",
                    "All visible prims have the purpose proxy, which is usually not rendered; they are drawn here.",
                )
            )
            walked = _Walk(stage, time, notes, (*_DRAWN_PURPOSES, "proxy"))
            found = list(walked.prims_below(stage.GetPseudoRoot(), upright(stage, notes)[None]))
        else:
            for path in walked.proxies:
                notes.add(
                    Sentence(
                        "usd-proxy-left-out",
                        "Prims of the purpose proxy are not drawn, although no prim of the purpose render replaces them",
                    ),
                    path,
                )
    surfaces = [each.shown for each in found if each.prim.IsA(UsdGeom.Gprim)]
    if surfaces and not any(surfaces):
        notes.add_sentence(all_hidden_note(len(surfaces)))
    names: dict[str, int] = {}
    for each in found:
        name = each.prim.GetName()
        if not (each.prim.IsA(UsdGeom.Gprim) or each.prim.IsA(UsdGeom.Camera) or each.prim.HasAPI(UsdLux.LightAPI)):
            continue  # parent transforms and skeletons often have the same name as their child
        names[name] = names.get(name, 0) + 1
        each.name = name if names[name] == 1 else f"{name} ({names[name]})"
    return found


class _Walk:
    def __init__(self, stage: Any, time: Any, notes: Notes, drawn: tuple[str, ...] = _DRAWN_PURPOSES) -> None:
        self._stage, self._time, self._notes, self._drawn = stage, time, notes, drawn
        self.proxies: list[str] = []  # proxy gprims left out; `stands_in`: whether there are gprims of purpose render
        self.stands_in = False
        self._seen = 0
        self._copies = 0

    def prims_below(self, top: Any, places: Matrix, depth: int = 0) -> Iterator[PlacedPrim]:
        """Yields the visible geometry, lights, cameras and skeleton roots among the descendants of a prim.

        places: (N, 4, 4) transforms of that prim, one per instance.
        """
        which = _ABSTRACT if top.IsAbstract() else _DEFINED if top.IsDefined() else _UNDEFINED
        stack = [(child, places, False, True, "default") for child in reversed(top.GetFilteredChildren(which))]
        while stack:
            prim, outer, moves, shown, purpose = stack.pop()
            self._seen += 1
            if self._seen > MAX_PRIMS or prim.GetPath().pathElementCount > MAX_DEPTH:
                raise SceneError(
                    Sentence(
                        "usd-prims-too-many",
                        "{prim}: exceeds the limit of {most} prims or the depth limit; flatten the stage",
                        prim=prim.GetPath(),
                        most=MAX_PRIMS,
                    )
                )
            if prim.GetTypeName() and not prim.IsA(Usd.Typed):
                self._notes.add(
                    Sentence(
                        "usd-prim-type-unknown",
                        "Prims of the unknown type {type} are left out",
                        type=prim.GetTypeName(),
                    ),
                    str(prim.GetPath()),
                )
            if prim.IsA(UsdPhysics.Scene):
                self._notes.add_sentence(
                    Sentence(
                        "usd-physics-ignored",
                        "Physics is not simulated: objects stay where the file places them.",
                    )
                )
            if prim.IsA(UsdShade.Material) or prim.IsA(UsdShade.Shader) or prim.IsA(UsdShade.NodeGraph):
                continue
            inner, moving = self._local(prim, outer)
            moves |= moving
            if prim.IsA(UsdGeom.Imageable):
                imageable = UsdGeom.Imageable(prim)
                visibility = imageable.GetVisibilityAttr()
                moves |= visibility.ValueMightBeTimeVarying()
                shown = shown and visibility.Get(self._time) != UsdGeom.Tokens.invisible
                attribute = imageable.GetPurposeAttr()
                if attribute.HasAuthoredValue():
                    purpose = str(attribute.Get())
                if purpose == "render" and prim.HasAPI(UsdGeom.VisibilityAPI):
                    own = UsdGeom.VisibilityAPI(prim).GetRenderVisibilityAttr()
                    shown = shown and not (own and own.Get(self._time) == UsdGeom.Tokens.invisible)
                self.stands_in |= purpose == "render"
                if purpose == "proxy" and "proxy" not in self._drawn and shown and prim.IsA(UsdGeom.Gprim):
                    self.proxies.append(str(prim.GetPath()))
                if purpose in self._drawn:
                    if prim.IsA(UsdGeom.PointInstancer):
                        if shown:
                            yield from self._instanced(prim, inner, moves, depth)
                        continue
                    yield PlacedPrim(prim, inner, moves, shown)
                elif prim.IsA(UsdSkel.Skeleton):  # even if a guide: its meshes use its transform
                    yield PlacedPrim(prim, inner, moves, shown=False)
            stack += [(c, inner, moves, shown, purpose) for c in reversed(self._children(prim, which))]

    def _children(self, prim: Any, predicate: Any) -> list[Any]:
        """Returns the children of a prim to visit; of levels of detail, only the default level."""
        children = list(prim.GetFilteredChildren(predicate))
        if len(children) > 1 and _LEVELS in prim.GetPrimTypeInfo().GetAppliedAPISchemas():
            said = prim.GetAttribute("lod:default:index")
            index = int((said.Get(self._time) if said else None) or 0)
            children = [children[min(max(index, 0), len(children) - 1)]]
            self._notes.add(
                Sentence("usd-lods-left-out", "Only the default level of detail is drawn"),
                str(prim.GetPath()),
            )
        return children

    def _local(self, prim: Any, outer: Matrix) -> tuple[Matrix, bool]:
        """Returns a prim's (N, 4, 4) transforms to metres with Y up, and whether its own local transform is animated.

        outer: (N, 4, 4) transforms of the parent.
        """
        if not prim.IsA(UsdGeom.Xformable):
            return outer, False
        xformable = UsdGeom.Xformable(prim)
        if not xformable.GetXformOpOrderAttr().HasAuthoredValue():
            return outer, False
        own = xformable.GetLocalTransformation(self._time)
        if xformable.GetResetXformStack():
            outer = upright(self._stage)[None]
        inner = product(outer, matrix(own))
        if not np.isfinite(inner).all():
            self._notes.add(
                Sentence("usd-transforms-not-finite", "Transforms that are not finite are ignored"),
                str(prim.GetPath()),
            )
            inner = outer
        return inner, bool(xformable.TransformMightBeTimeVarying())

    def _instanced(self, prim: Any, outer: Matrix, moves: bool, depth: int) -> Iterator[PlacedPrim]:
        """Yields the prims of a PointInstancer's prototypes, with one transform per instance.

        outer: the instancer's own transforms.
        """
        instancer = UsdGeom.PointInstancer(prim)
        said = instancer.GetProtoIndicesAttr().Get(self._time) or ()
        if len(said) > MAX_INSTANCES:
            raise SceneError(
                Sentence(
                    "usd-instancer-too-large",
                    "{prim}: shows its prototypes more than {most} times; reduce them",
                    prim=prim.GetPath(),
                    most=MAX_INSTANCES,
                )
            )
        indices = np.asarray(said, np.int64)
        targets = instancer.GetPrototypesRel().GetForwardedTargets()
        given = instancer.ComputeInstanceTransformsAtTime(
            self._time, self._time, UsdGeom.PointInstancer.IncludeProtoXform, UsdGeom.PointInstancer.IgnoreMask
        )
        places = np.asarray(given, np.float64).reshape(-1, 4, 4).transpose(0, 2, 1) if given else np.zeros((0, 4, 4))
        mask = np.asarray(instancer.ComputeMaskAtTime(self._time) or (), bool)
        count = min(len(indices), len(places))
        kept = mask[:count] if len(mask) >= count else np.ones(count, bool)
        usable = (indices[:count] >= 0) & (indices[:count] < len(targets)) & np.isfinite(places[:count]).all(axis=(1, 2))
        if lost := int((kept & ~usable).sum()):
            self._notes.add(
                Sentence(
                    "usd-instances-invalid",
                    "{count} instances without a prototype or with a position that is not finite are left out",
                    count=lost,
                ),
                str(prim.GetPath()),
            )
        kept &= usable
        if count == 0 or len(places) != len(indices) or depth > 8:
            self._notes.add(
                Sentence(
                    "usd-instancers-damaged",
                    "Point instancers that are damaged, empty or nested too deeply are left out",
                ),
                str(prim.GetPath()),
            )
            return
        said_of_each = [p for p in UsdGeom.PrimvarsAPI(prim).GetPrimvarsWithValues() if p.GetInterpolation() != "constant"]
        if said_of_each and count > 1:
            named = ", ".join(str(primvar.GetPrimvarName()) for primvar in said_of_each[:3])
            self._notes.add(
                Sentence(
                    "usd-instance-primvars-dropped",
                    "Primvars of point instancers ({primvars}) are left out",
                    primvars=named,
                ),
                str(prim.GetPath()),
            )
        attributes = instancer.GetPositionsAttr(), instancer.GetOrientationsAttr(), instancer.GetScalesAttr()
        moves |= any(a.ValueMightBeTimeVarying() for a in (*attributes, instancer.GetProtoIndicesAttr()))
        for number, target in enumerate(targets):
            which = np.flatnonzero(kept & (indices[:count] == number))
            prototype = self._stage.GetPrimAtPath(target)
            if len(which) and not prototype:
                self._notes.add(
                    Sentence(
                        "usd-prototypes-missing",
                        "Prototypes that are missing in the stage are left out, {count} times",
                        count=len(which),
                    ),
                    str(target),
                )
            if len(which) == 0 or not prototype:
                continue
            self._copies += len(which) * len(outer)
            if self._copies > MAX_INSTANCES:
                raise SceneError(
                    Sentence(
                        "usd-instancer-too-large",
                        "{prim}: shows its prototypes more than {most} times; reduce them",
                        prim=prim.GetPath(),
                        most=MAX_INSTANCES,
                    )
                )
            own = product(outer[:, None], places[which][None]).reshape(-1, 4, 4)
            for each in self._prototype(prototype, depth + 1):
                whole = product(own[:, None], each.places[None]).reshape(-1, 4, 4)
                yield replace(each, places=whole, moves=moves or each.moves)

    def _prototype(self, prototype: Any, depth: int) -> Iterator[PlacedPrim]:
        """Yields the prims of a PointInstancer's prototype, placed without the prototype's own transform.

        The transforms of the instances include that transform.
        """
        still = np.eye(4)[None]
        if prototype.IsA(UsdGeom.PointInstancer):
            yield from self._instanced(prototype, still, False, depth)
            return
        if prototype.IsA(UsdGeom.Imageable):
            imageable = UsdGeom.Imageable(prototype)
            if imageable.GetVisibilityAttr().Get(self._time) == UsdGeom.Tokens.invisible:
                return
            if str(imageable.ComputePurpose()) not in self._drawn:
                return
            yield PlacedPrim(prototype, still)
        yield from self.prims_below(prototype, still, depth)
