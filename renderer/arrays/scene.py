"""The compiled scene: the flat arrays that the kernel reads. renderer/scene/compiled.py stores them in one file.

Every array is C-contiguous and read-only, as ensured by `seal`: Numba compiles read-only arrays as a separate type, and so one
compiled kernel can be used with memory-mapped and with freshly built scenes. A primitive's number is its triangle's index, or T +
its sphere's index; lights without geometry are numbered after those.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.arrays.light_rows import CHILD, LIGHT_ROWS, LIGHT_WIDTH, PARALLELOGRAM, PIVOT_COLUMNS, TARGET_COLUMNS
from renderer.arrays.rows import (
    ABOVE,
    COLUMNS,
    ENCODING,
    FLAT_CURVES,
    HAIR,
    HUANG,
    LIGHT_ROOT_BIT,
    LINEAR_16,
    MEDIUM_COLUMNS,
    MEDIUM_VOLUME,
    MOST_MEDIA,
    PART_MATERIAL,
    PART_OBJECT,
    PART_SHINES,
    SLOTS,
    TEXTURE_COLUMNS,
    TEXTURED,
    TRANSFORM_COLUMNS,
    VOLUME_COLUMNS,
    VOLUME_GRID_COLUMNS,
)
from renderer.arrays.scene_features import EVERYTHING, SceneFeatures
from renderer.arrays.spectrum import GIVEN_COLUMNS
from renderer.bvh.layout import (
    CURVES,
    INSTANCE,
    KEY_COLUMNS,
    LEAF_KIND,
    NEVER,
    NODE_ROWS,
    PACKET_ROWS,
    RAY_KINDS,
    ROW_CHILD,
    WIDTH,
    Bvh,
)
from renderer.errors import SceneError

__all__ = ["LAYOUT", "CompiledScene", "check", "example", "flat", "nested", "seal"]

Array = npt.NDArray[Any]


class CompiledScene(NamedTuple):
    """The arrays of a compiled scene.

    Lengths: I instances, V vertices, T triangles in P parts, S spheres, M materials, X textures, m media, L lights, K of them
    punctual.
    """

    bvh: Bvh

    to_world: Array  # (I, 3, 4) f64, from each instance's space: a matrix and, last column, a translation
    instance_stretch: Array  # (I, 2) f32: greatest and least scale of to_world
    instance_material: Array  # (I,) i32: its triangles' material, or -1 for their own
    instance_object: Array  # (I,) i32

    position: Array  # (V, 3) f32, world space; instance space for triangles of instances
    normal: Array  # (V, 3) f32, unit shading normals (geometric normals of flat meshes)
    uv: Array  # (V, 2) f32, or no rows without textures
    uv1: Array  # (V, 2) f32, or no rows if no texture uses the second set
    color: Array  # (V, 4) f32 RGBA 0..1, or no rows without vertex colours
    # (V, 4) f32: unit and the bitangent's sign, times the diameter of fibres; zeros if unused, or no rows if none are needed
    tangent: Array
    triangle: Array  # (T, 4) i32: three vertices, and the part; (a, b, b) is a segment of a curve (renderer/bvh/curves.py)
    part: Array  # (P, 3) i32: PART_MATERIAL, PART_OBJECT (scene/object_ids.py; counts of an instance), PART_SHINES
    triangle_light: Array  # (T,) i32: its light, or -1; no rows if no part emits
    sphere: Array  # (S, 4) f32: centre, radius
    sphere_material: Array  # (S,) i32
    sphere_light: Array  # (S,) i32: its light, or -1
    sphere_object: Array  # (S,) i32

    material_kind: Array  # (M,) i32: kinds, flags, columns and slots are named in renderer/arrays/rows.py
    material_flags: Array  # (M,) i32
    material: Array  # (M, COLUMNS) f32
    material_texture: Array  # (M, SLOTS) i32: rows of `texture`; -1 for none

    medium: Array  # (m, MEDIUM_COLUMNS) f32: the media, the world's first
    material_medium: Array  # (M,) i32: the row of its interior's medium; -1 for surfaces without interior

    # Grids of heterogeneous media (renderer/arrays/rows.py)
    volume: Array  # (v, VOLUME_COLUMNS) f32
    volume_grid: Array  # (v, VOLUME_GRID_COLUMNS) i32
    voxel: Array  # (x,) f32: values of all grids, x the fastest axis, z the slowest
    majorant: Array  # (y, 2) f32, a row for each cell: upper bound of its density; coefficient for emission, 0 where it has none

    # (X, 10) i32: first texel, width, height, wrap s, wrap t (0 repeat 1 mirror 2 clamp), encoding, UV set, the row of the layer
    # above (-1: none), the operation by which it is a layer itself
    texture: Array
    texture_transform: Array  # (X, 9) f32: rows of the 2x3 UV matrix; strength, gain and maximum as a layer
    texel: Array  # (N, 4) u8 RGBA, or two rows of 16-bit RG and BA a texel; all textures consecutively, rows from the top

    light_primitive: Array  # (L,) i32: the emitting primitive, or T + S + a row of `punctual`; environments are not listed
    light_cdf: Array  # (L + 1,) f32: cdf of lights by power, 0 ... 1
    light_node: Array  # (Y, LIGHT_ROWS, 8) f32: the light tree (renderer/arrays/light_rows.py); no rows for few lights
    light_area: Array  # (L,) f32, 0 for punctual lights
    light_parallelogram: Array  # (L, PARALLELOGRAM) f32 (renderer/arrays/light_rows.py), or no rows if no light is one
    guide: Array  # (G,) i32: target primitives of `sampling: mixture`
    target: Array  # (a, TARGET_COLUMNS) f32 (renderer/arrays/light_rows.py): the bodies at which paths aim
    pivot: Array  # (p, PIVOT_COLUMNS) f32 (renderer/arrays/light_rows.py): small lamps, if media scatter light
    sun: Array  # (U,) i32: the lights that are suns, which rays hit
    punctual_kind: Array  # (K,) i32: renderer.kernel.light.punctual's POINT, SPOT, DIRECTIONAL, SUN
    punctual: Array  # (K, 12) f32: renderer/scene/punctual.py
    # Emission maps of punctual lights (renderer/kernel/light/emission_map.py). Of E maps: the first texel,
    # width, height, kind; scale and offset from coordinates to columns and rows, and the first and last
    # column and row with light; linear radiance factors.
    emission_map: Array  # (E, 4) i32
    emission_window: Array  # (E, 8) f32
    emission: Array  # (e, 3) f32
    emission_frame: Array  # (K, 4) f32: unit vector r, and the light's map, -1 for none; no rows if no light has one

    environment: Array  # (H, W, 3) f32 radiance, colour and strength multiplied in; (1, 1, 3) if constant, zeros if none
    environment_marginal: Array  # (H + 1,) f32: cdf over rows: weight (renderer/scene/lights.py) times solid angle
    environment_conditional: Array  # (H, W + 1) f32: cdf within a row
    environment_row_start: Array  # (A,) i32: guide tables of the cdfs (renderer/scene/cutpoints.py)
    environment_column_start: Array  # (H, B) i32
    # (12,) f32: cos and sin of the rotation, mean luminance, probability of choosing it over the lights; the sun's direction 3,
    # 1 - cos of its half angle (0: no sun), its radiance 3, its share of the environment's samples
    environment_frame: Array

    bounds: Array  # (2, 3) f32: lower and upper corner of all geometry

    # While the shutter is open, at bvh.keyed_packets[1] keys, key by key: the last vertices and the last spheres.
    key_position: Array = np.zeros((0, 3), np.float32)  # (D, 3) f32
    key_normal: Array = np.zeros((0, 3), np.float32)  # (D, 3) f32
    key_sphere: Array = np.zeros((0, 4), np.float32)  # (Z, 4) f32
    key_punctual: Array = np.zeros((0, 12), np.float32)  # (J, 12) f32: rows of `punctual`, light by light
    key_emission_frame: Array = np.zeros((0, 4), np.float32)  # (J, 4) f32: rows of `emission_frame`, light by light
    key_texture: Array = np.zeros((0, 6), np.float32)  # (F, 6) f32: matrices of `texture_transform`, texture by texture

    # Light groups by their numbers: 0 is that of lights without a name, k the k-th name in `group_name`.
    light_group: Array = np.zeros(0, np.int32)  # (L,) i32, or no rows if no light has a group
    material_group: Array = np.zeros(0, np.int32)  # (M,) i32, of unlit surfaces, or no rows likewise
    environment_group: Array = np.zeros(1, np.int32)  # (1,) i32
    group_name: Array = np.zeros(0, np.uint8)  # (g,) u8: the names as UTF-8, separated by zeros
    # (number of groups + 1,) i32: the number of each group's planes in the film; None without such planes. Set by the settings
    # (renderer/light_groups.py), not stored.
    group_plane: Any = None

    # Spectra that the file gives for lights, reflectances and metals (renderer/arrays/spectrum.py), for spectral rendering.
    given_spectrum: Array = np.zeros((0, GIVEN_COLUMNS), np.float32)  # (c, GIVEN_COLUMNS) f32

    # Light links (renderer/kernel/light/links.py); no rows if every light illuminates everything.
    light_link: Array = np.zeros(0, np.int32)  # (L,) i32: the number of each light's link set; 0: it illuminates everything
    object_links: Array = np.zeros(0, np.int32)  # (o,) i32: bit k is set if lights of link set k illuminate the object

    # The kinds of rays that see each light, and what blocks it (LIGHT_ROOT_BIT in rows.py); no rows if bvh.ray_roots has two.
    light_visibility: Array = np.zeros(0, np.int32)  # (L,) i32

    # (3,) f64: the world-space position of the scene's (0, 0, 0) (renderer/scene/origin.py); positions above are relative to it.
    origin: Array = np.zeros(3)

    path_guide: Any = None  # Guide (renderer/arrays/guide.py) while a kernel samples it; never stored

    has: SceneFeatures = EVERYTHING  # the kernel features that the scene needs
    caustics: Any = None  # CausticTables (renderer/scene/caustics.py) while a kernel samples light through casters; never stored
    spectrum: Any = None  # SpectrumTables (renderer/arrays/spectrum.py) while a kernel renders spectra; never stored


# Each array's element type and shape, in the file's order: most frequently read first, where alignment is best.
# A letter is a length that must agree in all arrays; E+1 is one more than E, E? is E or 0.
LAYOUT: dict[str, tuple[str, tuple[int | str, ...]]] = {
    "bvh.node": ("<f4", ("N", NODE_ROWS, WIDTH)),
    "bvh.packet": ("<f4", ("C", PACKET_ROWS, WIDTH)),
    "bvh.to_local": ("<f8", ("I", 3, 4)),
    "to_world": ("<f8", ("I", 3, 4)),
    "bvh.instance_root": ("<i4", ("I",)),
    "instance_stretch": ("<f4", ("I", 2)),
    "instance_material": ("<i4", ("I",)),
    "instance_object": ("<i4", ("I",)),
    "position": ("<f4", ("V", 3)),
    "normal": ("<f4", ("V", 3)),
    "uv": ("<f4", ("V?", 2)),
    "uv1": ("<f4", ("V?", 2)),
    "color": ("<f4", ("V?", 4)),
    "tangent": ("<f4", ("V?", 4)),
    "triangle": ("<i4", ("T", 4)),
    "part": ("<i4", ("P", 3)),
    "triangle_light": ("<i4", ("T?",)),
    "sphere": ("<f4", ("S", 4)),
    "sphere_material": ("<i4", ("S",)),
    "sphere_light": ("<i4", ("S",)),
    "sphere_object": ("<i4", ("S",)),
    "material_kind": ("<i4", ("M",)),
    "material_flags": ("<i4", ("M",)),
    "material": ("<f4", ("M", COLUMNS)),
    "material_texture": ("<i4", ("M", SLOTS)),
    "medium": ("<f4", ("m", MEDIUM_COLUMNS)),
    "material_medium": ("<i4", ("M",)),
    "volume": ("<f4", ("v", VOLUME_COLUMNS)),
    "volume_grid": ("<i4", ("v", VOLUME_GRID_COLUMNS)),
    "texture": ("<i4", ("X", TEXTURE_COLUMNS)),
    "texture_transform": ("<f4", ("X", TRANSFORM_COLUMNS)),
    "light_primitive": ("<i4", ("L",)),
    "light_cdf": ("<f4", ("L+1",)),
    "light_node": ("<f4", ("Y", LIGHT_ROWS, LIGHT_WIDTH)),
    "light_area": ("<f4", ("L",)),
    "light_parallelogram": ("<f4", ("L?", PARALLELOGRAM)),
    "guide": ("<i4", ("G",)),
    "target": ("<f4", ("a", TARGET_COLUMNS)),
    "pivot": ("<f4", ("p", PIVOT_COLUMNS)),
    "sun": ("<i4", ("U",)),
    "punctual_kind": ("<i4", ("K",)),
    "punctual": ("<f4", ("K", 12)),
    "emission_map": ("<i4", ("E", 4)),
    "emission_window": ("<f4", ("E", 8)),
    "emission_frame": ("<f4", ("K?", 4)),
    "environment": ("<f4", ("H", "W", 3)),
    "environment_marginal": ("<f4", ("H+1",)),
    "environment_conditional": ("<f4", ("H", "W+1")),
    "environment_row_start": ("<i4", ("A",)),
    "environment_column_start": ("<i4", ("H", "B")),
    "environment_frame": ("<f4", (12,)),
    "bounds": ("<f4", (2, 3)),
    "origin": ("<f8", (3,)),
    "bvh.motion": ("<f8", ("R", KEY_COLUMNS)),
    "bvh.instance_motion": ("<i4", ("I?", 2)),
    "bvh.keyed_packets": ("<i4", (2,)),
    "bvh.ray_roots": ("<i4", ("r",)),
    "key_position": ("<f4", ("D", 3)),
    "key_normal": ("<f4", ("D", 3)),
    "key_sphere": ("<f4", ("Z", 4)),
    "key_punctual": ("<f4", ("J", 12)),
    "key_emission_frame": ("<f4", ("J?", 4)),
    "key_texture": ("<f4", ("F", 6)),
    "light_group": ("<i4", ("L?",)),
    "material_group": ("<i4", ("M?",)),
    "environment_group": ("<i4", (1,)),
    "light_link": ("<i4", ("L?",)),
    "object_links": ("<i4", ("o",)),
    "light_visibility": ("<i4", ("L?",)),
    "emission": ("<f4", ("e", 3)),
    "voxel": ("<f4", ("x",)),
    "majorant": ("<f4", ("y", 2)),
    "texel": ("|u1", ("Q", 4)),
    "group_name": ("|u1", ("g",)),
    "given_spectrum": ("<f4", ("c", GIVEN_COLUMNS)),
}

_LEAST = dict.fromkeys("NHWABm", 1) | {"r": 2}  # lengths in LAYOUT that are never 0: nodes, the environment, media, roots


def flat(scene: CompiledScene) -> dict[str, Array]:
    """Returns array name -> array for a compiled scene, in the layout's order, without nested tuples."""
    return {name: getattr(scene.bvh, name[4:]) if name.startswith("bvh.") else getattr(scene, name) for name in LAYOUT}


