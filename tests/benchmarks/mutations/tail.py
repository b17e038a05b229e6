"""Valid files of formats that only assimp reads, as input for damage.

They have one or two triangles each, and follow the formats' specifications.
"""

from __future__ import annotations

import io
import struct
import zipfile

from tests.benchmarks.mutations.seed import Seed
from tests.renderer.scene.test_assimp import chunk, collada

__all__ = ["long_tail"]

_TEXTS = {
    ".ac": (
        'AC3Db\nMATERIAL "blue" rgb 0.1 0.2 0.8 amb 0.2 0.2 0.2 emis 0 0 0 spec 0.5 0.5 0.5 shi 10 trans 0.25\nOBJECT world\n'
        "kids 1\nOBJECT poly\n"
        "loc 0 1 0\nnumvert 3\n0 0 0\n1 0 0\n0 1 0\nnumsurf 1\nSURF 0x20\nmat 0\nrefs 3\n0 0 0\n1 1 0\n2 0 1\nkids 0\n"
    ),
    ".x3d": (
        '<?xml version="1.0"?><X3D version="3.0"><Scene><Transform translation="2 0 0"><Shape><Appearance><Material '
        'diffuseColor="0.2 0.7 0.1"/></Appearance><IndexedFaceSet coordIndex="0 1 2 -1">'
        '<Coordinate point="0 0 0 1 0 0 0 1 0"/></IndexedFaceSet></Shape>'
        "</Transform></Scene></X3D>"
    ),
    ".x": (
        "xof 0303txt 0032\nFrame root {\nFrameTransformMatrix {\n1.0,0.0,0.0,0.0,\n0.0,1.0,0.0,0.0,\n"
        "0.0,0.0,1.0,0.0,\n0.0,0.0,5.0,1.0;;\n}\n"
        "Mesh tri {\n3;\n0.0;0.0;0.0;,\n1.0;0.0;0.0;,\n0.0;1.0;0.0;;\n1;\n3;0,1,2;;\n"
        "MeshTextureCoords {\n3;\n0.0;0.0;,\n1.0;0.0;,\n0.0;1.0;;\n}\n}\n}\n"
    ),
    ".amf": (
        '<?xml version="1.0"?><amf unit="millimeter"><object id="0"><mesh><vertices>'
        + "".join(
            f"<vertex><coordinates><x>{x}</x><y>{y}</y><z>0</z></coordinates></vertex>" for x, y in ((0, 0), (1, 0), (0, 1))
        )
        + "</vertices><volume><triangle><v1>0</v1><v2>1</v2><v3>2</v3></triangle></volume></mesh></object></amf>"
    ),
    ".smd": (
        'version 1\nnodes\n0 "root" -1\n1 "arm" 0\nend\nskeleton\ntime 0\n0 0 0 0 0 0 0\n1 1 0 0 0 0 '
        "0\nend\ntriangles\nskin.bmp\n"
        "0 0 0 0 0 0 1 0 0 1 1 1.0\n0 1 0 0 0 0 1 1 0\n0 0 1 0 0 0 1 0 1\nend\n"
    ),
    ".dxf": (
        "0\nSECTION\n2\nENTITIES\n0\n3DFACE\n8\nlayer\n10\n0.0\n20\n0.0\n30\n0.0\n11\n1.0\n"
        "21\n0.0\n31\n0.0\n12\n0.0\n22\n1.0\n32\n0.0\n"
        "13\n0.0\n23\n1.0\n33\n0.0\n0\nENDSEC\n0\nEOF\n"
    ),
    ".nff": "f 0.2 0.5 0.1 1 0 0 0 1\np 3\n0 0 0\n1 0 0\n0 1 0\ns 0 0 2 0.5\nc\n0 0 0 0.5\n0 0 2 0.2\n",
    ".ase": (
        '*3DSMAX_ASCIIEXPORT 200\n*GEOMOBJECT {\n*NODE_NAME "tri"\n*NODE_TM {\n*NODE_NAME "tri"\n*TM_ROW0 1 0 0\n*TM_ROW1 0 1 0\n'
        "*TM_ROW2 0 0 1\n*TM_ROW3 0 0 4\n}\n*MESH {\n*TIMEVALUE 0\n*MESH_NUMVERTEX 3\n*MESH_NUMFACES 1\n*MESH_VERTEX_LIST {\n"
        "*MESH_VERTEX 0 0 0 0\n*MESH_VERTEX 1 1 0 0\n*MESH_VERTEX 2 0 1 0\n}\n*MESH_FACE_LIST {\n"
        "*MESH_FACE 0: A: 0 B: 1 C: 2 AB: 1 BC: 1 CA: 1 *MESH_SMOOTHING 1 *MESH_MTLID 0\n}\n}\n}\n"
    ),
    ".ogex": (
        'Metric (key = "up") {string {"z"}}\nGeometryNode $node1 {\nName {string {"tri"}}\nObjectRef {ref {$geometry1}}\n'
        "Transform {float[16] {{1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,3,1}}}\n}\nGeometryObject $geometry1 {\nMesh "
        '(primitive = "triangles") {\n'
        'VertexArray (attrib = "position") {float[3] {{0,0,0}, {1,0,0}, {0,1,0}}}\n'
        "IndexArray {unsigned_int32[3] {{0, 1, 2}}}\n}\n}\n"
    ),
    ".irrmesh": (
        '<?xml version="1.0"?><mesh xmlns="http://irrlicht.sourceforge.net/IRRMESH_09_2007" version="1.0"><buffer><material>'
        '<enum name="Type" value="solid"/><color name="Diffuse" value="ff3366ff"/></material>'
        '<vertices type="standard" vertexCount="3">0 0 0 0 0 1 ffffffff 0 0\n1 0 0 0 0 1 ffffffff 1 0\n0 1 0 0 0 '
        "1 ffffffff 0 1\n</vertices>"
        '<indices indexCount="3">0 1 2</indices></buffer></mesh>'
    ),
}


