"""Builds FBX files in text form, as 3ds Max and Maya write them: a triangle, and whatever objects a test adds."""

HEAD = """; FBX 7.5.0 project file
FBXHeaderExtension:  {
	FBXHeaderVersion: 1003
	FBXVersion: 7500
	Creator: "FBX SDK/FBX Plugins version 2020.3"
}
GlobalSettings:  {
	Version: 1000
	Properties70:  {
		P: "UpAxis", "int", "Integer", "",%(up)d
		P: "UpAxisSign", "int", "Integer", "",1
		P: "FrontAxis", "int", "Integer", "",%(front)d
		P: "FrontAxisSign", "int", "Integer", "",%(sign)d
		P: "CoordAxis", "int", "Integer", "",0
		P: "CoordAxisSign", "int", "Integer", "",1
		P: "UnitScaleFactor", "double", "Number", "",%(unit)g
		P: "TimeMode", "enum", "", "",11
	}
}
"""

TRIANGLE = """
	Geometry: 10, "Geometry::tri", "Mesh" {
		Vertices: *9 { a: 0,0,0,100,0,0,0,100,0 }
		PolygonVertexIndex: *3 { a: 0,1,-3 }
		GeometryVersion: 124
		LayerElementUV: 0 {
			Version: 101
			Name: "map1"
			MappingInformationType: "ByPolygonVertex"
			ReferenceInformationType: "Direct"
			UV: *6 { a: 0,0,1,0,0,1 }
		}
		LayerElementMaterial: 0 {
			Version: 101
			MappingInformationType: "AllSame"
			ReferenceInformationType: "IndexToDirect"
			Materials: *1 { a: 0 }
		}
		Layer: 0 {
			Version: 100
			LayerElement:  { Type: "LayerElementUV" TypedIndex: 0 }
			LayerElement:  { Type: "LayerElementMaterial" TypedIndex: 0 }
		}
	}
"""


def properties(values):
    """Returns a property block for named values: numbers, triples or strings."""
    lines = []
    for name, value in values.items():
        if isinstance(value, str):
            lines.append(f'P: "{name}", "KString", "", "", "{value}"')
        elif isinstance(value, tuple):
            lines.append(f'P: "{name}", "ColorRGB", "Color", "",{",".join(map(str, value))}')
        elif isinstance(value, bool):
            lines.append(f'P: "{name}", "bool", "", "",{int(value)}')
        elif isinstance(value, int):
            lines.append(f'P: "{name}", "int", "Integer", "",{value}')
        else:
            lines.append(f'P: "{name}", "double", "Number", "",{value}')
    return "\t\tProperties70:  {\n\t\t\t" + "\n\t\t\t".join(lines) + "\n\t\t}\n"


def node(number, name, kind="Mesh", **values):
    """Returns the text of a node with the given properties; underscores in their names stand for FBX's spaces."""
    said = {key.replace("_", " "): value for key, value in values.items()}
    return f'\tModel: {number}, "Model::{name}", "{kind}" {{\n\t\tVersion: 232\n{properties(said)}\t}}\n'


def material(number, name, model="phong", **values):
    """Returns the text of a material with the given properties, by FBX's names."""
    return (
        f'\tMaterial: {number}, "Material::{name}", "" {{\n\t\tVersion: 102\n\t\tShadingModel: "{model}"\n'
        f"{properties(values)}\t}}\n"
    )


def light(number, **values):
    return f'\tNodeAttribute: {number}, "NodeAttribute::", "Light" {{\n{properties(values)}\t}}\n'


def camera(number, **values):
    return f'\tNodeAttribute: {number}, "NodeAttribute::", "Camera" {{\n{properties(values)}\t}}\n'


def arnold(number, names):
    """Returns the FBX objects that declare a material to be one of Arnold's.

    These are an implementation with the object number `number`, and a binding table of property names with the number after it.
    """
    entries = "".join(f'\t\tEntry: "{n}", "FbxPropertyEntry", "{n[5:]}", "FbxSemanticEntry"\n' for n in names)
    said = properties({"RenderAPI": "ARNOLD_SHADER_ID", "RootBindingName": "root"})
    return (
        f'\tImplementation: {number}, "Implementation::a", "" {{\n\t\tVersion: 100\n{said}\t}}\n'
        f'\tBindingTable: {number + 1}, "BindingTable::root", "" {{\n\t\tVersion: 100\n{entries}\t}}\n'
    )


def stack(number, name, far=None):
    """Returns an animation stack and its links; with `far`, node 20 moves `far` along X within one second.

    The layer, curve node and curve have the three numbers after `number`.
    """
    head = f'\tAnimationStack: {number}, "AnimStack::{name}", "" {{\n{properties({})}\t}}\n'
    if far is None:
        return head, []
    second = 46186158000
    return head + (
        f'\tAnimationLayer: {number + 1}, "AnimLayer::Base", "" {{\n\t}}\n'
        f'\tAnimationCurveNode: {number + 2}, "AnimCurveNode::T", "" {{\n{properties({"d|X": 0.0, "d|Y": 0.0, "d|Z": 0.0})}\t}}\n'
        f'\tAnimationCurve: {number + 3}, "AnimCurve::", "" {{\n\t\tDefault: 0\n\t\tKeyVer: 4009\n'
        f"\t\tKeyTime: *2 {{ a: 0,{second} }}\n\t\tKeyValueFloat: *2 {{ a: 0,{far} }}\n\t\tKeyAttrFlags: *1 {{ a: 4 }}\n"
        "\t\tKeyAttrDataFloat: *4 { a: 0,0,0,0 }\n\t\tKeyAttrRefCount: *1 { a: 2 }\n\t}\n"
    ), [
        (number + 1, number),
        (number + 2, number + 1),
        (number + 2, 20, "Lcl Translation"),
        (number + 3, number + 2, "d|X"),
    ]


def texture(number, file, **values):
    return (
        f'\tTexture: {number}, "Texture::t", "" {{\n\t\tType: "TextureVideoClip"\n\t\tVersion: 202\n'
        f'\t\tFileName: "C:\\\\work\\\\{file}"\n\t\tRelativeFilename: "..\\\\{file}"\n{properties(values)}\t}}\n'
    )


def fbx(objects, links, *, unit=1.0, z_up=False):
    """Returns an FBX file with a triangle (geometry 10) on node 20, and further objects. links: (child, parent[, property]).

    unit: the file's unit in centimetres.
    """
    head = HEAD % {"up": 2 if z_up else 1, "front": 1 if z_up else 2, "sign": -1 if z_up else 1, "unit": unit}
    lines = []
    for child, parent, *name in [(10, 20), (20, 0), *links]:
        lines.append(f'\tC: "OP",{child},{parent}, "{name[0]}"' if name else f'\tC: "OO",{child},{parent}')
    return f"{head}Objects:  {{{TRIANGLE}{node(20, 'tri')}{objects}}}\nConnections:  {{\n" + "\n".join(lines) + "\n}\n"
