"""Files of text formats with many elements of one kind."""

from __future__ import annotations

import io
import zipfile

from tests.renderer.scene import fbx_text
from tests.renderer.scene.pbrt_files import BALL, SQUARE, world
from tests.renderer.scene.test_assimp import collada
from tests.renderer.scene.test_threemf import model, package, solid

__all__ = ["TEXT"]

Files = dict[str, bytes]
_TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


def obj_materials(n: int) -> Files:
    faces = "".join(f"v {i} 0 0\nv {i} 1 0\nv {i} 0 1\nusemtl m{i}\nf -3 -2 -1\n" for i in range(n))
    mtl = "".join(f"newmtl m{i}\nKd {i % 255 / 255} 0.5 0.5\nNs 10\nillum 2\n" for i in range(n))
    return {"a.obj": f"mtllib a.mtl\n{faces}".encode(), "a.mtl": mtl.encode()}


def obj_unknown_materials(n: int) -> Files:
    faces = "".join(f"usemtl m{i}\nf 1 2 3\n" for i in range(n))
    return {"a.obj": f"mtllib a.mtl\n{_TRIANGLE}{faces}".encode(), "a.mtl": b"newmtl x\nKd 1 0 0\n"}


def obj_missing_textures(n: int) -> Files:
    faces = "".join(f"usemtl m{i}\nf 1 2 3\n" for i in range(n))
    mtl = "".join(f"newmtl m{i}\nmap_Kd C:\\work\\textures\\{i}.png\n" for i in range(n))
    return {"a.obj": f"mtllib a.mtl\n{_TRIANGLE}{faces}".encode(), "a.mtl": mtl.encode()}


def obj_switches(n: int) -> Files:
    """Returns an OBJ file of n faces that alternate between two materials, with a statement for each switch."""
    return {"a.obj": (_TRIANGLE + "".join(f"g g{i}\nusemtl m{i % 2}\nf 1 2 3\n" for i in range(n))).encode()}


def obj_corners(n: int) -> Files:
    points = "".join(f"v {i} {i * i % 977} 0\n" for i in range(n))
    return {"a.obj": f"{points}f {' '.join(map(str, range(1, n + 1)))}\n".encode()}


def obj_one_point(n: int) -> Files:
    """Returns an OBJ file of n faces that share one vertex."""
    return {"a.obj": ("v 0 0 0\n" + "".join(f"v 1 {i} {i * i % 97}\n" for i in range(n + 1))
            + "".join(f"f 1 {i} {i + 1}\n" for i in range(2, n + 2))).encode()}  # fmt: skip


def threemf_objects(n: int) -> Files:
    things = "".join(solid(i) for i in range(1, n + 1))
    return {"a.3mf": package(model(things, "".join(f'<item objectid="{i}"/>' for i in range(1, n + 1))))}


def threemf_components(n: int) -> Files:
    one = '<component objectid="1" transform="1 0 0 0 1 0 0 0 1 {} 0 0"/>'
    group = f'<object id="2"><components>{"".join(map(one.format, range(n)))}</components></object>'
    return {"a.3mf": package(model(solid() + group, '<item objectid="2"/>'))}


def threemf_materials(n: int) -> Files:
    base = "".join(f'<base name="m{i}" displaycolor="#{i % 0xFFFFFF:06X}"/>' for i in range(n))
    faces = "".join(f'<triangle v1="0" v2="1" v3="2" pid="9" p1="{i}"/>' for i in range(n))
    return {"a.3mf": package(model(f'<basematerials id="9">{base}</basematerials>{solid(1, faces)}', '<item objectid="1"/>'))}


def threemf_groups(n: int) -> Files:
    base = "".join(f'<basematerials id="g{i}"><base name="m{i}" displaycolor="#FF0000"/></basematerials>' for i in range(n))
    faces = "".join(f'<triangle v1="0" v2="1" v3="2" pid="g{i}" p1="0"/>' for i in range(n))
    return {"a.3mf": package(model(base + solid(1, faces), '<item objectid="1"/>'))}


def threemf_parts(n: int) -> Files:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as made:
        part = "".join(f'<component objectid="4" p:path="/3D/{i}.model"/>' for i in range(n))
        made.writestr("3D/main.model", model(f'<object id="2"><components>{part}</components></object>', '<item objectid="2"/>'))
        for i in range(n):
            made.writestr(f"3D/{i}.model", model(solid(4), ""))
    return {"a.3mf": out.getvalue()}


def fbx_nodes(n: int) -> Files:
    nodes = "".join(fbx_text.node(100 + i, "same") for i in range(n))
    return {"a.fbx": fbx_text.fbx(nodes, [each for i in range(n) for each in ((10, 100 + i), (100 + i, 0))]).encode()}


