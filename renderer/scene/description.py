"""The scene description: the output of every reader and the input of the compiler.

Right-handed world space, any up direction. Colours are linear Rec.709; distances are in the file's own unit.
Indices (`material`, `texture`, `image`, `mesh`) refer to the lists of the SceneDescription.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from renderer.scene.animation import DEFAULT_FPS, Clip
from renderer.scene.given_spectra import GivenSpectrum
from renderer.scene.material import MOST_KELVINS, AlphaMode, Material
from renderer.scene.parameters import MaterialKind, choice_parameter, flag_parameter, name_parameter, number, parameters_of
from renderer.sentences import Sentence
from renderer.settings import Vec3, View

__all__ = [
    "LIGHT_PARAMETERS",
    "AlphaMode",
    "Blend",
    "Camera",
    "EmissionKind",
    "EmissionMap",
    "Environment",
    "Falloff",
    "Image",
    "Instance",
    "Light",
    "LightKind",
    "Material",
    "MaterialKind",
    "Medium",
    "Mesh",
    "SceneDescription",
    "Sky",
    "Sphere",
    "SurfaceNote",
    "TexelFilter",
    "Texture",
    "TextureLayer",
    "UvTransform",
    "Volume",
    "Wrap",
]

F32 = npt.NDArray[np.float32]
I32 = npt.NDArray[np.int32]
LightKind = Literal["point", "spot", "directional"]
Falloff = Literal["squared", "smooth", "linear", "smooth angle"]
Seen = Literal["never", "mirrored", "always"]
EmissionKind = Literal["sphere", "window", "screen"]
Wrap = Literal["repeat", "mirror", "clamp"]
TexelFilter = Literal["linear", "nearest"]
Blend = str  # a key of OPERATIONS in renderer/kernel/material/blend.py
UvTransform = tuple[float, float, float, float, float, float]


@dataclass
class Image:
    """An image: pixels (h, w, 4) uint8 or uint16 (colours sRGB-encoded if `srgb`), or (h, w, 3 or 4) float32, linear, for HDR.

    Alpha is straight. Float pixels of an image that is not `srgb` are data (normals, heights, roughness).
    """

    name: str
    pixels: npt.NDArray[Any]
    srgb: bool = True


@dataclass(frozen=True)
class TextureLayer:
    """A texture with its own UV lookup that is composited over another texture; it has no layers itself.

    `blend` is computed in linear light (kernel/material/blend.py). The result is mixed with the layers beneath by the layer's
    alpha times `strength`, 0 ... 1. Surface colours are clamped at 1; emission is not.
    """

    texture: int
    blend: Blend = "over"
    strength: float = 1.0


@dataclass(frozen=True)
class Texture:
    """An image with wrap modes and a UV transform. UV (0, 0) is the image's upper left corner, as in glTF.

    transform: the rows of the 2x3 matrix applied to the UVs of set `uv_set`.
    layers: composited on top, the lowest first; they do not affect the texture's alpha.
    keys: the transform at equal steps from the shutter's opening to its closing; empty if constant.
    """

    image: int
    wrap_s: Wrap = "repeat"
    wrap_t: Wrap = "repeat"
    uv_set: int = 0  # 0 or 1
    transform: UvTransform = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    layers: tuple[TextureLayer, ...] = ()
    filter: TexelFilter = "linear"  # between texels; nearest: each texel is a square of constant colour
    keys: tuple[UvTransform, ...] = ()


@dataclass
class Mesh:
    """A triangle mesh in its own coordinate space, of one material.

    Without normals it is shaded flat; without UVs all are (0, 0).
    """

    name: str
    positions: npt.NDArray[Any]  # (V, 3) float32; float64 where that is far from the origin (renderer/scene/origin.py)
    triangles: I32  # (T, 3)
    normals: F32 | None = None  # (V, 3), need not be unit
    uvs: F32 | None = None  # (V, 2)
    material: int = 0
    uvs1: F32 | None = None  # (V, 2), the second set
    colors: F32 | None = None  # (V, 4) linear RGBA, multiplies the base colour
    tangents: F32 | None = None  # (V, 4) as in glTF, w is the bitangent's sign; None: computed from the UVs if needed
    diameters: F32 | None = None  # (V,) of the fibres around which it is a tube, with tangents along them; for hair
    flat: bool = False  # whether its curves, unless they are hair, are flat and face each ray, as pbrt's of the type flat
    deforms: bool = False  # whether its vertices differ at another time
    keys: tuple[tuple[npt.NDArray[Any], F32 | None], ...] = ()  # positions and normals, as Instance.keys


@dataclass
class Instance:
    """A mesh placed in the world by a 4x4 matrix on column vectors. material: replaces the mesh's if not None.

    keys: the transforms at equal steps from the shutter's opening to its closing, at least 2; empty if the instance does not
    move. With keys, `transform` is the one in the middle.
    """

    mesh: int
    transform: npt.NDArray[np.float64] = field(default_factory=lambda: np.eye(4))
    material: int | None = None
    name: str = ""  # instances of one name are one object in the object id AOV; "": a separate object
    moves: bool = False  # whether its transform, visibility or emission differs at another time
    keys: tuple[npt.NDArray[np.float64], ...] = ()
    guide: bool = False  # whether paths aim at it (renderer/scene/targets.py)


@dataclass
class Sphere:
    """A sphere in world space."""

    center: Vec3
    radius: float
    material: int = 0
    name: str = "sphere"
    guide: bool = False  # whether paths aim at it, as `sampling: mixture` aims at lights
    moves: bool = False  # whether it differs at another time
    keys: tuple[tuple[Vec3, float], ...] = ()  # centres and radii, as Instance.keys


@dataclass(frozen=True, eq=False)
class EmissionMap:
    """An angular map of factors for a punctual light's intensity; renderer/kernel/light/emission_map.py defines its coordinates.

    edges: left, right, top, bottom. For a sphere: radians, where left and right are 2 pi apart and top is at least 0. For a
    window or a screen: coordinates to the right and up in the plane at distance 1. The intensity is 0 outside the edges.
    """

    kind: EmissionKind
    values: F32  # (h, w, 3) linear, 0 or more, rows from the top
    edges: tuple[float, float, float, float]
    # For a sphere: True: the first and last rows are at the edges, and the first column is at the left edge; False: each row and
    # column is in the middle of its cell.
    at_edges: bool = False


# Types of lights in scene files, by the parameters they have. A projector is a point light that emits a picture.
_PLACED = ("point", "spot", "projector")
_CONES = ("spot",)
_DISTANT = ("directional",)


@dataclass
class Light:
    """A punctual light: it illuminates, but camera rays and scattered rays do not hit it, unless it is a sun.

    Parameters declared by functions of renderer/scene/parameters.py are read from scene files as declared.

    intensity: radiant intensity (point, spot: radiance units times area) or irradiance at normal incidence (directional).
    radius (point, spot) and angle (directional: the angular diameter in degrees, 0.53 for the sun) soften its shadows.
    emission (point, spot): map that multiplies the intensity; the map's axis is `direction`, and its up vector is `up`, projected
    perpendicular to the axis.
    """

    kind: LightKind
    intensity: Vec3 = (1.0, 1.0, 1.0)
    position: Vec3 = (0.0, 0.0, 0.0)
    direction: Vec3 = (0.0, -1.0, 0.0)  # of emission
    radius: float = number(0.0, high=math.inf, kinds=_PLACED)
    """Of a sphere that softens the shadows."""
    angle: float = number(0.0, high=180.0, kinds=_DISTANT)
    """Degrees that a directional light spans; the sun 0.53."""
    inner_cone: float = number(0.0, high=180.0, kinds=_CONES)
    """Half angle within which a spot is full, degrees."""
    outer_cone: float = number(45.0, high=180.0, above=True, kinds=_CONES)
    """Half angle beyond which it is dark."""
    falloff: Falloff = choice_parameter("squared", get_args(Falloff), _CONES)  # formulas: renderer/kernel/light/punctual.py
    """How a spot falls off between its cones: as glTF has it, unless told; smooth as Cycles and pbrt; linear as Mitsuba; smooth
    angle as USD."""
    facing: bool = flag_parameter(kinds=_PLACED)
    """Whether the radius is that of a disk which faces what it lights, as of Blender's lamps, not of a sphere."""
    seen: Seen = choice_parameter("never", get_args(Seen), _DISTANT)
    """Whether rays meet the disk of a directional light that has an angle: none, all but the camera's, or all."""
    emission: EmissionMap | None = None
    up: Vec3 = (0.0, 1.0, 0.0)
    name: str = "light"
    temperature: float = number(0.0, high=MOST_KELVINS, kinds=(*_PLACED, *_DISTANT))
    """Kelvins of a black body whose spectrum it has in spectral rendering; a grey light has its colour, too. 0: none."""
    light_group: str = name_parameter((*_PLACED, *_DISTANT))
    """Its group, for images of the light of each group."""
    light_link: str = name_parameter((*_PLACED, *_DISTANT))
    """The link set of the objects that it illuminates; all unless given."""
    shadow_link: str = name_parameter((*_PLACED, *_DISTANT))
    """The link set of the objects that alone block its light; all unless given."""
    hidden_from: tuple[str, ...] = ()  # of SCATTERED_RAYS: lobes whose rays do not see it receive no light from it
    keys: tuple[Light, ...] = ()  # as Instance.keys


