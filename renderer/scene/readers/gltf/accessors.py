"""Reads arrays of glTF files: buffers, views and accessors (specification 3.6), with bounds checked before any access."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.scene.files import SceneFiles, data_uri
from renderer.scene.readers.gltf import meshopt
from renderer.scene.readers.gltf.container import Json
from renderer.scene.readers.gltf.faults import DamagedError
from renderer.sentences import Sentence

__all__ = ["Accessors", "as_floats"]

MAX_ELEMENTS = 1 << 26
MAX_VALUES = 1 << 29  # of all arrays together, since accessors without data make large arrays from small files

MAX_BARE = 1 << 22  # vertices and indices from accessors without data, all 0

_COMPONENT = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
_WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


def as_floats(values: npt.NDArray[Any], normalized: bool) -> npt.NDArray[np.float32]:
    """Returns float32 values. Normalized integers are decoded as max(c / maximum of the type, -1) (specification 3.6.2.2)."""
    if values.dtype.kind in "iu" and normalized:
        values = np.maximum(values.astype(np.float32) / np.float32(np.iinfo(values.dtype).max), np.float32(-1))
    return np.ascontiguousarray(values, np.float32)


class Accessors:
    """The arrays of one glTF file. Each buffer is opened at its first use."""

    def __init__(self, root: Json, binary: memoryview | None, files: SceneFiles) -> None:
        self._root, self._file = root, root.file
        self._binary = binary
        self._files = files
        self._buffers = root.objects("buffers")
        self._views = root.objects("bufferViews")
        self.accessors = root.objects("accessors")
        self._loaded: dict[int, memoryview] = {}
        self._unpacked_views: dict[int, memoryview] = {}
        self._values_given = self._bare = 0
        self._floats: dict[int, npt.NDArray[np.float32]] = {}
        self._finite: set[int] = set()

    def floats(self, index: int, *widths: int, finite: bool = True) -> npt.NDArray[np.float32]:
        """Returns the values of an accessor as (count, width) float32; normalized integers become 0..1 or -1..1.

        The result is cached and must not be written to. Raises DamagedError if its width is not among `widths`, and for values
        that are not finite unless `finite` is False.
        """
        known = self._floats.get(index)
        if known is not None and known.shape[1] in widths:
            values = known
        else:
            normalized = self.accessors[index].value.get("normalized") is True
            values = self._floats[index] = as_floats(self._values(index, widths), normalized)
        accessor = self.accessors[index]
        if finite and index not in self._finite:
            if not np.isfinite(values).all():
                raise DamagedError(
                    self._file,
                    accessor.where,
                    Sentence("gltf-values-not-finite", "contains values that are not finite numbers"),
                )
            self._finite.add(index)
        return values

    def integers(self, index: int) -> npt.NDArray[np.integer]:
        """Returns an accessor's (count,) indices in the integer type of the file. Raises DamagedError if they are floats."""
        values = self._values(index, (1,))
        if values.dtype.kind == "f":
            raise DamagedError(
                self._file,
                self.accessors[index].where,
                Sentence("gltf-indices-are-floats", "contains floats instead of indices"),
            )
        return values.reshape(-1)

    def count_empty_accessor(self, index: int) -> None:
        """Adds an accessor's element count to the total for accessors without a buffer view.

        Called before a mesh uses the accessor. Raises SceneError if the total is too large.
        """
        accessor = self.accessors[index]
        if "bufferView" not in accessor:
            self._bare += accessor.integer("count", high=MAX_ELEMENTS + 1)
        if self._bare > MAX_BARE:
            raise SceneError(
                Sentence(
                    "gltf-vertices-without-data",
                    "{file}: more than {million} million vertices or indices have no data "
                    "({place}.bufferView is missing); export the file again",
                    file=self._file,
                    million=MAX_BARE >> 20,
                    place=accessor.where,
                )
            )

    def view_bytes(self, index: int) -> memoryview:
        """Returns the bytes of a buffer view, decompressed if necessary."""
        view = self._views[index]
        packing = meshopt.extension_of(view)
        if packing is not None:
            return self._decompress(index, packing, view.integer("byteLength"))
        buffer = self._buffer(view.integer("buffer", high=len(self._buffers)))
        offset = view.integer("byteOffset", 0)
        length = view.integer("byteLength")
        if offset + length > len(buffer):
            raise DamagedError(
                self._file,
                view.where,
                Sentence("gltf-buffer-view-overrun", "reaches beyond the end of its buffer"),
                Sentence("gltf-file-damaged", "the file is damaged or incomplete, copy or export it again"),
            )
        return buffer[offset : offset + length]

    def _decompress(self, index: int, packing: Json, length: int) -> memoryview:
        if index not in self._unpacked_views:
            buffer = self._buffer(packing.integer("buffer", high=len(self._buffers)))
            offset, packed = packing.integer("byteOffset", 0), packing.integer("byteLength")
            if offset + packed > len(buffer):
                raise DamagedError(
                    self._file,
                    packing.where,
                    Sentence("gltf-buffer-view-overrun", "reaches beyond the end of its buffer"),
                    Sentence("gltf-file-damaged", "the file is damaged or incomplete, copy or export it again"),
                )
            self._unpacked_views[index] = meshopt.decode(packing, buffer[offset : offset + packed], length)
        return self._unpacked_views[index]

    @property
    def views(self) -> list[Json]:
        """The JSON objects of the buffer views."""
        return self._views

    def _buffer(self, index: int) -> memoryview:
        if index not in self._loaded:
            self._loaded[index] = self._open(self._buffers[index], index)
        return self._loaded[index]

    def _open(self, buffer: Json, index: int) -> memoryview:
        if "uri" not in buffer:
            if index != 0 or self._binary is None:
                raise DamagedError(
                    self._file,
                    buffer.where,
                    Sentence("gltf-data-missing", "has no data"),
                    Sentence("gltf-file-damaged", "the file is damaged or incomplete, copy or export it again"),
                )
            data = self._binary
        else:
            uri = buffer.text("uri", "")
            if uri.startswith("data:"):
                data = memoryview(data_uri(uri, f"{self._file}: {buffer.where}"))
            else:
                name = self._files.resolve_uri(uri, self._file)
                if name is None:
                    what = Sentence("gltf-uri-not-in-files", "is {uri}, which is not among the files", uri=uri[:120])
                    raise DamagedError(
                        self._file, buffer.where, what, Sentence("advice-add-file-or-glb", "add it, or export as .glb")
                    )
                data = memoryview(self._files.read(name))
        length = buffer.integer("byteLength")
        if length > len(data):
            self._root.faults.add_sentence(
                Sentence(
                    "gltf-buffer-short",
                    "{file}: {place} has {found} of {length} bytes; these are read.",
                    file=self._file,
                    place=buffer.where,
                    found=len(data),
                    length=length,
                )
            )
        return data[:length]

    def _values(self, index: int, widths: tuple[int, ...]) -> npt.NDArray[Any]:
        accessor = self.accessors[index]
        component = _COMPONENT.get(accessor.integer("componentType"))
        kind = accessor.text("type", "")
        width = _WIDTH.get(kind, 0)
        if component is None or width not in widths:
            raise accessor.damage(
                "type",
                Sentence(
                    "gltf-accessor-type-wrong",
                    "has type {kind} and component type {component_type}, which do not fit its use; export the file again",
                    kind=kind[:10],
                    component_type=accessor.value.get("componentType"),
                ),
            )
        count = accessor.integer("count", high=MAX_ELEMENTS + 1)
        self._values_given += count * width
        if self._values_given > MAX_VALUES:
            raise SceneError(
                Sentence(
                    "gltf-arrays-too-large",
                    "{file}: its arrays contain more than {million} million values; simplify its meshes",
                    file=self._file,
                    million=MAX_VALUES >> 20,
                )
            )
        if "bufferView" not in accessor or count == 0:
            values = np.zeros((count, width), component)
        else:
            view = accessor.integer("bufferView", high=len(self._views))
            values = self._strided(view, accessor.integer("byteOffset", 0), count, width, np.dtype(component), accessor.where)
        sparse = accessor.object("sparse")
        return self._apply_sparse(values, sparse) if sparse else values

    def _strided(self, view: int, offset: int, count: int, width: int, component: np.dtype[Any], where: str) -> npt.NDArray[Any]:
        data = self.view_bytes(view)
        size = width * component.itemsize
        stride = self._views[view].integer(
            "byteStride", size, low=size, high=253 if "byteStride" in self._views[view] else 1 << 10
        )
        if offset + stride * (count - 1) + size > len(data):
            raise DamagedError(
                self._file,
                where,
                Sentence("gltf-accessor-out-of-range", "reaches beyond the end of its data"),
                Sentence("gltf-file-damaged", "the file is damaged or incomplete, copy or export it again"),
            )
        little = component.newbyteorder("<")
        return np.ndarray((count, width), little, data, offset, (stride, component.itemsize))

    def _apply_sparse(self, values: npt.NDArray[Any], sparse: Json) -> npt.NDArray[Any]:
        # Sparse accessors (specification 3.6.2.3).
        count = sparse.integer("count", low=1, high=len(values) + 1)
        places, replacements = sparse.object("indices"), sparse.object("values")
        if places is None or replacements is None:
            raise sparse.damage("indices", Sentence("gltf-sparse-values-missing", "its indices or its values are missing"))
        component = _COMPONENT.get(places.integer("componentType"))
        if component not in (np.uint8, np.uint16, np.uint32):
            raise places.damage("componentType", Sentence("gltf-not-unsigned-integer", "is not an unsigned integer"))
        arrays = []
        for part, width, dtype in ((places, 1, np.dtype(component)), (replacements, values.shape[1], values.dtype)):
            view = part.integer("bufferView", high=len(self._views))
            arrays.append(self._strided(view, part.integer("byteOffset", 0), count, width, dtype, part.where))
        at = arrays[0].reshape(-1).astype(np.int64)
        if at.max() >= len(values):
            raise places.damage("bufferView", Sentence("gltf-sparse-index-invalid", "contains an index outside of the array"))
        result = values.copy()
        result[at] = arrays[1]
        return result
