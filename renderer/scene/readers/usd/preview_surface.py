"""Converts UsdPreviewSurface to a material. Source: its specification, version 2.6."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from renderer.scene.description import Vec3
from renderer.scene.material import Material
from renderer.scene.readers.linear_images import white_value
from renderer.scene.readers.mtl_maps import with_opacity, with_roughness_and_metal
from renderer.scene.readers.number_ranges import clamped, unit, unit_color
from renderer.scene.readers.usd.inputs import Input
from renderer.scene.readers.usd.network import Network
from renderer.scene.readers.usd.textures import TextureInput, colored, grey, normals
from renderer.scene.readers.usd.written_by_blender import is_written_by_blender
from renderer.scene.textures import TextureShelf

__all__ = [
    "MAX_RADIANCE",
    "Read",
    "fill_base",
    "fill_data",
    "fill_emission",
    "fill_normal",
    "fill_opacity",
    "fill_roughness",
    "read_preview_surface",
]

MAX_RADIANCE = 1e9


class Read:
    """A material that is being filled from a shader network, and the primvars that multiply its colour and opacity."""

    def __init__(self, name: str, network: Network, shelf: TextureShelf) -> None:
        self.material = Material(name, "metallic_roughness", (1.0, 1.0, 1.0), roughness=1.0)
        self.network, self.shelf = network, shelf
        self.color: str | None = None
        self.opacity: str | None = None


def read_preview_surface(shader: Any, read: Read) -> None:
    """Fills the material from a UsdPreviewSurface shader."""
    network, material = read.network, read.material
    diffuse = network.input(shader, "diffuseColor", srgb=True)
    fill_base(read, diffuse, (0.18, 0.18, 0.18))
    rough, metal = network.input(shader, "roughness"), network.input(shader, "metallic")
    is_specular = network.input(shader, "useSpecularWorkflow").number(0) != 0
    material.ior = clamped(network.input(shader, "ior").number(1.5), 1.0, 1000.0)
    if is_specular:
        metal = Input(0.0)
        _specular(read, network.input(shader, "specularColor", srgb=True))
    fill_roughness(read, rough, 0.5, metal, 0.0)
    fill_data(read, "clearcoat", network.input(shader, "clearcoat"), 0.0)
    fill_data(read, "clearcoat_roughness", network.input(shader, "clearcoatRoughness"), 0.01)
    fill_normal(read, "normal", network.input(shader, "normal"))
    fill_emission(read, network.input(shader, "emissiveColor", srgb=True), 1.0)
    opacity = network.input(shader, "opacity")
    threshold = network.input(shader, "opacityThreshold").number(0.0)
    by_blender = is_written_by_blender(shader.GetPrim())
    if by_blender and not is_specular:  # Blender's own input: 0.5 is a reflectance of 4 %
        material.specular = unit(2 * network.input(shader, "specular").number(0.5))
    is_presence = by_blender or str(network.input(shader, "opacityMode").value or "transparent") == "presence"
    if opacity.taken is None and opacity.primvar is None and threshold <= 0 and not is_presence:
        _set_transmission(material, unit(opacity.number(1.0)))
    else:
        fill_opacity(read, opacity, threshold, diffuse.taken)


def fill_base(read: Read, given: Input, default: Vec3) -> None:
    """Fills the base colour of the material, from a value, texture or primvar."""
    material = read.material
    if given.taken is not None:
        material.base_color, material.base_color_texture = colored(read.shelf, given.taken)
        read.color = given.primvar  # multiplies the texture
    elif given.primvar is not None:
        read.color = given.primvar
    else:
        material.base_color = unit_color(given.color(default))


def fill_roughness(read: Read, rough: Input, roughness: float, metal: Input, metallic: float) -> None:
    """Fills the material's roughness and metalness; if either has a texture, both are packed into one texture."""
    material, shelf = read.material, read.shelf
    material.roughness = unit(rough.number(roughness)) if rough.taken is None else 1.0
    material.metallic = unit(metal.number(metallic)) if metal.taken is None else 1.0
    both = (rough.taken, "g"), (metal.taken, "b")
    used = [(taken, channel) for taken, channel in both if taken is not None]
    if not used:
        return
    numbers = {taken.texture for taken, _ in used}
    is_packed = len(used) == 2 and len(numbers) == 1 and all(t.is_plain and t.channel == channel for t, channel in used)
    material.metallic_roughness_texture = used[0][0].texture if is_packed else _packed(shelf, rough.taken, metal.taken)


