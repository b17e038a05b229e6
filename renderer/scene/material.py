"""The material and all of its parameters: each is declared here only.

The strings below a parameter are its description in the scene file's schema.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from renderer.arrays import rows
from renderer.errors import SceneError
from renderer.scene.parameters import (
    EVERY_KIND,
    PRINCIPLED,
    SCATTERED_RAYS,
    SURFACES,
    MaterialKind,
    choice_parameter,
    color,
    flag_parameter,
    name_parameter,
    number,
    parameters_of,
    texture,
    values,
)
from renderer.sentences import Sentence
from renderer.settings import Vec3

__all__ = [
    "ALL_REFLECTING_IOR",
    "HAIR_IOR",
    "MOST_DENSE",
    "MOST_FORWARD",
    "MOST_KELVINS",
    "PARAMETERS",
    "AlphaMode",
    "Distribution",
    "HairModel",
    "Material",
    "check",
    "conductor_reflectance",
    "derived_columns",
]

AlphaMode = Literal["opaque", "mask", "blend"]
Distribution = Literal["ggx", "beckmann"]
HairModel = Literal["chiang", "huang"]

_ROUGH = ("glass", "conductor", *PRINCIPLED, "plastic", "hair")
_COATED = (*PRINCIPLED, "plastic")
_BRUSHED = ("conductor", *PRINCIPLED)
_REFRACTS = ("glass", *PRINCIPLED)
_BOUNDS = (*_REFRACTS, "interface")
_MATT = ("diffuse", *PRINCIPLED)
_METAL = ("conductor",)
_PHONG = ("blinn_phong",)
_HAIR = ("hair",)
_DISPLACED = tuple(kind for kind in SURFACES if kind != "hair")

_PBR = "pbrMetallicRoughness."
_SPECULAR = "KHR_materials_specular."
_COAT = "KHR_materials_clearcoat."
_SHEEN = "KHR_materials_sheen."
_TRANSMISSION = "KHR_materials_transmission."
_VOLUME = "KHR_materials_volume."
_BRUSH = "KHR_materials_anisotropy."
_FILM = "KHR_materials_iridescence."
_DISPERSION = "KHR_materials_dispersion."
_DIFFUSE = "KHR_materials_diffuse_transmission."
_DISPLACEMENT = "RAYFARM_materials_displacement."

MOST_DENSE = 1e9  # largest absorption or scattering coefficient of media, per scene unit
MOST_KELVINS = 1e5  # temperature of a light
MOST_FORWARD = 0.999  # largest absolute value of a phase function's g
HAIR_IOR = 1.55
_EUMELANIN = (0.419, 0.697, 1.37)  # absorption per concentration and radius, rgb
_PHEOMELANIN = (0.187, 0.4, 1.05)
ALL_REFLECTING_IOR = 1000.0  # reflects 0.996 at normal incidence


@dataclass
class Material:
    """A surface. `base_color` is reflectance (diffuse, mirror), tint (glass), kd (blinn_phong) or glTF's base colour.

    Textures multiply their factors, with channels packed as in glTF; a comment at each texture names its channel. Parameters by
    kind:

    diffuse: base_color, subsurface. mirror: base_color. glass: base_color, ior, roughness, dispersion, attenuation, sigma_a,
    sigma_s, g. conductor: eta, k, roughness, anisotropy. blinn_phong: base_color (kd), specular_color (ks), shininess. unlit:
    base_color is shown unshaded. metallic_roughness: all from metallic to subsurface_anisotropy, as defined by glTF 2.0 and its
    KHR_materials extensions where these define them. plastic (paint under a rough coat): base_color, ior, roughness, specular,
    specular_color, nonlinear. hair: base_color or sigma_a or eumelanin and pheomelanin, ior, tilt, and by its model beta_m and
    beta_n, or roughness, aspect_ratio, r, tt and trt. interface: no surface, only the boundary of a medium: attenuation, sigma_a,
    sigma_s, g.
    distribution: for kinds with a roughness.

    emission: radiance, multiplied by emission_texture. Emitted from the front face (counter-clockwise side, or a sphere's
    outside), and from the back face too if `double_sided`. Scattering is the same on both sides in any case. thin: transmits
    without refraction, like a pane or a soap film; otherwise the inside of the mesh is filled with the material.
    """

    name: str = "default"
    kind: MaterialKind = choice_parameter("diffuse", EVERY_KIND, EVERY_KIND)
    """Found by the other fields unless given."""
    base_color: Vec3 = color(0.8, rows.BASE, in_file="color", kinds=SURFACES)
    base_color_texture: int | None = texture(
        rows.BASE_TEXTURE, in_file="texture", kinds=SURFACES, srgb=True, gltf=_PBR + "baseColorTexture"
    )
    """Multiplies the colour; its alpha the opacity."""
    opacity: float = number(1.0, rows.OPACITY, kinds=SURFACES)  # times the base colour texture's alpha and the vertex colour's
    alpha_mode: AlphaMode = choice_parameter("opaque", get_args(AlphaMode))
    """blend where opacity is below 1, unless given."""
    alpha_cutoff: float = number(0.5, rows.ALPHA_CUTOFF, high=2.0, kinds=SURFACES, gltf="alphaCutoff")
    """What mask lets stand."""
    normal_texture: int | None = texture(rows.NORMAL_TEXTURE, kinds=SURFACES, layered=False, gltf="normalTexture")
    normal_scale: float = number(1.0, rows.NORMAL_SCALE, -100.0, 100.0, SURFACES, gltf="normalTexture.scale")
    displacement_texture: int | None = texture(
        None, _DISPLACED, layered=False, gltf=_DISPLACEMENT + "displacementTexture"
    )  # red; of meshes, moved by renderer/scene/displacement/
    """Heights, by which meshes are displaced along their normals: red."""
    displacement_scale: float = number(1.0, None, -1e9, 1e9, _DISPLACED, gltf=_DISPLACEMENT + "displacementScale")
    """The height of white above black, in the mesh's own unit."""
    displacement_midlevel: float = number(0.0, None, -1e9, 1e9, _DISPLACED, gltf=_DISPLACEMENT + "displacementMidlevel")
    """The value that leaves the surface where it is."""
    displacement_rate: float = number(1.5, None, 0.1, 1000.0, _DISPLACED, gltf=_DISPLACEMENT + "displacementRate")
    """The longest edge of displaced triangles, in pixels."""
    emission: Vec3 = color(0.0, high=1e9, kinds=SURFACES, form="radiance")
    """Radiance: what has some is a light."""
    emission_texture: int | None = texture(None, kinds=SURFACES, srgb=True)
    emission_temperature: float = number(0.0, high=MOST_KELVINS, kinds=SURFACES)
    """Kelvins of a black body whose spectrum its light has in spectral rendering; grey light has its colour, too. 0: none."""
    light_group: str = name_parameter(SURFACES)
    """The group of its light, for images of the light of each group."""
    light_link: str = name_parameter(SURFACES)
    """The link set of the objects that its light illuminates; all unless given."""
    shadow_link: str = name_parameter(SURFACES)
    """The link set of the objects that alone block its light; all unless given."""
    double_sided: bool = flag_parameter(rows.DOUBLE_SIDED, SURFACES, gltf="doubleSided")
    """Whether the back shines too."""
    lamp: bool = flag_parameter(kinds=SURFACES)
    """A light and no body: what meets it takes its light and goes on, and it casts no shadow."""
    unseen: bool = flag_parameter(kinds=SURFACES)
    """The camera sees what is behind it; all else does see it."""
    shadeless: bool = flag_parameter(kinds=SURFACES)
    """It casts no shadow on what lights shine on; all else does see it."""
    hidden_from: tuple[str, ...] = ()  # of SCATTERED_RAYS: rays of these kinds do not see it
    holdout: bool = flag_parameter(kinds=SURFACES)
    """Before a transparent background it cuts a hole into the picture; everything but the camera sees it."""
    shadow_catcher: bool = flag_parameter(kinds=SURFACES)
    """Before a transparent background the camera sees only the shadows on it, as opaque black."""
    reflection_catcher: bool = flag_parameter(kinds=SURFACES)
    """Before a transparent background the camera sees only what objects reflect onto it; with shadow_catcher both."""
    facing: bool = flag_parameter(kinds=SURFACES)
    """A sphere's light is that of a disk through its middle that faces the viewer: Cycles' soft falloff."""
    metallic: float = number(0.0, rows.METALLIC, gltf=_PBR + "metallicFactor", mtl="Pm")
    roughness: float | None = number(None, kinds=_ROUGH, gltf=_PBR + "roughnessFactor")
    """Unless given 0 for glass and conductors, 0.55 for hair with the model huang, and 1 for the rest."""
    metallic_roughness_texture: int | None = texture(
        rows.METALLIC_ROUGHNESS_TEXTURE, _ROUGH, gltf=_PBR + "metallicRoughnessTexture"
    )
    """As glTF packs it: green is roughness, blue is metal."""
    distribution: Distribution = choice_parameter("ggx", get_args(Distribution), _ROUGH)
    """Of the slopes of microfacets; clearcoat is always ggx."""
    nonlinear: bool = flag_parameter(kinds=("plastic",))
    """Light that the coat throws back onto the paint takes its colour again."""
    ior: float = number(1.5, rows.IOR, 1.0, ALL_REFLECTING_IOR, (*_REFRACTS, "plastic", *_HAIR))
    specular: float = number(1.0, rows.SPECULAR, kinds=_COATED, gltf=_SPECULAR + "specularFactor")
    specular_texture: int | None = texture(rows.SPECULAR_TEXTURE, layered=False, gltf=_SPECULAR + "specularTexture")
    """Alpha."""
    specular_color: Vec3 = color(  # above 1 up to a reflectance of 1
        1.0, rows.SPECULAR_COLOR, 1000.0, _PHONG + _COATED, gltf=_SPECULAR + "specularColorFactor"
    )
    """Tint of a dielectric's reflection; blinn_phong: ks."""
    specular_color_texture: int | None = texture(rows.SPECULAR_COLOR_TEXTURE, srgb=True, gltf=_SPECULAR + "specularColorTexture")
    clearcoat: float = number(0.0, rows.CLEARCOAT, gltf=_COAT + "clearcoatFactor", mtl="Pc")
    clearcoat_texture: int | None = texture(rows.CLEARCOAT_TEXTURE, gltf=_COAT + "clearcoatTexture")
    """Red."""
    clearcoat_roughness: float = number(0.0, rows.CLEARCOAT_ROUGHNESS, gltf=_COAT + "clearcoatRoughnessFactor", mtl="Pcr")
    clearcoat_roughness_texture: int | None = texture(rows.CLEARCOAT_ROUGHNESS_TEXTURE, gltf=_COAT + "clearcoatRoughnessTexture")
    """Green."""
    clearcoat_normal_texture: int | None = texture(
        rows.CLEARCOAT_NORMAL_TEXTURE, layered=False, gltf=_COAT + "clearcoatNormalTexture"
    )
    clearcoat_normal_scale: float = number(
        1.0, rows.CLEARCOAT_NORMAL_SCALE, -100.0, 100.0, gltf=_COAT + "clearcoatNormalTexture.scale"
    )
    sheen_color: Vec3 = color(0.0, rows.SHEEN_COLOR, gltf=_SHEEN + "sheenColorFactor")
    sheen_color_texture: int | None = texture(rows.SHEEN_COLOR_TEXTURE, srgb=True, gltf=_SHEEN + "sheenColorTexture")
    sheen_roughness: float = number(0.0, rows.SHEEN_ROUGHNESS, gltf=_SHEEN + "sheenRoughnessFactor")
    sheen_roughness_texture: int | None = texture(
        rows.SHEEN_ROUGHNESS_TEXTURE, layered=False, gltf=_SHEEN + "sheenRoughnessTexture"
    )
    """Alpha."""
    transmission: float = number(0.0, rows.TRANSMISSION, gltf=_TRANSMISSION + "transmissionFactor")
    transmission_texture: int | None = texture(rows.TRANSMISSION_TEXTURE, gltf=_TRANSMISSION + "transmissionTexture")
    """Red."""
    thin: bool = flag_parameter(kinds=_REFRACTS)
    """A pane, which does not refract."""
    attenuation_color: Vec3 = color(1.0, kinds=_BOUNDS, gltf=_VOLUME + "attenuationColor")
    """What is left of white after attenuation_distance."""
    attenuation_distance: float = number(math.inf, high=math.inf, above=True, kinds=_BOUNDS)
    sigma_a: Vec3 = color(0.0, high=MOST_DENSE, kinds=_BOUNDS + _HAIR, form="triple")
    """Absorption inside, per scene unit, in addition to attenuation_color. For hair: per radius, in place of color."""
    sigma_s: Vec3 = color(0.0, high=MOST_DENSE, kinds=_BOUNDS, form="triple")
    """What the inside scatters, per scene unit."""
    g: float = number(0.0, None, -MOST_FORWARD, MOST_FORWARD, _BOUNDS)
    """The mean cosine by which the inside scatters: Henyey-Greenstein's; 0 evenly, above 0 onwards, below 0 back."""
    volume: str = name_parameter(_BOUNDS)
    """The name of a volume whose density multiplies sigma_a and sigma_s."""
    dispersion: float = number(0.0, rows.DISPERSION, high=20.0, kinds=_REFRACTS, gltf=_DISPERSION + "dispersion")
    """20 / Abbe number."""
    anisotropy: float = number(0.0, rows.ANISOTROPY, kinds=_BRUSHED, gltf=_BRUSH + "anisotropyStrength", mtl="aniso")
    anisotropy_rotation: float = number(
        0.0, None, -1e9, 1e9, _BRUSHED, "degrees", gltf=_BRUSH + "anisotropyRotation"
    )  # radians here
    """Degrees, counter-clockwise from the tangent."""
    anisotropy_texture: int | None = texture(rows.ANISOTROPY_TEXTURE, _BRUSHED, layered=False, gltf=_BRUSH + "anisotropyTexture")
    """Red and green direction, blue strength."""
    iridescence: float = number(0.0, rows.IRIDESCENCE, gltf=_FILM + "iridescenceFactor")
    iridescence_texture: int | None = texture(rows.IRIDESCENCE_TEXTURE, gltf=_FILM + "iridescenceTexture")
    """Red."""
    iridescence_ior: float = number(1.3, rows.IRIDESCENCE_IOR, 1.0, 5.0, gltf=_FILM + "iridescenceIor")
    iridescence_thickness: tuple[float, float] = values(100.0, 400.0, rows.THICKNESS, 1e5)
    """Nanometres; two numbers for a texture's ends."""
    iridescence_thickness_texture: int | None = texture(rows.THICKNESS_TEXTURE, gltf=_FILM + "iridescenceThicknessTexture")
    """Green."""
    diffuse_transmission: float = number(0.0, rows.DIFFUSE_TRANSMISSION, gltf=_DIFFUSE + "diffuseTransmissionFactor")
    diffuse_transmission_texture: int | None = texture(
        rows.DIFFUSE_TRANSMISSION_TEXTURE, layered=False, gltf=_DIFFUSE + "diffuseTransmissionTexture"
    )
    """Alpha."""
    diffuse_transmission_color: Vec3 = color(
        1.0, rows.DIFFUSE_TRANSMISSION_COLOR, gltf=_DIFFUSE + "diffuseTransmissionColorFactor"
    )
    diffuse_transmission_color_texture: int | None = texture(
        rows.DIFFUSE_TRANSMISSION_COLOR_TEXTURE, srgb=True, gltf=_DIFFUSE + "diffuseTransmissionColorTexture"
    )
    subsurface: float = number(0.0, rows.SUBSURFACE, kinds=_MATT)
    """How much of the diffuse light goes through the inside, and comes out beside."""
    subsurface_radius: Vec3 = color(1.0, rows.SUBSURFACE_RADIUS, MOST_DENSE, _MATT, form="triple")
    """How far red, green and blue go there before they are scattered, on average, in scene units."""
    subsurface_anisotropy: float = number(0.0, rows.SUBSURFACE_ANISOTROPY, -MOST_FORWARD, MOST_FORWARD, _MATT)
    """As g, of subsurface."""
    eta: Vec3 = color(0.0, rows.ETA, 100.0, _METAL, form="triple")
    """A conductor's index of refraction is eta + i k, at the primaries."""
    k: Vec3 = color(1.0, rows.K, 1e6, _METAL, form="triple")
    model: HairModel = choice_parameter("chiang", get_args(HairModel), _HAIR)
    """By its fields unless given: Chiang's takes beta_m and beta_n; Huang's takes roughness, aspect_ratio, r, tt and trt."""
    beta_m: float = number(0.3, None, 0.02, 1.0, _HAIR)
    """The roughness of hair along the fibre, Chiang's beta_M."""
    beta_n: float = number(0.3, None, 0.02, 1.0, _HAIR)
    """Its roughness around the fibre, beta_N."""
    tilt: float = number(math.radians(2.0), None, -math.pi / 4, math.pi / 4, _HAIR, "degrees")  # radians here
    """By how many degrees the scales of hair are tilted towards its tip."""
    aspect_ratio: float = number(1.0, None, 0.05, 1.0, _HAIR)
    """The minor over the major radius of a hair's cross-section, an ellipse."""
    r: float = number(1.0, kinds=_HAIR)
    """Factor of the light reflected at the surface of hair, 1 for real hair."""
    tt: float = number(1.0, kinds=_HAIR)
    """Factor of the light that crosses the fibre."""
    trt: float = number(1.0, kinds=_HAIR)
    """Factor of the light reflected inside once or more often."""
    eumelanin: float = number(0.0, None, high=100.0, kinds=_HAIR)
    """The concentration of brown pigment, in place of a color: 1.3 is brown, 8 black."""
    pheomelanin: float = number(0.0, None, high=100.0, kinds=_HAIR)
    """The concentration of red pigment."""
    shininess: float = number(32.0, rows.SHININESS, high=1e6, kinds=_PHONG)
    """Blinn and Phong's exponent."""


