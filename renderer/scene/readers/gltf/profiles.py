"""EXT_lights_ies: lights with IES profiles, in candela."""

from __future__ import annotations

from renderer.errors import SceneError
from renderer.scene.description import Light
from renderer.scene.files import SceneFiles, data_uri
from renderer.scene.readers.gltf.accessors import Accessors
from renderer.scene.readers.gltf.container import Json
from renderer.scene.readers.gltf.lights import forward_of
from renderer.scene.readers.gltf.transforms import Matrix, unit_vector, vec3
from renderer.scene.readers.ies import Photometry, read_ies
from renderer.scene.readers.light_maps import LUMENS_PER_WATT, photometry_of
from renderer.scene.readers.number_ranges import clamped, unit_color
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence, with_full_stop

__all__ = ["EXTENSION", "Profiles"]

EXTENSION = "EXT_lights_ies"

_MAX_INTENSITY = 1e12


class Profiles:
    """The IES profiles of one file, each read once."""

    def __init__(self, root: Json, accessors: Accessors, files: SceneFiles, shelf: TextureShelf) -> None:
        self._root, self._accessors, self._files, self._shelf = root, accessors, files, shelf
        own = root.extension(EXTENSION)
        self._profiles = own.objects("lights") if own else []

    def light(self, node: Json, name: str, world: Matrix) -> Light | None:
        """Returns the light with an IES profile on a node; None if the node has none.

        An unreadable profile causes a warning, and None is returned.
        """
        source = node.extension(EXTENSION)
        if source is None:
            return None
        profile = self._profiles[source.integer("light", high=len(self._profiles))]
        try:
            photometry = self._photometry(profile)
        except SceneError as error:
            self._shelf.warn(Sentence("gltf-light-left-out", "{error}; the light {name} is left out.", error=error, name=name))
            return None
        for note in photometry.notes:
            self._shelf.warn(with_full_stop(note))
        scale = clamped(source.number("multiplier", 1.0), 0.0, _MAX_INTENSITY) / LUMENS_PER_WATT
        r, g, b = (c * scale for c in unit_color(source.vector("color", (1.0, 1.0, 1.0))))
        # Vertical angles are in the XZ plane; horizontal ones go from X to Y, clockwise for types A and B.
        up = world[:3, 1] if photometry.goniometry == "C" else world[:3, 0]
        at, forward = vec3(world[:3, 3]), forward_of(world)
        return Light("point", (r, g, b), at, forward, emission=photometry.emission, up=vec3(unit_vector(up)), name=name)

    def _photometry(self, profile: Json) -> Photometry:
        place = f"{self._root.file}: {profile.where}"
        if "uri" in profile:
            uri = profile.text("uri", "")
            if uri.startswith("data:"):
                return self._files.get_or_make(("IES", place), lambda: read_ies(data_uri(uri, place), place))
            name = self._files.resolve_uri(uri, self._root.file)
            if name is None:
                raise SceneError(
                    Sentence(
                        "gltf-light-profile-missing",
                        "{place}: its profile {uri} is not among the files; add it",
                        place=place,
                        uri=uri[:120],
                    )
                )
            return photometry_of(self._files, name)
        view = profile.integer("bufferView", high=len(self._accessors.views))
        return self._files.get_or_make(("IES", place), lambda: read_ies(bytes(self._accessors.view_bytes(view)), place))
