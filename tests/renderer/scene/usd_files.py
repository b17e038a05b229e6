"""Small USD stages for tests, written by usd-core."""

from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

from renderer.scene.animation import Moment
from renderer.scene.load import Shot

CUBE = np.array([(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)], float)
QUADS = [0, 3, 2, 1, 4, 5, 6, 7, 0, 1, 5, 4, 1, 2, 6, 5, 2, 3, 7, 6, 3, 0, 4, 7]
SQUARE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
TYPES = Sdf.ValueTypeNames

MTLX = """<?xml version="1.0"?>
<materialx version="1.38" colorspace="lin_rec709" fileprefix="maps/">
  <nodegraph name="graph">
    <input name="gain" type="float" value="0.5"/>
    <texcoord name="uv" type="vector2"/>
    <tiledimage name="picture" type="color3">
      <input name="file" type="filename" value="t.png" colorspace="srgb_texture"/>
      <input name="texcoord" type="vector2" nodename="uv"/>
      <input name="uvtiling" type="vector2" value="2, 3"/>
    </tiledimage>
    <multiply name="product" type="color3">
      <input name="in1" type="color3" nodename="picture"/>
      <input name="in2" type="float" interfacename="gain"/>
    </multiply>
    <separate3 name="apart" type="multioutput"><input name="in" type="color3" nodename="picture"/></separate3>
    <output name="color" type="color3" nodename="product"/>
    <output name="rough" type="float" nodename="apart" output="outg"/>
  </nodegraph>
  <standard_surface name="surface" type="surfaceshader">
    <input name="base_color" type="color3" nodegraph="graph" output="color"/>
    <input name="specular_roughness" type="float" nodegraph="graph" output="rough"/>
    <input name="metalness" type="float" nodename="metal"/>
    <input name="emission" type="float" value="1"/>
    <input name="emission_color" type="color3" value="0.5, 0.25, 1" colorspace="srgb_texture"/>
    <input name="specular_IOR" type="float" value="1.7"/>
    <input name="thin_walled" type="boolean" value="false"/>
  </standard_surface>
  <constant name="metal" type="float"><input name="value" type="float" value="0.75"/></constant>
  <surfacematerial name="Look" type="material">
    <input name="surfaceshader" type="surfaceshader" nodename="surface"/>
  </surfacematerial>
  %s
</materialx>"""  # %s is replaced by further elements


def stage(path, up="Y", unit=1.0):
    """Returns a new stage in a file, in the format of the file's suffix."""
    made = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(made, up)
    UsdGeom.SetStageMetersPerUnit(made, unit)
    return made


def mesh(on, path, points=SQUARE, counts=(4,), corners=(0, 1, 2, 3), scheme="none"):
    """Adds a mesh of polygons to the stage, and returns it."""
    made = UsdGeom.Mesh.Define(on, path)
    made.CreatePointsAttr([Gf.Vec3f(*map(float, p)) for p in points])
    made.CreateFaceVertexCountsAttr(list(counts))
    made.CreateFaceVertexIndicesAttr(list(corners))
    made.CreateSubdivisionSchemeAttr(scheme)
    return made


def cube(on, path, **options):
    """Adds a cube from -1 to 1 to the stage, and returns it."""
    return mesh(on, path, CUBE, [4] * 6, QUADS, **options)


def material(on, path, kind="UsdPreviewSurface", context="", **inputs):
    """Adds a material with a surface shader of this kind; returns (material, shader).

    inputs: (type, value) or (type, connected output).
    """
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
    """Returns the output of a UsdUVTexture that reads the file at the primvar st."""
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
    """Binds a prim or a subset to a material."""
    UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(made)


def read(path, moment=None, **options):
    """Returns the scene read from the file at the given moment."""
    path = Path(path)
    shot = Shot(path.parent, path.name, **options)
    return shot.scene_at(moment or Moment())


def world(description, number=0):
    """Returns the world-space corners (T, 3, 3) of an instance's triangles."""
    instance = description.instances[number]
    made = description.meshes[instance.mesh]
    placed = made.positions.astype(float) @ instance.transform[:3, :3].T + instance.transform[:3, 3]
    return placed[made.triangles]


def ours(on, point):
    """Converts a point of the stage to ours: in metres, with Y up."""
    x, y, z = np.array(point, float) * UsdGeom.GetStageMetersPerUnit(on)
    return np.array((x, z, -y) if UsdGeom.GetStageUpAxis(on) == "Z" else (x, y, z))