PARAMETERS = parameters_of(Material)


def check(material: Material) -> None:
    """Raises SceneError if a parameter of the material is outside its range, which the reader should have prevented."""
    for parameter in PARAMETERS:
        value = getattr(material, parameter.name)
        fault = None if value is parameter.default else parameter.fault(value)
        if fault is not None:
            raise SceneError(
                Sentence(
                    "material-parameter-invalid",
                    "Material {name}: its {parameter} {fault}. Correct it in the file",
                    name=material.name,
                    parameter=parameter.in_file,
                    fault=fault,
                )
            )


def with_visibility(material: Material, seen_by: Mapping[str, bool]) -> Material:
    """Returns a copy of the material that is visible as stated to the kinds of rays in `seen_by` (RAY_KINDS), else as before."""
    hidden = {kind for kind in SCATTERED_RAYS if not seen_by.get(kind, kind not in material.hidden_from)}
    return replace(
        material,
        unseen=not seen_by.get("camera", not material.unseen),
        shadeless=not seen_by.get("shadow", not material.shadeless),
        hidden_from=tuple(kind for kind in SCATTERED_RAYS if kind in hidden),
    )


def derived_columns(m: Material) -> list[tuple[int, tuple[float, ...]]]:
    """Returns the columns of a material's table row that are not plain copies of parameters: (first column, values)."""
    if m.kind == "glass":  # a principled surface that transmits everything
        white = (1.0, 1.0, 1.0)
        return [(rows.METALLIC, (0.0,)), (rows.TRANSMISSION, (1.0,)), (rows.SPECULAR, (1.0,)), (rows.SPECULAR_COLOR, white)]
    if m.kind == "blinn_phong":
        most = max(d + s for d, s in zip(m.base_color, m.specular_color, strict=True))
        share = 1 / max(most, 1.0)  # no surface reflects more than it receives
        diffuse, specular = (tuple(c * share for c in each) for each in (m.base_color, m.specular_color))
        return [(rows.BASE, diffuse), (rows.SPECULAR_COLOR, specular)]
    if m.kind == "interface":
        return [(rows.OPACITY, (0.0,))]  # transmits all light unchanged
    if m.kind == "hair":
        return _hair_columns(m)
    if m.kind == "conductor":
        cosine = (np.arange(256) + 0.5) / 256
        means = (np.mean(2 * cosine * conductor_reflectance(cosine, e, k)) for e, k in zip(m.eta, m.k, strict=True))
        return [(rows.MEAN_FRESNEL, tuple(map(float, means)))]
    return []


