"""Finds the materials of an OBJ file, in its material libraries or in other files of its folder."""

from __future__ import annotations

from pathlib import PurePosixPath

from renderer.image.read import IMAGE_SUFFIXES
from renderer.scene.description import Material, Mesh, SceneDescription
from renderer.scene.files import SceneFiles, case_folded
from renderer.scene.readers.mtl import names_of, read_mtl, without_comment
from renderer.scene.readers.obj_lines import Statements
from renderer.scene.text_encoding import is_readable, possible_decodings
from renderer.scene.textures import TextureShelf
from renderer.scene.watertight import is_closed
from renderer.sentences import Sentence

__all__ = ["Materials"]

_ENVIRONMENT_SUFFIXES = (".exr", ".hdr", ".pic", ".pfm")  # environment maps, not surface textures


class Materials:
    """The materials that an OBJ file's faces name, as indices in the scene description."""

    def __init__(
        self, file: str, statements: Statements, files: SceneFiles, shelf: TextureShelf, description: SceneDescription
    ) -> None:
        self._file, self._files, self._shelf, self._description = file, files, shelf, description
        self._found: dict[str, Material] = {}
        is_missing = False
        for library in statements.libraries:
            names = self._libraries(library)
            is_missing |= not names
            if not names and not self._guess_material_file(statements):
                shelf.warn_of_surface(
                    Sentence(
                        "obj-material-library-missing",
                        "{file}: its material files {libraries} are not among the files; add them. Rendered in grey until then.",
                        file=file,
                        libraries=library[:120],
                    )
                )
            for name in names:
                self._read_file(name)
        wanted = any(name for _, name in statements.materials)
        if (is_missing or (not statements.libraries and wanted)) and (guess := self._guess_material_file(statements)):
            self._read_file(guess)
            why = (
                Sentence(
                    "obj-libraries-missing", "its material files {libraries} are missing", libraries=statements.libraries[0][:120]
                )
                if is_missing
                else Sentence("obj-library-unnamed", "names no material file")
            )
            shelf.warn_of_surface(
                Sentence(
                    "obj-library-guessed", "{file}: {reason}; {library} is used instead.", file=file, reason=why, library=guess
                )
            )
        self._bare = not statements.libraries and not self._found
        if self._bare and wanted:
            count = len({name for _, name in statements.materials if name})
            shelf.warn_of_surface(
                Sentence(
                    "obj-material-files-missing",
                    "{file}: its faces use {count} materials, but there is no material file; add it.",
                    file=file,
                    count=count,
                )
            )

    def _read_file(self, name: str) -> None:
        self._found.update(read_mtl(self._files, name, self._shelf))

    def _libraries(self, words: str) -> list[str]:
        """Returns the files of a mtllib statement: a single one, whose name may contain spaces, or several."""
        for said in dict.fromkeys((words, without_comment(words))):
            if name := self._files.find(said, self._file):
                return [name]
        found = {word: self._files.find(word, self._file) for word in without_comment(words).split()}
        missing = [word for word, name in found.items() if not name]
        if len(missing) < len(found):
            for word in missing:
                self._shelf.warn_of_missing(word, self._file)
        return [name for name in found.values() if name]

    def _guess_material_file(self, statements: Statements) -> str | None:
        """Returns a material file to use if none is named or found; None if there is no candidate.

        Candidates are the file with the OBJ file's name, or the only one in its folder if it defines a material that faces name.
        """
        beside = self._files.siblings(self._file, (".mtl",))
        stem = case_folded(PurePosixPath(self._file).stem)
        same = [name for name in beside if case_folded(PurePosixPath(name).stem) == stem]
        if len(same) == 1:
            return same[0]
        if len(beside) != 1:
            return None
        has = {without_comment(name) for name in names_of(self._files, beside[0])}
        return beside[0] if any(without_comment(name) in has for _, name in statements.materials) else None

    def number(self, name: str | None, meshes: list[Mesh]) -> int:
        """Adds a material to the scene description at its first use; returns its index there.

        meshes: the meshes that use the material. Glass becomes thin on meshes that are not closed (docs/scene-format.md).
        """
        material = self._found.get(name or "") or self._found.get(without_comment(name or ""))
        if material is None and name and self._found:
            material = self._in_another_encoding(name)
        if material is None:
            material = Material(name or "default")
            if any(mesh.colors is not None for mesh in meshes):
                material.base_color = (1.0, 1.0, 1.0)
            if self._bare and any(mesh.uvs is not None for mesh in meshes):
                material.base_color_texture = self._lone_texture(material)
            elif name is not None and self._found:
                self._shelf.warn_of_surface(
                    Sentence(
                        "obj-material-undefined",
                        "{file}: no material file defines {name}; it is shown grey.",
                        file=self._file,
                        name=name[:120],
                    )
                )
        if material.kind == "glass":
            material.thin = not all(is_closed(mesh.positions, mesh.triangles) for mesh in meshes)
        self._description.materials.append(material)
        return len(self._description.materials) - 1

    def _in_another_encoding(self, name: str) -> Material | None:
        """Returns the material whose name equals this one when decoded with another encoding; None if there is none.

        Such a name is possible only if just one of the OBJ and MTL files is in UTF-8.
        """
        if not is_readable(name):
            return next((self._found[text] for _, text in possible_decodings(name) if text in self._found), None)
        others = (key for key in self._found if not is_readable(key))
        return next((self._found[key] for key in others if any(text == name for _, text in possible_decodings(key))), None)

    def _lone_texture(self, material: Material) -> int | None:
        images = [
            name for name in self._files.siblings(self._file, IMAGE_SUFFIXES) if not name.lower().endswith(_ENVIRONMENT_SUFFIXES)
        ]
        if len(images) != 1:
            return None
        texture = self._shelf.texture(self._shelf.image_file(images[0]))
        if texture is not None:
            material.base_color = (1.0, 1.0, 1.0)
            self._shelf.warn_of_surface(
                Sentence(
                    "obj-image-guessed",
                    "{file}: names no material; the only image beside it, {image}, is used as its texture.",
                    file=self._file,
                    image=images[0],
                )
            )
        return texture
