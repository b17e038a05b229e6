"""Opens a USD stage, restricted to layers among the scene's own files.

USD opens any path that a layer names. Therefore each layer is opened separately as an anonymous layer. Before composition,
the paths of its sublayers, references and payloads are replaced by the identifiers of these layers, or removed.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import PurePosixPath
from typing import Any

from pxr import Sdf, Tf, Usd, UsdUtils, Work

from renderer.errors import SceneError
from renderer.library_messages import position_in_text
from renderer.scene.readers.name_lookup import number_of
from renderer.scene.readers.usd import mtlx
from renderer.scene.readers.usd.notes import Notes
from renderer.scene.readers.usd.prim_count import check_composition
from renderer.scene.readers.usd.sources import LAYER_SUFFIXES, Sources
from renderer.sentences import Sentence

__all__ = ["Stage", "as_scene_errors", "muted", "open_stage"]

MAX_LAYERS = 5000

Work.SetConcurrencyLimit(1)  # a machine runs several readers


class Stage:
    """A composed stage, and the file that each of its layers was read from."""

    def __init__(self, stage: Any, files: dict[str, str], layers: list[Any], notes: Notes) -> None:
        self.stage, self.notes = stage, notes
        self._files, self._layers = files, layers  # keeps the anonymous layers alive

    def file_of(self, layer: Any) -> str:
        """Returns the name of the file that a layer was read from."""
        return self._files[layer.identifier]

    @property
    def color_config(self) -> tuple[str, str] | None:
        """Returns the OpenColorIO config that a layer names first, and that layer's file; None if no layer names one."""
        for layer in self._layers:
            if layer.HasColorConfiguration() and (named := layer.colorConfiguration.path):
                return str(named), self.file_of(layer)
        return None

    @cached_property
    def span(self) -> tuple[float, float] | None:
        """Returns the first and last time code with authored values; None if nothing is animated."""
        times = [time for layer in self._layers for time in (*_time_samples(layer), *_spline_knot_times(layer))]
        if times and any(
            _has_time_offset(layer) or layer.timeCodesPerSecond != self.stage.GetTimeCodesPerSecond() for layer in self._layers
        ):
            times = list(_composed_times(self.stage)) or times
        return (min(times), max(times)) if times else None


@contextmanager
def muted() -> Iterator[None]:
    """Runs a block without USD's warnings on the terminal. The reader converts the relevant ones to notes or errors."""
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        yield
    finally:
        delegate.TakeUncoalescedDiagnostics()


@contextmanager
def as_scene_errors(main: str) -> Iterator[None]:
    """Runs a block, and converts Tf.ErrorException, which USD raises, to a SceneError about the main file."""
    try:
        yield
    except Tf.ErrorException as error:
        reason = _error_text(error, "")
        raise SceneError(
            Sentence("usd-file-damaged-at", "{file} is damaged ({reason}); export it again", file=main, reason=reason)
            if reason
            else Sentence("usd-file-damaged", "{file} is damaged; export it again", file=main)
        ) from None


def open_stage(sources: Sources, main: str, variant: str | None) -> tuple[Stage, list[str]]:
    """Opens the stage of a scene file. Returns the stage, and its variants as `set=choice`.

    variant: the variant to select, or None. Raises SceneError if a file is damaged, missing or too complex, or the variant
    unknown.
    """
    notes = Notes()
    opener = _Opener(sources, notes)
    root = opener.open(sources.root_of(main))
    check_composition({layer.identifier: layer for layer in opener.opened.values()}, root, main)
    stage = Usd.Stage.Open(root, load=Usd.Stage.LoadAll)
    names = _variants(stage)
    if variant is not None:
        stage.SetEditTarget(stage.GetSessionLayer())
        at = number_of("variant", [f"{name}={choice}" for name, choice in names], variant, main)
        name, choice = names[at]
        for prim in _prims_offering_variants(stage):
            if name in prim.GetVariantSets().GetNames():
                prim.GetVariantSet(name).SetVariantSelection(choice)
    for error in stage.GetCompositionErrors():
        notes.add(
            Sentence("usd-references-unresolved", "References that lead nowhere are left out"),
            _error_location(error, opener.names),
        )
    return Stage(stage, opener.names, list(opener.opened.values()), notes), [f"{name}={choice}" for name, choice in names]


def _prims_offering_variants(stage: Any) -> list[Any]:
    """Returns the prims whose variants users can select: the default prim if it has variant sets, otherwise all root prims."""
    default = stage.GetDefaultPrim()
    return [default] if default and default.HasVariantSets() else list(stage.GetPseudoRoot().GetChildren())


def _variants(stage: Any) -> list[tuple[str, str]]:
    found: dict[tuple[str, str], None] = {}
    for prim in _prims_offering_variants(stage):
        for name in prim.GetVariantSets().GetNames():
            found |= dict.fromkeys((name, choice) for choice in prim.GetVariantSet(name).GetVariantNames())
    return list(found)