def _hair_columns(m: Material) -> list[tuple[int, tuple[float, ...]]]:
    """Returns the columns of hair (Chiang et al. 2016, equations 7, 8 and 9), and its absorption by pigments.

    The absorption of melanin is d'Eon et al.'s (2011), as in pbrt.
    """
    along, around = m.beta_m, m.beta_n
    spread = 0.726 * along + 0.812 * along**2 + 3.7 * along**20
    scale = math.sqrt(math.pi / 8) * (0.265 * around + 1.194 * around**2 + 5.372 * around**22)
    powers = (5.969, -0.215, 2.532, -10.73, 5.574, 0.245)
    columns: list[tuple[int, tuple[float, ...]]] = [
        (rows.HAIR_VARIANCE, (spread * spread,)),
        (rows.HAIR_SCALE, (scale,)),
        (rows.HAIR_TILT, (math.sin(m.tilt), math.cos(m.tilt))),
        (rows.HAIR_COLOR_SCALE, (1 / sum(c * around**k for k, c in enumerate(powers)),)),
    ]
    pigments = (m.eumelanin, _EUMELANIN), (m.pheomelanin, _PHEOMELANIN)
    sigma = tuple(own + sum(c * each[k] for c, each in pigments) for k, own in enumerate(m.sigma_a))
    columns.append((rows.ABSORPTION, sigma))
    if any(sigma):
        columns.append((rows.BASE, (1.0, 1.0, 1.0)))
    if m.model == "huang":
        columns += [(rows.HUANG_ASPECT, (m.aspect_ratio,)), (rows.HUANG_SHARES, (m.r, m.tt, m.trt))]
    return columns


def conductor_reflectance(cosine: npt.NDArray[np.float64], eta: float, k: float) -> npt.NDArray[np.float64]:
    """Returns the Fresnel reflectance of unpolarised light at a conductor eta + i k (Born & Wolf, 14.4)."""
    sine2 = 1 - cosine**2
    root = np.sqrt(eta * eta - k * k - sine2 + 0j + 2j * eta * k)
    s = (cosine - root) / (cosine + root)
    index2 = (eta + 1j * k) ** 2
    p = (index2 * cosine - root) / (index2 * cosine + root)
    reflectance: npt.NDArray[np.float64] = 0.5 * (np.abs(s) ** 2 + np.abs(p) ** 2)
    return reflectance