def nested(arrays: dict[str, Array]) -> CompiledScene:
    """Returns the compiled scene that consists of the named arrays: the inverse of `flat`."""
    bvh: dict[str, Any] = {name[4:]: array for name, array in arrays.items() if name.startswith("bvh.")}
    rest: dict[str, Any] = {name: array for name, array in arrays.items() if not name.startswith("bvh.")}
    return CompiledScene(bvh=Bvh(**bvh), **rest)


def example() -> CompiledScene:
    """Returns an empty scene that passes `check`; its array types are those for which kernels are compiled.

    It has one root without children, one black texel of the environment, one medium, and no geometry, materials or lights.
    """
    arrays = {name: np.zeros([_example_length(each) for each in shape], kind) for name, (kind, shape) in LAYOUT.items()}
    arrays["bvh.node"][:, 0:ROW_CHILD:2], arrays["bvh.node"][:, 1:ROW_CHILD:2] = np.inf, -np.inf
    arrays["bvh.keyed_packets"][:] = NEVER, 1
    return nested({name: _read_only(array) for name, array in arrays.items()})


def _example_length(length: int | str) -> int:
    """Returns the length of an axis in the example scene of `example`.

    length: from LAYOUT, either a number or the name of a length. Lengths have their least value; the suffix "+1" adds one.
    """
    if isinstance(length, int):
        return length
    return _LEAST.get(length[0], 0) + int(length.endswith("+1"))


