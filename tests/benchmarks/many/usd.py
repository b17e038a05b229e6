"""USD files with many elements of one kind."""

from __future__ import annotations

__all__ = ["USD"]

Files = dict[str, bytes]
_TRIANGLE = (
    'def Mesh "m{0}" {{ uniform token subdivisionScheme = "none"\n'
    "int[] faceVertexCounts = [3]; int[] faceVertexIndices = [0, 1, 2]\n"
    "point3f[] points = [({0}, 0, 0), ({0}, 1, 0), ({0}, 0, 1)]\n{1} }}\n"
)
_SURFACE = (
    'def Material "M{0}" {{ token outputs:surface.connect = <{1}/M{0}/S.outputs:surface>\n def Shader "S" {{\n'
    'uniform token info:id = "UsdPreviewSurface"\n{2}\ntoken outputs:surface }}\n{3} }}\n'
)
_PICTURE = 'def Shader "T" {{ uniform token info:id = "UsdUVTexture"\nasset inputs:file = @{}.png@\nfloat3 outputs:rgb }}'


def _stage(inside: str, head: str = "") -> Files:
    """Returns a USD file, as its name and content. inside: the statements of the layer. head: statements of its header."""
    return {"a.usda": f"#usda 1.0\n({head})\n{inside}".replace(" }", "\n}").encode()}


def prims(n: int) -> Files:
    return _stage("".join(_TRIANGLE.format(i, "") for i in range(n)))


def chain(n: int) -> Files:
    n = min(n, 300)
    return _stage("".join(f'def Xform "x{i}" {{\n' for i in range(n)) + _TRIANGLE.format(0, "") + "}\n" * n)


def materials(n: int) -> Files:
    color = "color3f inputs:diffuseColor = ({}, 0, 0)"
    surfaces = "".join(_SURFACE.format(i, "", color.format(i % 255 / 255), "") for i in range(n))
    return _stage(surfaces + "".join(_TRIANGLE.format(i, f"rel material:binding = </M{i}>") for i in range(n)))


def missing_textures(n: int) -> Files:
    color = "color3f inputs:diffuseColor.connect = </M{}/T.outputs:rgb>"
    surfaces = "".join(_SURFACE.format(i, "", color.format(i), _PICTURE.format(i)) for i in range(n))
    return _stage(surfaces + "".join(_TRIANGLE.format(i, f"rel material:binding = </M{i}>") for i in range(n)))


def subsets(n: int) -> Files:
    points = ", ".join(f"({i}, 0, 0), ({i}, 1, 0), ({i}, 0, 1)" for i in range(n))
    inside = "".join(
        f'def GeomSubset "s{i}" {{ uniform token elementType = "face"; int[] indices = [{i}]\n'
        f'uniform token familyName = "materialBind"; rel material:binding = </M0> }}\n'
        for i in range(n)
    )
    mesh = f"int[] faceVertexCounts = [{', '.join(['3'] * n)}]; int[] faceVertexIndices = [{', '.join(map(str, range(3 * n)))}]"
    return _stage(_SURFACE.format(0, "", "", "") + f'def Mesh "m" {{ {mesh}\npoint3f[] points = [{points}]\n{inside} }}')


def instances(n: int) -> Files:
    places = ", ".join(f"({i}, 0, 0)" for i in range(n))
    return _stage(
        f'def PointInstancer "p" {{ rel prototypes = [</p/m0>]; int[] protoIndices = [{", ".join(["0"] * n)}]\n'
        f"point3f[] positions = [{places}]\n{_TRIANGLE.format(0, '')} }}"
    )


def prototypes(n: int) -> Files:
    """Returns a USD file of a PointInstancer with n prototypes and n points."""
    places = ", ".join(f"({i}, 0, 0)" for i in range(n))
    targets = ", ".join(f"</p/m{i}>" for i in range(n))
    return _stage(
        f'def PointInstancer "p" {{ rel prototypes = [{targets}]; int[] protoIndices = [{", ".join(map(str, range(n)))}]\n'
        f"point3f[] positions = [{places}]\n{''.join(_TRIANGLE.format(i, '') for i in range(n))} }}"
    )


def references(n: int) -> Files:
    again = "".join(f'def Xform "r{i}" (instanceable = true; references = </class>) {{}}\n' for i in range(n))
    return _stage(f'class Xform "class" {{ {_TRIANGLE.format(0, "")} }}\n{again}')


def layers(n: int) -> Files:
    n = min(n, 900)
    files = _stage("".join(f'def Xform "r{i}" (references = @l{i}.usda@) {{}}\n' for i in range(n)))
    layer = f'#usda 1.0\n(defaultPrim = "x")\ndef Xform "x" {{ {_TRIANGLE.format(0, "")} }}'.replace(" }", "\n}").encode()
    return files | {f"l{i}.usda": layer for i in range(n)}


def lights(n: int) -> Files:
    return _stage(
        _TRIANGLE.format(0, "") + "".join(f'def SphereLight "l{i}" {{ float inputs:radius = 0.1 }}\n' for i in range(n))
    )


def cameras(n: int) -> Files:
    return _stage(_TRIANGLE.format(0, "") + "".join(f'def Camera "c{i}" {{}}\n' for i in range(n)))


def time_samples(n: int) -> Files:
    times = ", ".join(f"{i}: ({i}, 0, 0)" for i in range(n))
    place = f'double3 xformOp:translate.timeSamples = {{ {times} }}\nuniform token[] xformOpOrder = ["xformOp:translate"]'
    return _stage(_TRIANGLE.format(0, place), f"startTimeCode = 0; endTimeCode = {n}")


def joints(n: int) -> Files:
    names = ", ".join(f'"j{i}"' for i in range(n))
    ones = ", ".join(["((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1))"] * n)
    mesh = (
        'prepend apiSchemas = ["SkelBindingAPI"]', "rel skel:skeleton = </r/s>",
        "int[] primvars:skel:jointIndices = [0, 0, 0] (elementSize = 1; interpolation = \"vertex\")",
        "float[] primvars:skel:jointWeights = [1, 1, 1] (elementSize = 1; interpolation = \"vertex\")",
    )  # fmt: skip
    skin = _TRIANGLE.format(0, "\n".join(mesh[1:])).replace('"m0" {', f'"m0" ({mesh[0]}) {{', 1)
    skeleton = (
        f'def Skeleton "s" {{ uniform token[] joints = [{names}]\nuniform matrix4d[] bindTransforms = [{ones}]\n'
        f"uniform matrix4d[] restTransforms = [{ones}] }}"
    )
    return _stage(f'def SkelRoot "r" {{ {skeleton}\n{skin} }}')


def points(n: int) -> Files:
    places = ", ".join(f"({i}, 0, 0)" for i in range(n))
    return _stage(f'def Points "p" {{ point3f[] points = [{places}]; float[] widths = [0.1] (interpolation = "constant") }}')


def curves(n: int) -> Files:
    places = ", ".join(f"({i}, 0, 0), ({i}, 1, 0)" for i in range(n))
    return _stage(
        f'def BasisCurves "c" {{ uniform token type = "linear"; int[] curveVertexCounts = [{", ".join(["2"] * n)}]\n'
        f'point3f[] points = [{places}]; float[] widths = [0.1] (interpolation = "constant") }}'
    )


_ALL = (
    *(prims, chain, materials, missing_textures, subsets, instances, prototypes, references, layers, lights, cameras),
    *(time_samples, joints, points, curves),
)
USD = {f"USD {each.__name__.replace('_', ' ')}": each for each in _ALL}