class _Opener:
    """Opens each layer of a stage once and caches it."""

    def __init__(self, sources: Sources, notes: Notes) -> None:
        self._sources, self._notes = sources, notes
        self.opened: dict[str, Any] = {}  # by file name
        self.names: dict[str, str] = {}  # file names by layer identifier

    def open(self, name: str) -> Any:
        """Opens the layer of a file and all layers it depends on, and replaces their paths with the opened layers' identifiers.

        Raises SceneError if the first layer cannot be read or there are too many layers.
        """
        waiting = [name]
        self._read(name)
        while waiting:
            beside = waiting.pop()
            layer = self.opened[beside]
            for reference in filter(None, layer.GetCompositionAssetDependencies()):  # internal references have an empty path
                found = self._find_file(reference, beside)
                if found is not None and reference in layer.subLayerPaths and self._is_sublayer(found, beside, layer):
                    found = None
                if found is not None and found not in self.opened:
                    try:
                        self._read(found)
                    except SceneError as error:
                        self._notes.add_sentence(Sentence("texture-left-out", "{error}; rendered without it.", error=error))
                        found = None
                    else:
                        waiting.append(found)
                self._redirect_dependency(layer, reference, "" if found is None else self.opened[found].identifier)
            self._without_clips(layer)
        return self.opened[name]

    def _is_sublayer(self, found: str, beside: str, layer: Any) -> bool:
        """Returns True, after adding a note, if a file cannot be added to a layer as a sublayer, since USD would reject it.

        That is the case if it already is a sublayer of the layer, or the layer's own file. found: the file that a sublayer path
        resolves to; beside: the layer's file. Files are also found by their bare names, so several paths may resolve to one file.
        """
        if found != beside and (found not in self.opened or self.opened[found].identifier not in layer.subLayerPaths):
            return False
        self._notes.add(
            Sentence("usd-sublayer-of-itself", "Layers that are their own sublayers are left out")
            if found == beside
            else Sentence("usd-sublayer-duplicate", "Sublayers that a layer names twice are read once"),
            beside,
        )
        return True

    @staticmethod
    def _redirect_dependency(layer: Any, reference: str, identifier: str) -> None:
        """Replaces a path in a layer by another layer's identifier, and sets the sublayers' time offsets again, which USD drops.

        reference: the path of a sublayer, reference or payload.
        """
        offsets = [o for path, o in zip(layer.subLayerPaths, layer.subLayerOffsets, strict=True) if path == reference]
        layer.UpdateCompositionAssetDependency(reference, identifier)
        at = [number for number, path in enumerate(layer.subLayerPaths) if identifier and path == identifier]
        for number, offset in zip(at, offsets, strict=False):
            layer.subLayerOffsets[number] = offset

    def _find_file(self, reference: str, beside: str) -> str | None:
        if reference.startswith("`"):
            self._notes.add(
                Sentence("usd-path-variables-unsupported", "Paths with variables are not supported and left out"), beside
            )
            return None
        found = self._sources.find(reference, beside)
        if found is None:
            why = Sentence("usd-file-not-in-files", "is not among the files; add it")
            if self._sources.is_outside(reference, beside):
                why = Sentence(
                    "usd-path-above-scene-folder",
                    "is above the scene's folder; give the folder that contains both, with --root or as the scene",
                )
            said = reference.split(":SDF_FORMAT_ARGS:")[0].replace("\\", "/")
            wanted = said if not PurePosixPath(said).is_absolute() and ":" not in said else PurePosixPath(said).name
            self._notes.add_sentence(
                Sentence(
                    "usd-layer-left-out",
                    "{file}: its layer {layer} {fault}. Rendered without it until then.",
                    file=beside,
                    layer=wanted[:200],
                    fault=why,
                )
            )
            return None
        if PurePosixPath(found.rstrip("]")).suffix.lower() not in (*LAYER_SUFFIXES, mtlx.SUFFIX):
            self._notes.add(Sentence("usd-references-not-layers", "Referenced files that are not USD layers are left out"), found)
            return None
        try:
            return self._sources.root_of(found)
        except SceneError as error:
            self._notes.add_sentence(Sentence("texture-left-out", "{error}; rendered without it.", error=error))
            return None

    def _read(self, name: str) -> None:
        if len(self.opened) >= MAX_LAYERS:
            raise SceneError(
                Sentence(
                    "usd-layers-too-many",
                    "{name} is layer number {number}, which is too many; flatten the stage",
                    name=name,
                    number=MAX_LAYERS + 1,
                )
            )
        if name.rstrip("]").lower().endswith(mtlx.SUFFIX):
            layer = mtlx.layer_of(self._sources.read(name), name, self._included, self._notes)
            self.opened[name] = layer
            self.names[layer.identifier] = name
            return
        path = self._sources.path(name)
        try:
            layer = Sdf.Layer.OpenAsAnonymous(path)
        except Tf.ErrorException as error:
            raise SceneError(
                Sentence(
                    "usd-layer-unreadable",
                    "{name} is damaged or not a USD layer. Export it again ({error})",
                    name=name,
                    error=_error_text(error, path),
                )
            ) from None
        if layer is None:
            raise SceneError(Sentence("usd-layer-damaged", "{name} is damaged or not a USD layer; export it again", name=name))
        self.opened[name] = layer
        self.names[layer.identifier] = name

    def _included(self, reference: str, beside: str) -> tuple[str, bytes] | None:
        found = self._sources.find(reference, beside)
        return None if found is None else (found, self._sources.read(found))

    def _without_clips(self, layer: Any) -> None:
        """Removes a layer's value clips, since composition would open their files directly."""

        def clear_clips(path: Any) -> None:
            if path.IsPrimPath() or path.IsPrimVariantSelectionPath():
                spec = layer.GetPrimAtPath(path)
                if spec is not None and spec.HasInfo("clips"):
                    spec.ClearInfo("clips")
                    self._notes.add(
                        Sentence("usd-value-clips-ignored", "Value clips are not supported; what they animate stands still"),
                        str(path),
                    )

        layer.Traverse(Sdf.Path.absoluteRootPath, clear_clips)