def _read_only(array: Array) -> Array:
    array.flags.writeable = False
    return array


def seal(scene: CompiledScene, unchecked: dict[str, Array] | None = None) -> CompiledScene:
    """Returns the scene after checking it, with every array C-contiguous, of its declared dtype and read-only.

    Copies only if necessary. unchecked: array name -> rows whose indices have not been checked yet; None: all rows. Raises
    SceneError if the arrays are inconsistent, since the kernel does not check indices.
    """
    arrays = {}
    for name, array in flat(scene).items():
        arrays[name] = _read_only(np.ascontiguousarray(array, LAYOUT[name][0]).view())
    check(arrays, unchecked)
    return nested(arrays)


def check(arrays: dict[str, Array], unchecked: dict[str, Array] | None = None) -> None:
    """Raises SceneError if shapes are inconsistent or an index is out of range. unchecked: see `seal`."""
    lengths: dict[str, int] = {}
    for name, (_, shape) in LAYOUT.items():
        actual = arrays[name].shape
        if len(actual) != len(shape):
            raise SceneError(f"{name} has {len(actual)} dimensions where {len(shape)} belong")
        for length, expected in zip(actual, shape, strict=True):
            if isinstance(expected, str) and expected.endswith("?") and length == 0:
                continue
            if isinstance(expected, str):
                key, more = expected[0], 1 if expected.endswith("+1") else 0
                if lengths.setdefault(key, length - more) != length - more:
                    raise SceneError(f"{name} has the shape {actual}, which does not fit the other arrays")
            elif length != expected:
                raise SceneError(f"{name} has the shape {actual}; {expected} belongs where {length} stands")
    arrays = arrays | (unchecked or {})
    primitives = lengths["T"] + lengths["S"]
    for name, lower, upper in (
        ("sphere_material", 0, lengths["M"]),
        ("instance_material", -1, lengths["M"]),
        ("bvh.instance_root", 0, lengths["N"]),
        ("bvh.ray_roots", 0, lengths["N"]),
        ("triangle_light", -1, lengths["L"]),
        ("sphere_light", -1, lengths["L"]),
        ("light_primitive", 0, primitives + lengths["K"]),
        ("guide", 0, primitives),
        ("sun", 0, lengths["L"]),
        ("material_texture", -1, lengths["X"]),
        ("material_medium", -1, lengths["m"]),
        ("light_link", 0, 32),
        ("environment_row_start", 0, lengths["H"]),
        ("environment_column_start", 0, lengths["W"]),
    ):
        _check_range(name, arrays[name], lower, upper)
    if lengths["o"]:  # of every object
        _check_range("instance_object", arrays["instance_object"], 0, lengths["o"])
        _check_range("sphere_object", arrays["sphere_object"], 0, lengths["o"])
        _check_range("a part's object", arrays["part"][:, PART_OBJECT], 0, lengths["o"])
        if len(arrays["light_link"]) != lengths["L"]:
            raise SceneError("light_link has no rows, but object_links has some")
    if lengths["r"] > 2:  # roots for each kind of ray
        if lengths["r"] < len(RAY_KINDS) or len(arrays["light_visibility"]) != lengths["L"]:
            raise SceneError("bvh.ray_roots has roots for some kinds of rays, but light_visibility or other roots are missing")
        _check_range("a light's root", arrays["light_visibility"] >> LIGHT_ROOT_BIT, 0, lengths["r"])
    if (arrays["light_primitive"][arrays["sun"]] < primitives).any():
        raise SceneError("a sun must be a light without a body")
    _check_range("triangle", arrays["triangle"][:, :3], 0, lengths["V"])
    _check_range("a triangle's part", arrays["triangle"][:, 3], 0, lengths["P"])
    _check_range("a part's material", arrays["part"][:, PART_MATERIAL], 0, lengths["M"])
    if not len(arrays["triangle_light"]) and arrays["part"][:, PART_SHINES].any():
        raise SceneError("a part emits light, but none of its triangles is a light")
    if lengths["T"] and not len(arrays["uv"]) and (arrays["material_flags"] & TEXTURED).any():
        raise SceneError("a material has a texture, and no vertex has coordinates in it")
    texture = arrays["texture"].astype(np.int64)
    if len(texture) and not (
        texture[:, :3].min() >= 0
        and texture[:, 1:3].min() > 0
        and (texture[:, 0] + texture[:, 1] * texture[:, 2] * np.where(texture[:, ENCODING] >= LINEAR_16, 2, 1)).max()
        <= lengths["Q"]
    ):
        raise SceneError("a texture exceeds the texel array")
    maps = arrays["emission_map"].astype(np.int64)
    if len(maps) and not (
        maps.min() >= 0 and maps[:, 1:3].min() > 0 and (maps[:, 0] + maps[:, 1] * maps[:, 2]).max() <= lengths["e"]
    ):
        raise SceneError("a light's map exceeds its texels")
    _check_volumes(arrays, lengths)
    for name in ("emission_frame", "key_emission_frame"):
        _check_range(f"{name}'s map", arrays[name][:, 3].astype(np.int64), -1, lengths["E"])
    above = texture[:, ABOVE]
    if not ((above == -1) | ((above > np.arange(len(above))) & (above < len(above)))).all():
        raise SceneError("a texture's layer must come later in the list of textures")
    child = arrays["light_node"][:, CHILD].view("<i4")
    further = (child > np.arange(len(child))[:, None]) & (child < len(child))
    if not np.where(child < 0, ~child < lengths["L"], further).all():
        raise SceneError("the light tree points outside its nodes or lights, or backwards")
    _check_motion(arrays, lengths)
    if any(lengths[letter] < least for letter, least in _LEAST.items()):
        raise SceneError("the BVH or the environment is empty")
    if not 1 <= lengths["m"] < MOST_MEDIA:
        raise SceneError("the number of media is 0 or exceeds the limit of a path")
    children = arrays["bvh.node"][:, NODE_ROWS - 1].view("<i4")
    leaves = ~children[children < 0]
    beyond = np.where(leaves & LEAF_KIND == INSTANCE, lengths["I"], lengths["C"])
    if int(children.max(initial=0)) >= lengths["N"] or not (leaves >> 2 < beyond).all():
        raise SceneError("the BVH points outside its nodes")
    if (leaves & LEAF_KIND == CURVES).any() and not (
        (np.isin(arrays["material_kind"], (HAIR, HUANG)) | (arrays["material_flags"] & FLAT_CURVES != 0)).any()
        and len(arrays["tangent"])
    ):
        raise SceneError("the BVH has curves, which only scenes with hair or flat curves, and with tangents, may have")
    numbers = arrays["bvh.packet"][:, PACKET_ROWS - 1].view("<i4")[~np.isnan(arrays["bvh.packet"][:, 0])]
    if numbers.size and not 0 <= int(numbers.min()) <= int(numbers.max()) < primitives:
        raise SceneError("the BVH refers to a missing primitive")


