"""Builds one small scene in every format, translated by an offset.

It has a floor and a cube, and also a camera and a lamp if the format has them.
"""

from __future__ import annotations

import base64
import io
import json
import zipfile
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from tests.renderer.scene import fbx_text

__all__ = ["EYE", "FILES"]

Point = Sequence[float]

FLOOR = [(-2.0, 0.0, -2.0), (-2.0, 0.0, 2.0), (2.0, 0.0, 2.0), (2.0, 0.0, -2.0)]
FLOOR_FACES = [(0, 1, 2), (0, 2, 3)]
CUBE = [(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]
CUBE_FACES = [
    *((0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)),
    *((2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)),
]
ORIGIN, PLACE, EYE, TARGET, LAMP, BALL = (
    np.array(each)
    for each in [(0.0, 0.0, 0.0), (0.3, 0.5, 0.2), (3.0, 2.5, 4.0), (0.0, 0.5, 0.0), (1.0, 4.0, 2.0), (-1.0, 0.3, 1.0)]
)
SOLIDS = [("floor", FLOOR, FLOOR_FACES, ORIGIN), ("cube", CUBE, CUBE_FACES, PLACE)]


def _words(values: Iterable[Any], between: str = " ") -> str:
    return between.join(repr(each.item() if isinstance(each, np.generic) else each) for each in values)


def _moved(points: Iterable[Point], by: Any) -> list[tuple[float, ...]]:
    return [tuple((np.array(p) + by).tolist()) for p in points]


def _flat(rows: Iterable[Iterable[Any]]) -> list[Any]:
    return [each for row in rows for each in row]


def _camera(offset: Any) -> np.ndarray:
    """Returns the matrix of the offset camera, which looks along its -Z."""
    z = (EYE - TARGET) / np.linalg.norm(EYE - TARGET)
    x = np.cross((0.0, 1.0, 0.0), z)
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3] = np.column_stack([x, np.cross(z, x), z, EYE + offset])
    return matrix