def _has_time_offset(layer: Any) -> bool:
    """Returns True if any sublayer, reference or payload of a layer has a time offset."""
    if any(not offset.IsIdentity() for offset in layer.subLayerOffsets):
        return True
    found: list[Any] = []

    def visit(path: Any) -> None:
        spec = layer.GetPrimAtPath(path) if path.IsPrimPath() or path.IsPrimVariantSelectionPath() else None
        for info, given in (("references", "referenceList"), ("payload", "payloadList")):
            if spec is not None and not found and spec.HasInfo(info):
                found.extend(arc for arc in getattr(spec, given).GetAddedOrExplicitItems() if not arc.layerOffset.IsIdentity())

    layer.Traverse(Sdf.Path.absoluteRootPath, visit)
    return bool(found)


def _composed_times(stage: Any) -> Iterator[float]:
    """Yields the times of the first and last sample of every animated attribute, in stage time."""
    for prim in stage.Traverse(Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)):
        for attribute in prim.GetAuthoredAttributes():
            if attribute.ValueMightBeTimeVarying() and (times := attribute.GetTimeSamples()):
                yield from (float(times[0]), float(times[-1]))


def _time_samples(layer: Any) -> list[float]:
    times = layer.ListAllTimeSamples()
    return [float(times[0]), float(times[-1])] if times else []


def _spline_knot_times(layer: Any) -> list[float]:
    """Returns the times of the first and last knot of a layer's splines; [] without splines.

    USD does not list knots as time samples.
    """
    if not hasattr(Sdf.AttributeSpec, "GetSpline"):  # before usd-core 25.5
        return []
    found: list[float] = []

    def visit(path: Any) -> None:
        if path.IsPropertyPath():
            spec = layer.GetAttributeAtPath(path)
            if spec is not None and spec.HasSpline():
                found.extend(float(time) for time in spec.GetSpline().GetKnots())

    layer.Traverse(Sdf.Path.absoluteRootPath, visit)
    return [min(found), max(found)] if found else []


def _error_location(error: Any, names: dict[str, str]) -> str:
    """Returns the location of a composition error, with file names in place of the identifiers of anonymous layers.

    names: file names by layer identifier.
    """
    said = _message_text(getattr(error, "rootSite", None) or error).splitlines()[0]
    for identifier, name in names.items():
        said = said.replace(identifier, name)
    return _without_addresses(said)


def _without_addresses(message: str) -> str:
    """Returns a text without the identifiers of anonymous layers, which contain memory addresses."""
    return re.sub(r",?@anon:[^@]*@|anon:0x[0-9a-fA-F]+(?::[\w.-]*)?", "", message)


def _message_text(message: Any) -> str:
    """Returns the text of a USD message; invalid UTF-8, which USD quotes from damaged files, is replaced."""
    try:
        return str(message)
    except UnicodeDecodeError as odd:
        return odd.object.decode("utf-8", "replace")


def _error_text(error: Exception, path: str) -> str:
    """Returns the reason given in a USD error message, at most 200 characters.

    Source locations and the folders of this machine are removed. path: a path to remove as well.
    """
    said = re.sub(
        r"(?:/[^/\s<>'\"]+)+/", "", _message_text(error).replace(path, "") if path else _message_text(error)
    ).splitlines()
    last = _without_addresses(next((line for line in said if " in file " in line), said[0] if said else ""))
    if (place := re.search(r":(\d+):(\d+): parse error", last)) is not None:
        return position_in_text(int(place[1]), int(place[2]))  # the rest is in the terms of USD's grammar
    return last.split(" : ", 1)[-1].strip(" '\"")[:200]