def _check_volumes(arrays: dict[str, Array], lengths: dict[str, int]) -> None:
    """Raises SceneError if a volume's grids exceed the voxels or cells, or a medium has a volume that is missing."""
    number = arrays["medium"][:, MEDIUM_VOLUME]
    if not ((number >= 0) & (number <= lengths["v"]) & (number == np.floor(number))).all():
        raise SceneError("a medium refers to a missing volume")
    grid = arrays["volume_grid"].astype(np.int64)
    if not len(grid):
        return
    count, cells = grid[:, 0] * grid[:, 1] * grid[:, 2], grid[:, 5] * grid[:, 6] * grid[:, 7]
    first = grid[:, 3:5]
    if not (
        grid[:, [0, 1, 2, 5, 6, 7]].min() > 0
        and grid[:, [3, 8]].min() >= 0
        and (first + count[:, None]).max() <= lengths["x"]
        and (grid[:, 8] + cells).max() <= lengths["y"]
    ):
        raise SceneError("a volume exceeds its voxels or cells")


def _check_motion(arrays: dict[str, Array], lengths: dict[str, int]) -> None:
    """Raises SceneError if moving geometry has too few keys."""
    first, count = arrays["bvh.instance_motion"].astype(np.int64).T
    if not ((count == 0) | ((count >= 2) & (first >= 0) & (first + count <= lengths["R"]))).all():
        raise SceneError("an instance has fewer keys than declared")
    start, keys = (int(number) for number in arrays["bvh.keyed_packets"])
    leaf = ~arrays["bvh.node"][:, NODE_ROWS - 1].view("<i4")
    number = leaf[(leaf >= 0) & (leaf & LEAF_KIND != INSTANCE)] >> 2
    if start < lengths["C"] and not (keys >= 2 and int(number.max(initial=0)) + keys <= lengths["C"]):
        raise SceneError("a packet has fewer keys than declared")
    moving = lengths["D"] + lengths["Z"]
    if moving and (start < 0 or keys < 2 or lengths["D"] % keys or lengths["Z"] % keys):
        raise SceneError("vertices or spheres have fewer keys than declared")
    if lengths["D"] > keys * lengths["V"] or lengths["Z"] > keys * lengths["S"]:
        raise SceneError("there are more keys than vertices or spheres")
    if lengths["J"] and (lengths["K"] == 0 or lengths["J"] % lengths["K"] or lengths["J"] < 2 * lengths["K"]):
        raise SceneError("a light has fewer keys than declared")
    if lengths["F"] and (lengths["X"] == 0 or lengths["F"] % lengths["X"] or lengths["F"] < 2 * lengths["X"]):
        raise SceneError("a texture has fewer keys than declared")


def _check_range(name: str, array: Array, lower: int, upper: int) -> None:
    if array.size and not lower <= int(array.min()) <= int(array.max()) < upper:
        raise SceneError(f"{name} points outside {lower} ... {upper - 1}")
