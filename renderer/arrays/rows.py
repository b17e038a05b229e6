"""The columns of the compiled scene's tables: materials, their texture slots and flags, textures and media.

A colour takes three columns; the constant named after it is the index of the first.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

# Columns of `part`, int32: properties common to all triangles of a part.
PART_MATERIAL, PART_OBJECT, PART_SHINES = range(3)
PART_COLUMNS = 3

# Numbers of material kinds, as in `material_kind`. From CONDUCTOR on, a kernel looks up the whole row (`look_up_layers`).
DIFFUSE, MIRROR, GLASS, METALLIC_ROUGHNESS, CONDUCTOR, BLINN_PHONG, UNLIT, LAYERED, INTERFACE, MEDIUM, PLASTIC, HAIR, HUANG = (
    range(13)
)


class Kind(NamedTuple):
    """A kind of material: how it scatters, and which kernels can render it.

    stage: the kernel stage that shades vertices on such materials. "rare": shaded one path at a time by
    renderer/kernel/material/rare_materials.py; "none": the kind does not scatter. part: the field of `SceneFeatures` that a
    kernel needs for this kind, empty if none.
    """

    number: int
    name: str  # in scene files, unless the kind is created by packing only
    stage: Literal["diffuse", "metallic_roughness", "conductor", "specular", "rare", "medium", "none"]
    part: Literal["", "layers", "media", "hair", "huang"] = ""
    in_files: bool = True
    faceted: bool = False  # whether its microfacets may have Beckmann's distribution
    model: str | None = None  # its name in the explanation of a path


# All kinds; those of scene files in the order of the schema.
KINDS = (
    Kind(DIFFUSE, "diffuse", "diffuse", model="diffuse"),
    Kind(MIRROR, "mirror", "specular", model="mirror"),
    Kind(GLASS, "glass", "specular", model="glass"),
    Kind(CONDUCTOR, "conductor", "conductor", faceted=True, model="conductor"),
    Kind(BLINN_PHONG, "blinn_phong", "rare", "layers", model="blinn-phong"),
    Kind(UNLIT, "unlit", "none", model="unlit"),
    Kind(METALLIC_ROUGHNESS, "metallic_roughness", "metallic_roughness", model="metallic-roughness"),
    Kind(PLASTIC, "plastic", "rare", "layers", faceted=True, model="plastic"),
    Kind(HAIR, "hair", "rare", "hair", model="hair"),
    Kind(INTERFACE, "interface", "none"),
    Kind(LAYERED, "layered", "rare", "layers", in_files=False, faceted=True, model="layered"),
    Kind(MEDIUM, "medium", "medium", "media", in_files=False),  # for vertices within a medium
    Kind(HUANG, "huang", "rare", "huang", in_files=False, faceted=True, model="huang-hair"),  # hair with model: huang
)
RARE_KINDS = sum(1 << kind.number for kind in KINDS if kind.stage == "rare")  # kinds shaded one path at a time

# Columns of `material`, float32.
BASE = 0
EMISSION = 3
METALLIC = 6
ROUGHNESS = 7
IOR = 8
DOUBLE_SIDED = 9  # 0 or 1
OPACITY = 10
ALPHA_CUTOFF = 11
NORMAL_SCALE = 12
SPECULAR = 13
SPECULAR_COLOR = 14
CLEARCOAT = 17
CLEARCOAT_ROUGHNESS = 18
CLEARCOAT_NORMAL_SCALE = 19
SHEEN_COLOR = 20
SHEEN_ROUGHNESS = 23
TRANSMISSION = 24
ABSORPTION = 25  # per unit length
ANISOTROPY = 28
ROTATION = 29  # cosine and sine of the anisotropy's angle to the tangent
IRIDESCENCE = 31
IRIDESCENCE_IOR = 32
THICKNESS = 33  # of the thin film: minimum and maximum, nanometres
DISPERSION = 35
DIFFUSE_TRANSMISSION = 36
DIFFUSE_TRANSMISSION_COLOR = 37
ETA = 40  # of a conductor
K = 43
SHININESS = 46
F0 = 47  # a dielectric's reflectance at normal incidence
MEAN_FRESNEL = 50  # a conductor's, over the cosine-weighted hemisphere
SUBSURFACE = 53
SUBSURFACE_RADIUS = 54
SUBSURFACE_ANISOTROPY = 57
HAIR_VARIANCE = 58  # of the longitudinal lobe R
HAIR_SCALE = 59  # of the azimuthal logistic distribution
HAIR_TILT = 60  # sine and cosine of the scales' angle
HAIR_COLOR_SCALE = 62  # the root of absorption is the logarithm of the colour times this
COLUMNS = 63
# Hair of Huang et al.'s model takes the columns of conductors.
HUANG_ASPECT = ETA
HUANG_SHARES = ETA + 1  # factors of R, TT and TRT
HUANG_NORMAL = K + 1  # sine and cosine of the normal's angle to the minor axis, which a kernel fills in

# Columns that renderer/kernel/material/layers.py appends to a row when it looks up a material's textures.
COAT_NORMAL = COLUMNS  # in the shading frame
ALPHA_X = COLUMNS + 3
ALPHA_Y = COLUMNS + 4
IS_PANE = COLUMNS + 5  # 0 or 1: glass does not refract
FILM_MEAN = COLUMNS + 6  # reflectance over the hemisphere with a film: metal, then dielectric
HAS_BECKMANN = COLUMNS + 12  # 0 or 1: facets are distributed by Beckmann, else GGX
HAS_NONLINEAR = COLUMNS + 13  # 0 or 1: for plastic
FILM_WAVELENGTHS = COLUMNS + 14  # nanometres, of a path with wavelengths and a material with a thin film; 0 in RGB
LAYER_SLOTS = COLUMNS + 17

# Slots of `material_texture`, int32: the texture's row, or -1.
BASE_TEXTURE = 0
EMISSION_TEXTURE = 1
METALLIC_ROUGHNESS_TEXTURE = 2
NORMAL_TEXTURE = 3
SPECULAR_TEXTURE = 4
SPECULAR_COLOR_TEXTURE = 5
CLEARCOAT_TEXTURE = 6
CLEARCOAT_ROUGHNESS_TEXTURE = 7
CLEARCOAT_NORMAL_TEXTURE = 8
SHEEN_COLOR_TEXTURE = 9
SHEEN_ROUGHNESS_TEXTURE = 10
TRANSMISSION_TEXTURE = 11
ANISOTROPY_TEXTURE = 12
IRIDESCENCE_TEXTURE = 13
THICKNESS_TEXTURE = 14
DIFFUSE_TRANSMISSION_TEXTURE = 15
DIFFUSE_TRANSMISSION_COLOR_TEXTURE = 16
SLOTS = 17

# Columns of `texture`, int32, after first texel, size and wrap modes.
ENCODING = 5  # of the texels: one of the four below
UV_SET = 6
ABOVE = 7  # the row of the layer above this one; -1 for none
BLEND = 8  # blend operation onto the layer below (renderer/kernel/material/blend.py)
NEAREST = 9  # 0 or 1: nearest filtering
TEXTURE_COLUMNS = 10

# Texel encodings. 16-bit codes are little-endian, and a texel then takes two rows of `texel`: RG, BA.
LINEAR_8, SRGB_8, LINEAR_16, HALF_16 = range(4)
HALF_GAIN = 32768.0  # factor for values 0 ... 1 stored as halves, for a range of 29 bits

# Columns of `texture_transform`, float32, after the matrix: parameters of a layer.
STRENGTH = 6
GAIN = 7  # factor of its texels
MOST = 8  # maximum of the stack including this layer
TRANSFORM_COLUMNS = 9

# Bits of `material_flags`, int32, which a kernel tests before it reads columns.
TEXTURED = 1  # has a texture
SECOND_UV = 2  # a texture uses the second UV set
NORMAL_MAPPED = 4
NEEDS_TANGENT = 8
MASKED = 16  # alpha is cut at ALPHA_CUTOFF
BLENDED = 32  # alpha is the probability of a hit
THIN = 64  # transmits without refraction
DISPERSIVE = 128
ABSORBING = 256  # its interior absorbs light
TRANSMITS = 512  # scatters to the far side, too, not only into discrete directions
LAMP = 1024  # emits light without affecting rays that hit it, and casts no shadow
UNSEEN = 2048  # invisible to the camera
SHADELESS = 4096  # invisible to shadow rays
FACING = 8192  # a sphere light that acts as a disk through its centre facing the shading point
SCATTERS_WITHIN = 16384  # some diffuse light is scattered inside: subsurface
BECKMANN = 32768  # microfacets have Beckmann's distribution, else GGX
NONLINEAR = 65536  # plastic with nonlinear colour shifts from internal reflection
CLEAR = 131072  # smooth glass: most light passes in a discrete direction
HOLDOUT = 262144  # before a transparent background, cuts a hole into the picture
CATCHER = 524288  # before a transparent background, shows the shadows on it alone
FROM_DIFFUSE, FROM_GLOSSY, FROM_TRANSMISSION, FROM_VOLUME = 1048576, 2097152, 4194304, 8388608  # invisible to such rays
REFLECTIONS = 16777216  # before a transparent background, shows the reflections on it alone
FLAT_CURVES = 33554432  # curves of it are flat, and face each ray
CATCHES = CATCHER | REFLECTIONS
TRANSPARENT = MASKED | BLENDED
UNSEEN_BY = (UNSEEN, SHADELESS, FROM_DIFFUSE, FROM_GLOSSY, FROM_TRANSMISSION, FROM_VOLUME)  # by kind (RAY_KINDS)

# Words of `light_visibility`: bit k is set if rays of kind k (RAY_KINDS in renderer/bvh/layout.py) see the light. From this bit
# on: the number in `ray_roots` of the root node for its shadow rays.
LIGHT_ROOT_BIT = 8
SEEN_BY_ALL = 1 << LIGHT_ROOT_BIT | 0b111111  # by all kinds of rays, and blocked by all that shadow rays see

# Columns of `medium`, float32.
SIGMA_A = 0  # three, per unit length
SIGMA_S = 3
PHASE_G = 6
MEDIUM_VOLUME = 7  # number of the volume whose density multiplies the coefficients, plus 1; 0: homogeneous
MEDIUM_COLUMNS = 8
MOST_MEDIA = 1024  # one more than the number of media: a path stores three in a word (renderer/kernel/medium/medium_stack.py)

# Columns of `volume`, float32: rows of the 3x4 matrix from the world to the volume, which extends from 0 to 1 on each axis, then
VOLUME_EMISSION = 12  # the colour of its emission, three: radiance per unit length where the grid is 1
VOLUME_COLUMNS = 15
# Columns of `volume_grid`, int32: number of voxels along x, y, z; first number of the density and of the emission (-1: none) in
# `voxel`; number of cells along x, y, z, and the first cell in `majorant`.
VOLUME_GRID_COLUMNS = 9