def fbx_chain(n: int) -> Files:
    nodes = "".join(fbx_text.node(100 + i, f"n{i}") for i in range(n))
    return {"a.fbx": fbx_text.fbx(nodes, [(100 + i, 99 + i if i else 20) for i in range(n)]).encode()}


def fbx_materials(n: int) -> Files:
    things = "".join(fbx_text.node(100 + 2 * i, f"n{i}") + fbx_text.material(101 + 2 * i, f"m{i}") for i in range(n))
    links = [each for i in range(n) for each in ((10, 100 + 2 * i), (100 + 2 * i, 0), (101 + 2 * i, 100 + 2 * i))]
    return {"a.fbx": fbx_text.fbx(things, links).encode()}


def fbx_levels(n: int) -> Files:
    """Returns an FBX file with one level-of-detail group, which has n children as its levels of detail."""
    things = fbx_text.node(99, "lod", "LodGroup") + '\tNodeAttribute: 98, "NodeAttribute::", "LodGroup" {\n\t}\n'
    things += "".join(fbx_text.node(100 + i, f"n{i}") for i in range(n))
    links = [(99, 0), (98, 99), *(each for i in range(n) for each in ((10, 100 + i), (100 + i, 99)))]
    return {"a.fbx": fbx_text.fbx(things, links).encode()}


def fbx_missing_textures(n: int) -> Files:
    things = "".join(
        fbx_text.node(100 + 3 * i, f"n{i}") + fbx_text.material(101 + 3 * i, f"m{i}") + fbx_text.texture(102 + 3 * i, f"{i}.png")
        for i in range(n)
    )
    links = [
        each
        for i in range(n)
        for each in (
            (10, 100 + 3 * i), (100 + 3 * i, 0), (101 + 3 * i, 100 + 3 * i), (102 + 3 * i, 101 + 3 * i, "DiffuseColor"),
        )
    ]  # fmt: skip
    return {"a.fbx": fbx_text.fbx(things, links).encode()}


def collada_nodes(n: int) -> Files:
    more = "".join(f'<node id="n{i}" name="same"><instance_node url="#stock"/></node>' for i in range(n))
    return {"a.dae": collada().replace("</visual_scene>", f"{more}</visual_scene>").encode()}


def collada_chain(n: int) -> Files:
    return {"a.dae": collada().replace("</visual_scene>", "<node>" * n + "</node>" * n + "</visual_scene>").encode()}


def pbrt_shapes(n: int) -> Files:
    inside = "".join(f"AttributeBegin Translate {i} 0 0 {SQUARE} AttributeEnd\n" for i in range(n))
    return {"a.pbrt": world(inside).encode()}


def pbrt_materials(n: int) -> Files:
    inside = "".join(
        f'MakeNamedMaterial "m{i}" "string type" "diffuse" "rgb reflectance" [{i % 255 / 255} 0 0]\n' for i in range(n)
    )
    return {"a.pbrt": world(inside + "".join(f'NamedMaterial "m{i}" {BALL}\n' for i in range(n))).encode()}


def pbrt_textures(n: int) -> Files:
    inside = "".join(f'Texture "t{i}" "spectrum" "imagemap" "string filename" "{i}.png"\n' for i in range(n))
    inside += "".join(f'Material "diffuse" "texture reflectance" "t{i}" {SQUARE}\n' for i in range(n))
    return {"a.pbrt": world(inside).encode()}


def pbrt_scaled_textures(n: int) -> Files:
    """Returns a pbrt file of n scale textures, each of which refers to the previous one."""
    inside = 'Texture "t0" "spectrum" "constant" "rgb value" [1 1 1]\n'
    inside += "".join(f'Texture "t{i + 1}" "spectrum" "scale" "texture tex" "t{i}" "float scale" 0.999\n' for i in range(n))
    return {"a.pbrt": world(f'{inside}Material "diffuse" "texture reflectance" "t{n}" {SQUARE}').encode()}


def pbrt_instances(n: int) -> Files:
    inside = f'ObjectBegin "o" {SQUARE} ObjectEnd\n'
    inside += "".join(f'AttributeBegin Translate {i} 0 0 ObjectInstance "o" AttributeEnd\n' for i in range(n))
    return {"a.pbrt": world(inside).encode()}


def pbrt_lights(n: int) -> Files:
    return {"a.pbrt": world(SQUARE + "".join(f'\nLightSource "point" "point3 from" [{i} 1 1]' for i in range(n))).encode()}


def _mitsuba(inside: str) -> Files:
    return {"a.xml": f'<scene version="3.0.0"><sensor type="perspective"/>{inside}</scene>'.encode()}


