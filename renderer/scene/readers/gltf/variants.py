"""KHR_materials_variants: alternative sets of materials of a file."""

from __future__ import annotations

from renderer.scene.readers.gltf.container import Json
from renderer.scene.readers.name_lookup import number_of
from renderer.sentences import Sentence

__all__ = ["EXTENSION", "Variants"]

EXTENSION = "KHR_materials_variants"


class Variants:
    """A file's material variants by name, and the one that is selected.

    If none is selected, primitives have the file's own materials.
    """

    def __init__(self, root: Json, chosen: str | None) -> None:
        declared = root.extension(EXTENSION)
        sources = declared.objects("variants") if declared else []
        self.names = [source.text("name", "") or f"variant {i}" for i, source in enumerate(sources)]
        self._chosen = None if chosen is None else number_of("variant", self.names, chosen, root.file)

    def material_of(self, primitive: Json, materials: list[Json]) -> int | None:
        """Returns the index, in the file, of a primitive's material under the selected variant; None for the default material."""
        mapped = primitive.extension(EXTENSION) if self._chosen is not None else None
        for mapping in mapped.objects("mappings") if mapped else []:
            if self._chosen in mapping.indices("variants", self.names):
                if "material" not in mapping.value:
                    mapping.fault("material", Sentence("gltf-value-missing", "is missing"))
                elif (number := mapping.index("material", materials)) is not None:
                    return number
        return primitive.index("material", materials)
