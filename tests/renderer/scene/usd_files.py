"""USD files that tests write: small stages by usd-core itself."""

from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

from renderer.scene.animation import Moment
from renderer.scene.load import Shot

CUBE = np.array([(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)], float)
QUADS = [0, 3, 2, 1, 4, 5, 6, 7, 0, 1, 5, 4, 1, 2, 6, 5, 2, 3, 7, 6, 3, 0, 4, 7]
SQUARE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
TYPES = Sdf.ValueTypeNames


def stage(path, up="Y", unit=1.0):
    """A new stage in a file, by its suffix."""
    made = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(made, up)
    UsdGeom.SetStageMetersPerUnit(made, unit)
    return made


def mesh(on, path, points=SQUARE, counts=(4,), corners=(0, 1, 2, 3), scheme="none"):
    """A mesh of polygons."""
    made = UsdGeom.Mesh.Define(on, path)
    made.CreatePointsAttr([Gf.Vec3f(*map(float, p)) for p in points])
    made.CreateFaceVertexCountsAttr(list(counts))
    made.CreateFaceVertexIndicesAttr(list(corners))
    made.CreateSubdivisionSchemeAttr(scheme)
    return made


def cube(on, path, **options):
    """A cube from -1 to 1."""
    return mesh(on, path, CUBE, [4] * 6, QUADS, **options)


def material(on, path, kind="UsdPreviewSurface", context="", **inputs):
    """A material whose surface has these inputs: (type, value), or an output that they are connected to. (material, shader)"""
    made = UsdShade.Material.Define(on, path)
    shader = UsdShade.Shader.Define(on, f"{path}/surface")
    shader.CreateIdAttr(kind)
    for name, (type_name, value) in inputs.items():
        given = shader.CreateInput(name, type_name)
        if isinstance(value, UsdShade.Output):
            given.ConnectToSource(value)
        else:
            given.Set(value)
    made.CreateSurfaceOutput(context).ConnectToSource(shader.ConnectableAPI(), "surface")
    return made, shader


def texture(on, path, file, output="rgb", st=None, **inputs):
    """The output of a UsdUVTexture that reads a file by the primvar st."""
    shader = UsdShade.Shader.Define(on, path)
    shader.CreateIdAttr("UsdUVTexture")
    shader.CreateInput("file", TYPES.Asset).Set(Sdf.AssetPath(file))
    reader = UsdShade.Shader.Define(on, f"{path}_st")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", TYPES.String).Set("st")
    shader.CreateInput("st", TYPES.Float2).ConnectToSource(st or reader.CreateOutput("result", TYPES.Float2))
    for name, (type_name, value) in inputs.items():
        shader.CreateInput(name, type_name).Set(value)
    return shader.CreateOutput(output, TYPES.Float3 if output == "rgb" else TYPES.Float)


def bind(prim, made):
    """Binds a prim, or a subset, to a material."""
    UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(made)


def read(path, moment=None, **options):
    """The scene of a file."""
    path = Path(path)
    shot = Shot(path.parent, path.name, **options)
    return shot.at(moment or Moment())


def world(description, number=0):
    """(T, 3, 3) the corners of an instance's triangles in the world."""
    instance = description.instances[number]
    made = description.meshes[instance.mesh]
    placed = made.positions.astype(float) @ instance.transform[:3, :3].T + instance.transform[:3, 3]
    return placed[made.triangles]


def ours(on, point):
    """A point of the stage's as ours: in metres, with Y up."""
    x, y, z = np.array(point, float) * UsdGeom.GetStageMetersPerUnit(on)
    return np.array((x, z, -y) if UsdGeom.GetStageUpAxis(on) == "Z" else (x, y, z))