def mitsuba_shapes(n: int) -> Files:
    shape = '<shape type="rectangle"><transform name="to_world"><translate x="{}"/></transform></shape>'
    return _mitsuba("".join(shape.format(i) for i in range(n)))


def mitsuba_materials(n: int) -> Files:
    bsdfs = "".join(f'<bsdf type="diffuse" id="m{i}"><rgb name="reflectance" value="0.5 0.5 0.5"/></bsdf>' for i in range(n))
    return _mitsuba(bsdfs + "".join(f'<shape type="sphere"><ref id="m{i}"/></shape>' for i in range(n)))


def mitsuba_missing_textures(n: int) -> Files:
    texture = '<texture name="reflectance" type="bitmap"><string name="filename" value="{}.png"/></texture>'
    shapes = (f'<shape type="rectangle"><bsdf type="diffuse">{texture.format(i)}</bsdf></shape>' for i in range(n))
    return _mitsuba("".join(shapes))


def mitsuba_instances(n: int) -> Files:
    group = '<shape type="shapegroup" id="g"><shape type="rectangle"/></shape>'
    return _mitsuba(group + '<shape type="instance"><ref id="g"/></shape>' * n)


def yaml_shapes(n: int) -> Files:
    shapes = "".join(f"- {{type: cube, material: m{i}, transform: [{{translate: [{i}, 0, 0]}}]}}\n" for i in range(n))
    materials = "".join(f"  m{i}: {{color: [{i % 255 / 255}, 0.5, 0.5]}}\n" for i in range(n))
    return {"a.yaml": f"materials:\n{materials}shapes:\n{shapes}".encode()}


def yaml_cameras(n: int) -> Files:
    cameras = "".join(f"- {{name: c{i}, eye: [0, 0, {i + 5}], target: [0, 0, 0]}}\n" for i in range(n))
    return {"a.yaml": f"cameras:\n{cameras}shapes:\n- {{type: cube}}\n".encode()}


def yaml_instances(n: int) -> Files:
    places = ", ".join(f"[{{translate: [{i}, 0, 0]}}]" for i in range(n))
    return {"a.yaml": f"shapes:\n- {{type: cube, instances: [{places}]}}\n".encode()}


def yaml_files(n: int) -> Files:
    shapes = "".join(f"- {{type: mesh, file: m.obj, transform: [{{translate: [{i}, 0, 0]}}]}}\n" for i in range(n))
    return {"a.yaml": f"shapes:\n{shapes}".encode(), "m.obj": (_TRIANGLE + "f 1 2 3\n").encode()}


def ply_mixed_faces(n: int) -> Files:
    head = f"ply\nformat ascii 1.0\nelement vertex {n + 4}\nproperty float x\nproperty float y\nproperty float z\n"
    rows = "".join(f"{i} {i * i % 97} 0\n" for i in range(n + 4))
    faces = "".join(f"3 {i} {i + 1} {i + 2}\n" if i % 2 else f"4 {i} {i + 1} {i + 2} {i + 3}\n" for i in range(n))
    return {"a.ply": f"{head}element face {n}\nproperty list uchar int vertex_indices\nend_header\n{rows}{faces}".encode()}


def stl_facets(n: int) -> Files:
    facet = "facet normal 0 0 1\nouter loop\nvertex {0} 0 0\nvertex {0} 1 0\nvertex {0} 0 1\nendloop\nendfacet\n"
    return {"a.stl": ("solid a\n" + "".join(facet.format(i) for i in range(n)) + "endsolid a\n").encode()}


def stl_solids(n: int) -> Files:
    facet = "facet normal 0 0 1\nouter loop\nvertex {0} 0 0\nvertex {0} 1 0\nvertex {0} 0 1\nendloop\nendfacet\n"
    return {"a.stl": "".join(f"solid s{i}\n{facet.format(i)}endsolid\n" for i in range(n)).encode()}


_ALL = (
    *(obj_materials, obj_unknown_materials, obj_missing_textures, obj_switches, obj_corners, obj_one_point),
    *(threemf_objects, threemf_components, threemf_materials, threemf_groups, threemf_parts),
    *(fbx_nodes, fbx_chain, fbx_materials, fbx_levels, fbx_missing_textures, collada_nodes, collada_chain),
    *(pbrt_shapes, pbrt_materials, pbrt_textures, pbrt_scaled_textures, pbrt_instances, pbrt_lights),
    *(mitsuba_shapes, mitsuba_materials, mitsuba_missing_textures, mitsuba_instances),
    *(yaml_shapes, yaml_cameras, yaml_instances, yaml_files, ply_mixed_faces, stl_facets, stl_solids),
)
TEXT = {each.__name__.replace("_", " ", 1).replace("_", " "): each for each in _ALL}