def _packed(shelf: TextureShelf, rough: TextureInput | None, metal: TextureInput | None) -> int | None:
    one, other = (None if taken is None else grey(shelf, taken) for taken in (rough, metal))
    return with_roughness_and_metal(shelf, one, other)


def fill_data(read: Read, name: str, given: Input, default: float) -> None:
    """Fills a material parameter in 0..1 and its texture, whose values are linear.

    name: the material's field; the texture's field is `{name}_texture`.
    """
    if given.taken is not None:
        setattr(read.material, name, 1.0)
        setattr(read.material, f"{name}_texture", grey(read.shelf, given.taken))
    else:
        setattr(read.material, name, unit(given.number(default)))


def fill_normal(read: Read, name: str, given: Input) -> None:
    """Sets a normal map of the material, if the input has one. name: `normal` or `clearcoat_normal`."""
    if given.taken is None:
        return
    texture, scale = normals(read.shelf, given.taken)
    setattr(read.material, f"{name}_texture", texture)
    setattr(read.material, f"{name}_scale", clamped(scale, -100.0, 100.0))


def fill_emission(read: Read, given: Input, strength: float) -> None:
    """Fills the material's emission with the input's colour times `strength`."""
    factor: Vec3 = unit_color(given.color((0.0, 0.0, 0.0)), MAX_RADIANCE)
    if given.taken is not None:
        factor, read.material.emission_texture = colored(read.shelf, given.taken, MAX_RADIANCE)
        if read.material.emission_texture is None:
            return
    read.material.emission = unit_color([c * strength for c in factor], MAX_RADIANCE)


def fill_opacity(read: Read, opacity: Input, threshold: float, base: TextureInput | None) -> None:
    """Fills the material's opacity: masked if the threshold is above 0, otherwise blended.

    base: the base colour's texture, whose alpha is used directly if the opacity is that same alpha.
    """
    material, shelf = read.material, read.shelf
    level = sum(opacity.color((1.0, 1.0, 1.0))) / 3  # MaterialX's opacity is a colour
    if opacity.taken is None and opacity.primvar is None and level >= 1:
        return
    material.alpha_mode = "mask" if threshold > 0 else "blend"
    material.alpha_cutoff = clamped(threshold, 0.0, 2.0) if threshold > 0 else 0.5
    read.opacity = opacity.primvar
    if opacity.taken is None:
        material.opacity = unit(level) if opacity.primvar is None else 1.0
        if material.base_color_texture is not None:  # its alpha is not used
            material.base_color_texture = shelf.derived_texture(material.base_color_texture, "opaque", _opaque)
        return
    is_own = base is not None and opacity.taken.texture == base.texture == material.base_color_texture
    if is_own and opacity.taken.channel == "a" and opacity.taken.span("a") == (1.0, 0.0):
        return
    mask = grey(shelf, opacity.taken)
    if mask is not None:
        material.base_color_texture = with_opacity(shelf, material.base_color_texture, mask)


def _opaque(image: Any) -> Any:
    if image.pixels.shape[2] < 4:
        return image
    pixels = image.pixels.copy()
    pixels[..., 3] = white_value(pixels)
    return replace(image, name=f"{image.name} opaque", pixels=pixels)


def _specular(read: Read, given: Input) -> None:
    """Fills the material's specular tint so that the reflectance at normal incidence equals the specular colour."""
    material = read.material
    own = max(((material.ior - 1) / (material.ior + 1)) ** 2, 1e-3)
    factor = given.color((0.0, 0.0, 0.0))
    if given.taken is not None:
        factor, material.specular_color_texture = colored(read.shelf, given.taken)
    material.specular_color = unit_color([c / own for c in factor], 1000.0)


def _set_transmission(material: Material, opacity: float) -> None:
    """Converts opacity below 1 to transmission, leaving reflection unchanged.

    UsdPreviewSurface transmits untinted light and tints the diffuse part only. A material has one colour for both: here the mean
    of the two, weighted by the opacity.
    """
    if opacity >= 1:
        return
    material.transmission = 1 - opacity
    r, g, b = (opacity * c + 1 - opacity for c in material.base_color)
    material.base_color = r, g, b