LIGHT_PARAMETERS = parameters_of(Light)


@dataclass(frozen=True)
class LightLink:
    """A link set: the objects that its lights illuminate. Names stand for all objects of that name, and for all parts of it."""

    include: tuple[str, ...] | None = None  # None: all objects
    exclude: tuple[str, ...] = ()  # objects that are left out again


@dataclass
class Sky:
    """A clear sky and its sun (renderer/scene/atmosphere.py). Angles in degrees.

    Scale: a white surface that faces the sun has radiance 1 outside the atmosphere, and nearly as much on the ground at noon.
    """

    sun_elevation: float = 45.0  # -90 ... 90, above the horizon
    sun_azimuth: float = 0.0  # clockwise seen from above: 0 is -Z, 90 is +X
    air: float = 1.0  # 0 ... 10: molecules, dust and ozone relative to a clear day's
    dust: float = 1.0
    ozone: float = 1.0
    sun: bool = True  # whether its disk is visible; the sky is lit by it in any case
    sun_size: float = 0.545  # angular diameter, 0.01 ... 30; its irradiance is independent of it
    ground_albedo: Vec3 = (0.3, 0.3, 0.3)  # of the ground below the horizon


@dataclass
class Environment:
    """Infinitely distant light: `color` is radiance, multiplied by an equirectangular image or a sky if given.

    image: index into SceneDescription.images (float32 pixels); its middle column is towards -Z and its top row is up (+Y).
    rotation: degrees about +Y, counter-clockwise seen from above.
    """

    color: Vec3 = (1.0, 1.0, 1.0)
    image: int | None = None
    strength: float = 1.0
    rotation: float = 0.0
    sky: Sky | None = None  # in place of an image