def _three_ds() -> bytes:
    points = chunk(0x4110, struct.pack("<H9f", 3, 0, 0, 0, 1, 0, 0, 0, 1, 0))
    faces = chunk(0x4120, struct.pack("<H4H", 1, 0, 1, 2, 0), chunk(0x4130, b"red\0", struct.pack("<HH", 1, 0)))
    coloured = chunk(0xAFFF, chunk(0xA000, b"red\0"), chunk(0xA020, chunk(0x0011, bytes((255, 0, 51)))))
    lamp = chunk(0x4000, b"lamp\0", chunk(0x4600, struct.pack("<3f", 0, 0, 7)))
    return chunk(0x4D4D, chunk(0x3D3D, coloured, lamp, chunk(0x4000, b"tri\0", chunk(0x4100, points, faces))))


def _form(kind: bytes, data: bytes, order: str = ">") -> bytes:
    return kind + struct.pack(f"{order}I", len(data)) + data + bytes(len(data) % 2 if order == ">" else 0)


def _lwo() -> bytes:
    """Returns the bytes of a LightWave 2 (LWO2) file."""
    points = struct.pack(">9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
    face = b"FACE" + struct.pack(">4H", 3, 0, 1, 2)
    surface = b"red\0\0\0" + b"COLR" + struct.pack(">H3fH", 14, 0.8, 0.1, 0.1, 0)
    layer = struct.pack(">HH3f", 0, 0, 0, 0, 0) + b"\0\0"
    parts = [
        (b"TAGS", b"red\0"),
        (b"LAYR", layer),
        (b"PNTS", points),
        (b"POLS", face),
        (b"PTAG", b"SURF" + struct.pack(">2H", 0, 0)),
    ]
    return _form(b"FORM", b"LWO2" + b"".join(_form(*part) for part in [*parts, (b"SURF", surface)]))


def _b3d() -> bytes:
    """Returns a Blitz3D file."""
    points = struct.pack("<3i", 0, 1, 2) + struct.pack("<15f", 0, 0, 0, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1)
    mesh = struct.pack("<i", -1) + _form(b"VRTS", points, "<") + _form(b"TRIS", struct.pack("<4i", -1, 0, 1, 2), "<")
    node = b"tri\0" + struct.pack("<10f", 0, 0, 0, 1, 1, 1, 1, 0, 0, 0) + _form(b"MESH", mesh, "<")
    return _form(b"BB3D", struct.pack("<i", 1) + _form(b"NODE", node, "<"), "<")


def long_tail() -> list[Seed]:
    """Returns one valid file of each format that only assimp reads."""
    made = {f"a{suffix}": text.encode() for suffix, text in _TEXTS.items()}
    made |= {"a.3ds": _three_ds(), "a.lwo": _lwo(), "a.b3d": _b3d()}
    zae = io.BytesIO()
    with zipfile.ZipFile(zae, "w") as archive:
        archive.writestr("a.dae", collada())
    made["a.zae"] = zae.getvalue()
    return [Seed(name, {name: data}) for name, data in made.items()]
