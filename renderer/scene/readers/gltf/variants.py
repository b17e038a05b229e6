"""KHR_materials_variants: one of several sets of materials that a file offers."""

from __future__ import annotations

from renderer.errors import SceneError
from renderer.scene.readers.gltf.container import Json

__all__ = ["EXTENSION", "Variants"]

EXTENSION = "KHR_materials_variants"


class Variants:
    """The variants of a file by their names, and the one that is shown: the file's own materials unless one is chosen."""

    def __init__(self, root: Json, chosen: str | None) -> None:
        declared = root.extension(EXTENSION)
        sources = declared.objects("variants") if declared else []
        self.names = [source.text("name", "") or f"variant {i}" for i, source in enumerate(sources)]
        self._chosen = None if chosen is None else self._number(chosen, root.file)

    def material_of(self, primitive: Json, materials: list[Json]) -> int | None:
        """The file's number of a primitive's material; None for the default one."""
        mapped = primitive.extension(EXTENSION) if self._chosen is not None else None
        for mapping in mapped.objects("mappings") if mapped else []:
            if self._chosen in mapping.indices("variants", self.names):
                return mapping.integer("material", high=len(materials))
        return primitive.index("material", materials)

    def _number(self, chosen: str, file: str) -> int:
        if chosen in self.names:
            return self.names.index(chosen)
        if chosen.isascii() and chosen.isdigit() and len(chosen) < 10 and int(chosen) < len(self.names):
            return int(chosen)
        if not self.names:
            raise SceneError(f"{file}: has no variants; leave the variant out")
        listed = ", ".join(f"{i}: {name[:60]}" for i, name in enumerate(self.names[:20]))
        raise SceneError(f"{file}: has no variant {chosen[:60]!r}; its variants are {listed}")