@dataclass
class Volume:
    """A density grid that multiplies the coefficients of the media that name it, and a grid of what it emits. Outside it is 0.

    density, emission: (nz, ny, nx) float32, from 0, with the values at the voxels' centres; in between they are interpolated
    linearly, and constant beyond the outermost centres. emission_color: radiance per scene unit where the emission grid is 1.
    to_world: of the volume, which extends from 0 to 1 along each axis.
    """

    density: F32
    to_world: npt.NDArray[np.float64]  # (4, 4)
    emission: F32 | None = None
    emission_color: Vec3 = (1.0, 1.0, 1.0)


@dataclass
class Medium:
    """The medium that fills the world outside all objects: fog, haze, water. The insides of objects are given by their materials.

    sigma_a, sigma_s: absorption and scattering coefficients, rgb per scene unit, from 0 to MOST_DENSE. g: mean cosine of the
    Henyey-Greenstein phase function, -MOST_FORWARD ... MOST_FORWARD (renderer/scene/material.py).
    """

    sigma_a: Vec3 = (0.0, 0.0, 0.0)
    sigma_s: Vec3 = (0.0, 0.0, 0.0)
    g: float = 0.0
    volume: str = ""  # the name of its density; empty if it is the same everywhere


@dataclass
class Camera:
    """A named camera with its view.

    keys: the views at equal steps from the shutter's opening to its closing; empty if the camera does not move.
    """

    name: str
    view: View
    keys: tuple[View, ...] = ()


class SurfaceNote(Sentence):
    """A warning about the appearance of a material, dropped if another material replaces that one."""

    __slots__ = ()


@dataclass
class SceneDescription:
    """A whole scene, as a reader returns it.

    defaults: render settings that the file requests (width, height, spp, max_depth, integrator).
    """

    name: str = "scene"
    meshes: list[Mesh] = field(default_factory=list)
    instances: list[Instance] = field(default_factory=list)
    spheres: list[Sphere] = field(default_factory=list)
    lights: list[Light] = field(default_factory=list)
    materials: list[Material] = field(default_factory=list)
    textures: list[Texture] = field(default_factory=list)
    images: list[Image] = field(default_factory=list)
    environment: Environment | None = None
    environment_group: str = ""  # the light group of the environment, also of one that replaces it
    light_links: dict[str, LightLink] = field(default_factory=dict)  # by name; lights and materials refer to them
    volumes: dict[str, Volume] = field(default_factory=dict)  # by name: the densities of media
    medium: Medium | None = None  # of the world; the camera is in it unless inside an object
    spectra: list[GivenSpectrum] = field(default_factory=list)  # of colours that lights, surfaces and metals have
    cameras: list[Camera] = field(default_factory=list)
    up: Vec3 = (0.0, 1.0, 0.0)
    up_axis: str | None = None  # the axis of the file that became Y, if its format states none: one of renderer.formats.UP_AXES
    displaced_triangles: int = 4_000_000  # most triangles of displaced meshes, unless they have more before
    subject: npt.NDArray[np.float64] | None = None  # bounds (2, 3) without the added floor; None: no floor was added
    studio_for_accents: bool = False  # without environment and with weak lights, compiling adds the studio's
    defaults: dict[str, Any] = field(default_factory=dict)
    clips: list[Clip] = field(default_factory=list)  # the file's animations; the request selects clip and time
    fps: float = DEFAULT_FPS  # the file's
    moves: bool = False  # whether another time may show something else
    keys: int = 0  # number of keys of moving objects while the shutter is open; 0: nothing moves
    # An object shared by the descriptions of several moments that differ only in cameras, lights without a body, and properties
    # marked as moving: transforms of instances, and vertices of meshes that deform.
    still: object | None = None
    variants: list[str] = field(default_factory=list)  # the file's material variants; selected when it is read
    vary: dict[str, Any] | None = None  # how the file says that views vary, as Variation.parse takes it
    # Values that renderer/scene/vary.py has drawn, by section and name; empty for a scene as its files describe it.
    variation: dict[str, Any] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)  # sentences that a user can act on