def gltf(offset: Any, under: bool = False, copies: bool = False, skin: bool = False) -> str:
    """Returns the scene as glTF, with the offset in each node.

    under: puts the offset into a common parent node instead. copies: uses EXT_mesh_gpu_instancing. skin: the cube is skinned.
    """
    buffers: list[Any] = []
    views: list[Any] = []
    accessors: list[Any] = []

    def add(values: Any, kind: str, component: int) -> int:
        array = np.ascontiguousarray(values)
        uri = "data:application/octet-stream;base64," + base64.b64encode(array.tobytes()).decode()
        buffers.append({"uri": uri, "byteLength": array.nbytes})
        views.append({"buffer": len(buffers) - 1, "byteLength": array.nbytes})
        count = array.size if kind == "SCALAR" else len(array)
        made = {"bufferView": len(views) - 1, "componentType": component, "count": count, "type": kind}
        if kind == "VEC3":
            made |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        accessors.append(made)
        return len(accessors) - 1

    own = ORIGIN if under else np.asarray(offset)
    meshes: list[Any] = []
    nodes: list[Any] = []
    extensions = ["KHR_lights_punctual"]
    for k, (_, points, faces, place) in enumerate(SOLIDS):
        attributes = {"POSITION": add(np.float32(points), "VEC3", 5126)}
        meshes.append({"primitives": [{"attributes": attributes, "indices": add(np.uint16(_flat(faces)), "SCALAR", 5123)}]})
        nodes.append({"mesh": k, "translation": (place + own).tolist()})
    nodes.append({"camera": 0, "matrix": _camera(own).T.flatten().tolist()})
    nodes.append({"translation": (LAMP + own).tolist(), "extensions": {"KHR_lights_punctual": {"light": 0}}})
    scene = [0, 1, 2, 3]
    document: dict[str, Any] = {}
    if copies:
        places = add(np.float32([(0, 0, 0), (1.2, 0, 0), (-1, 0.3, 0.5)]), "VEC3", 5126)
        nodes[1]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": places}}}
        extensions.append("EXT_mesh_gpu_instancing")
    if skin:
        joints = {"JOINTS_0": add(np.zeros((8, 4), np.uint8), "VEC4", 5121)}
        weights = {"WEIGHTS_0": add(np.tile(np.float32([1, 0, 0, 0]), (8, 1)), "VEC4", 5126)}
        meshes[1]["primitives"][0]["attributes"] |= joints | weights
        nodes.append({"translation": nodes[1].pop("translation")})
        nodes[1]["skin"] = 0
        document["skins"] = [
            {"joints": [4], "inverseBindMatrices": add(np.eye(4, dtype=np.float32).reshape(1, 16), "MAT4", 5126)}
        ]
        scene.append(4)
    if under:
        nodes.append({"translation": [float(each) for each in offset], "children": scene})
        scene = [len(nodes) - 1]
    document |= {
        "asset": {"version": "2.0"},
        "extensionsUsed": extensions,
        "scene": 0,
        "scenes": [{"nodes": scene}],
        "nodes": nodes,
    }
    document |= {"meshes": meshes, "accessors": accessors, "bufferViews": views, "buffers": buffers}
    document["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 300}]}}
    document["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.01}}]
    return json.dumps(document)


def usd(offset: Any, under: bool = False) -> str:
    """Returns the scene as USD. under: the offset is in a parent Xform, with a PointInstancer, instead of in each prim."""
    own, whole = (ORIGIN, offset) if under else (np.asarray(offset), ORIGIN)

    def place(at: Any) -> str:
        order = 'uniform token[] xformOpOrder = ["xformOp:translate"]'
        return f"double3 xformOp:translate = ({_words(at, ', ')})\n{order}\n"

    def mesh(name: str, points: Iterable[Point], faces: Sequence[Any], at: Any) -> str:
        counts, corners = _words([3] * len(faces), ", "), _words(_flat(faces), ", ")
        rows = ", ".join(f"({_words(p, ', ')})" for p in points)
        return (
            f'def Mesh "{name}" {{\nint[] faceVertexCounts = [{counts}]\nint[] faceVertexIndices = [{corners}]\n'
            f'point3f[] points = [{rows}]\nuniform token subdivisionScheme = "none"\n{place(at)}}}\n'
        )

    body = "".join(mesh(name, points, faces, at + own) for name, points, faces, at in SOLIDS)
    rows = ", ".join(f"({_words(row, ', ')})" for row in _camera(own).T)
    body += f'def Camera "eye" {{\nfloat focalLength = 50\nmatrix4d xformOp:transform = ( {rows} )\n'
    body += 'uniform token[] xformOpOrder = ["xformOp:transform"]\n}\n'
    for kind, size, at in (("SphereLight", "radius", LAMP), ("DiskLight", "radius", LAMP - 2)):
        body += f'def {kind} "{kind}" {{\nfloat inputs:{size} = 0.2\nfloat inputs:intensity = 60\n{place(at + own)}}}\n'
    body += f'def Sphere "ball" {{\ndouble radius = 0.3\n{place(BALL + own)}}}\n'
    if under:
        body += 'def PointInstancer "copies" {\nrel prototypes = </World/copies/one>\nint[] protoIndices = [0, 0]\n'
        body += f"point3f[] positions = [(1.5, 0.5, -1), (-1.5, 0.5, -1)]\n{mesh('one', CUBE, CUBE_FACES, ORIGIN)}}}\n"
    return f'#usda 1.0\n(\nupAxis = "Y"\nmetersPerUnit = 1\n)\ndef Xform "World" {{\n{place(whole)}{body}}}\n'


def mitsuba(offset: Any) -> str:
    def at(point: Any) -> str:
        return _words((np.asarray(point) + offset).tolist(), ",")

    def put(point: Any, scale: float = 1.0) -> str:
        return f'<transform name="to_world"><scale value="{scale}"/><translate value="{at(point)}"/></transform>'

    turned = (
        f'<transform name="to_world"><scale value="2"/><rotate x="1" angle="-90"/><translate value="{at(ORIGIN)}"/></transform>'
    )
    view = f'<lookat origin="{at(EYE)}" target="{at(TARGET)}" up="0,1,0"/>'
    spot = f'<lookat origin="{at((-2, 3, 0))}" target="{at(ORIGIN)}" up="0,1,0"/>'
    return (
        '<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="40"/>'
        f'<transform name="to_world">{view}</transform></sensor><shape type="rectangle">{turned}</shape>'
        f'<shape type="cube">{put(PLACE, 0.5)}</shape>'
        f'<shape type="sphere"><point name="center" value="{at(BALL)}"/><float name="radius" value="0.3"/></shape>'
        f'<shape type="sphere"><float name="radius" value="0.3"/>{put(-BALL)}</shape>'
        f'<shape type="cylinder"><point name="p0" value="{at((-1.5, 0, -1))}"/><point name="p1" value="{at((-1.5, 1, -1))}"/>'
        '<float name="radius" value="0.2"/></shape>'
        f'<shape type="shapegroup" id="group"><shape type="cube">{put(-np.asarray(offset), 0.2)}</shape></shape>'
        f'<shape type="instance"><ref id="group"/>{put((1.5, 0.2, -1))}</shape>'
        f'<emitter type="point"><point name="position" value="{at(LAMP)}"/><rgb name="intensity" value="40"/></emitter>'
        f'<emitter type="spot"><transform name="to_world">{spot}</transform><rgb name="intensity" value="40"/></emitter></scene>'
    )


def pbrt(offset: Any) -> str:
    def at(point: Any) -> str:
        return _words((np.asarray(point) + offset).tolist())

    def mesh(points: Any, faces: Any) -> str:
        return f'Shape "trianglemesh" "point3 P" [{_words(_flat(points))}] "integer indices" [{_words(_flat(faces))}]\n'

    return (
        f'LookAt {at(EYE)} {at(TARGET)} 0 1 0\nCamera "perspective" "float fov" 40\nWorldBegin\n'
        f'LightSource "point" "point3 from" [{at(LAMP)}] "rgb I" [40 40 40]\n'
        f'LightSource "spot" "point3 from" [{at((-2, 3, 0))}] "point3 to" [{at(ORIGIN)}] "rgb I" [40 40 40]\n'
        f"{mesh(_moved(FLOOR, offset), FLOOR_FACES)}"
        f"AttributeBegin\nTranslate {at(PLACE)}\n{mesh(CUBE, CUBE_FACES)}AttributeEnd\n"
        f'AttributeBegin\nTranslate {at(BALL)}\nShape "sphere" "float radius" 0.3\nAttributeEnd\n'
        f'ObjectBegin "one"\n{mesh(CUBE, CUBE_FACES)}ObjectEnd\n'
        f'AttributeBegin\nTranslate {at((1.5, 0.5, -1))}\nObjectInstance "one"\nAttributeEnd\n'
    )


def _split(offset: Any, how: str) -> tuple[Any, Any, Any]:
    """Returns the three offsets of (vertices, nodes, the nodes' parent): `offset` for the one named by `how`, 0 for the others.

    how: `vertices`, `nodes` or `above`.
    """
    parts = [np.asarray(offset) if how == each else ORIGIN for each in ("vertices", "nodes", "above")]
    return parts[0], parts[1], parts[2]


def collada(offset: Any, how: str = "nodes") -> str:
    inner, own, above = _split(offset, how)

    def geometry(name: str, points: Any, faces: Any) -> str:
        numbers = _words(_flat(_moved(points, inner)))
        params = "".join(f'<param name="{axis}" type="float"/>' for axis in "XYZ")
        return (
            f'<geometry id="{name}"><mesh><source id="{name}-p"><float_array id="{name}-a" count="{3 * len(points)}">{numbers}'
            f'</float_array><technique_common><accessor source="#{name}-a" count="{len(points)}" stride="3">{params}</accessor>'
            f'</technique_common></source><vertices id="{name}-v"><input semantic="POSITION" source="#{name}-p"/></vertices>'
            f'<triangles count="{len(faces)}"><input semantic="VERTEX" source="#{name}-v" offset="0"/>'
            f"<p>{_words(_flat(faces))}</p></triangles></mesh></geometry>"
        )

    def node(name: str, place: str, what: str) -> str:
        return f'<node id="{name}-n">{place}{what}</node>'

    def translate(at: Any) -> str:
        return f"<translate>{_words(at)}</translate>"

    nodes = "".join(node(name, translate(at + own), f'<instance_geometry url="#{name}"/>') for name, *_, at in SOLIDS)
    seen = inner + own  # cameras and lamps have no vertices
    nodes += node("eye", f"<matrix>{_words(_camera(seen).flatten())}</matrix>", '<instance_camera url="#camera"/>')
    nodes += node("bulb", translate(LAMP + seen), '<instance_light url="#lamp"/>')
    return (
        '<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
        '<asset><unit name="meter" meter="1"/><up_axis>Y_UP</up_axis></asset><library_cameras><camera id="camera"><optics>'
        "<technique_common><perspective><yfov>40</yfov><znear>0.1</znear><zfar>10000.5</zfar></perspective></technique_common>"
        '</optics></camera></library_cameras><library_lights><light id="lamp"><technique_common><point><color>9 9 9</color>'
        "<constant_attenuation>0</constant_attenuation><quadratic_attenuation>0.5</quadratic_attenuation></point>"
        "</technique_common></light></library_lights><library_geometries>"
        + "".join(geometry(name, points, faces) for name, points, faces, _ in SOLIDS)
        + f'</library_geometries><library_visual_scenes><visual_scene id="v">{node("above", translate(above), nodes)}'
        '</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#v"/></scene></COLLADA>'
    )


def fbx(offset: Any, how: str = "nodes") -> str:
    inner, own, above = _split(offset, how)

    def at(point: Any) -> tuple[float, ...]:
        return tuple((np.asarray(point) + own).tolist())

    objects = fbx_text.node(90, "above", "Null", Lcl_Translation=tuple(above.tolist()))
    links: list[tuple[Any, ...]] = [(90, 0)]
    for k, (name, points, faces, place) in enumerate(SOLIDS):
        corners = _words([(a, b, -c - 1)[n] for a, b, c in faces for n in range(3)], ",")
        objects += f'\tGeometry: {110 + k}, "Geometry::{name}", "Mesh" {{\n\t\tVertices: *{3 * len(points)} {{ a: '
        objects += (
            f"{_words(_flat(_moved(points, inner)), ',')} }}\n\t\tPolygonVertexIndex: *{3 * len(faces)} {{ a: {corners} }}\n"
        )
        objects += "\t\tGeometryVersion: 124\n\t}\n" + fbx_text.node(120 + k, name, Lcl_Translation=at(place))
        links += [(110 + k, 120 + k), (120 + k, 90)]
    seen = inner
    objects += fbx_text.node(51, "eye", "Camera", Lcl_Translation=at(EYE + seen)) + fbx_text.camera(61, FieldOfView=60.0)
    objects += fbx_text.node(71, "aim", "Null", Lcl_Translation=at(TARGET + seen))
    objects += fbx_text.node(52, "bulb", "Light", Lcl_Translation=at(LAMP + seen))
    objects += fbx_text.light(62, LightType=0, Intensity=5000.0, DecayType=2)
    links += [(61, 51), (51, 90), (71, 90), (71, 51, "LookAtProperty"), (62, 52), (52, 90)]
    text = fbx_text.fbx(objects, links, unit=100.0)
    return text.replace('\tC: "OO",10,20\n', "")  # without the triangle that fbx_text adds


def x3d(offset: Any, how: str = "nodes") -> str:
    inner, own, above = _split(offset, how)
    body = ""
    for _, points, faces, place in SOLIDS:
        rows, corners = _words(_flat(_moved(points, inner))), " ".join(f"{_words(face)} -1" for face in faces)
        shape = (
            f'<Shape><IndexedFaceSet solid="false" coordIndex="{corners}"><Coordinate point="{rows}"/></IndexedFaceSet></Shape>'
        )
        body += f'<Transform translation="{_words(place + own)}">{shape}</Transform>'
    whole = f'<Transform translation="{_words(above)}">{body}</Transform>'
    return f'<?xml version="1.0"?><X3D version="3.3"><Scene>{whole}</Scene></X3D>'


def nff(offset: Any) -> str:
    def at(point: Any) -> str:
        return _words((np.asarray(point) + offset).tolist())

    text = f"v\nfrom {at(EYE)}\nat {at(TARGET)}\nup 0 1 0\nangle 40\nhither 0.1\nresolution 48 36\nl {at(LAMP)}\n"
    text += "f 0.8 0.8 0.8 1 0 0 0 1\n"
    for _, points, faces, place in SOLIDS:
        for face in faces:
            text += "p 3\n" + "".join(f"{at(np.asarray(points[k]) + place)}\n" for k in face)
    return text


def yaml(offset: Any) -> str:
    def at(point: Any) -> str:
        return f"[{_words((np.asarray(point) + offset).tolist(), ', ')}]"

    faces = ""
    for _, points, corners, place in SOLIDS:
        rows = ", ".join(at(np.asarray(p) + place) for p in points)
        faces += f"- {{type: faces, positions: [{rows}], faces: {[list(f) for f in corners]}}}\n"
    ball = f"- {{type: sphere, center: {at(BALL)}, radius: 0.3}}\n"
    return f"cameras: [{{eye: {at(EYE)}, target: {at(TARGET)}, fov: 40}}]\nshapes:\n{faces}{ball}"


def threemf(offset: Any) -> bytes:
    resources, items = "", ""
    for k, (_, points, faces, place) in enumerate(SOLIDS):
        vertices = "".join('<vertex x="{}" y="{}" z="{}"/>'.format(*p) for p in points)
        triangles = "".join('<triangle v1="{}" v2="{}" v3="{}"/>'.format(*f) for f in faces)
        resources += f'<object id="{k + 1}" type="model"><mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles>'
        resources += "</mesh></object>"
        items += f'<item objectid="{k + 1}" transform="1 0 0 0 1 0 0 0 1 {_words((place + offset).tolist())}"/>'
    space = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
    parts = f"<resources>{resources}</resources><build>{items}</build>"
    model = f'<?xml version="1.0"?><model unit="meter" xmlns="{space}">{parts}</model>'
    related = "http://schemas.openxmlformats.org/package/2006/relationships"
    kind = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
    links = f'<Relationships xmlns="{related}"><Relationship Target="/3D/3dmodel.model" Id="r" Type="{kind}"/></Relationships>'
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("3D/3dmodel.model", model)
        archive.writestr("_rels/.rels", links)
    return packed.getvalue()


FILES: dict[str, tuple[str, Callable[[Any], str | bytes]]] = {
    "glTF": ("a.gltf", gltf),
    "glTF, a node above": ("a.gltf", lambda offset: gltf(offset, under=True)),
    "glTF, copies": ("a.gltf", lambda offset: gltf(offset, copies=True)),
    "glTF, skin": ("a.gltf", lambda offset: gltf(offset, skin=True)),
    "glTF, skin below a node": ("a.gltf", lambda offset: gltf(offset, under=True, skin=True)),
    "USD": ("a.usda", usd),
    "USD, a node above": ("a.usda", lambda offset: usd(offset, under=True)),
    "Mitsuba": ("a.xml", mitsuba),
    "pbrt": ("a.pbrt", pbrt),
    **{f"Collada, {how}": ("a.dae", lambda offset, how=how: collada(offset, how)) for how in ("nodes", "vertices", "above")},
    **{f"FBX, {how}": ("a.fbx", lambda offset, how=how: fbx(offset, how)) for how in ("nodes", "vertices", "above")},
    **{f"X3D, {how}": ("a.x3d", lambda offset, how=how: x3d(offset, how)) for how in ("nodes", "vertices", "above")},
    "NFF": ("a.nff", nff),
    "YAML": ("a.yaml", yaml),
    "3MF": ("a.3mf", threemf),
}
