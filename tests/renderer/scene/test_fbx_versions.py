"""Tests of FBX files with inactive rotations, visibility in animation layers, or embedded images with their own names."""

import io

import numpy as np
import pytest
from PIL import Image

from renderer.errors import SceneError
from renderer.scene.animation import Moment
from tests.renderer.scene import fbx_text
from tests.renderer.scene.builders import world

ROTATION = 'P: "Lcl Rotation", "Lcl Rotation", "", "A",90,45,0'
ORDER = 'P: "RotationOrder", "enum", "", "",4'
PRE = 'P: "PreRotation", "Vector3D", "Vector", "",0,0,90'
ACTIVE = 'P: "RotationActive", "bool", "", "",%d'
LIMITS = 'P: "RotationSpaceForLimitOnly", "bool", "", "",1'


def turned(x, y):
    """Returns the corners (3, 3) in metres of the file's triangle, rotated by x degrees about X, then by y degrees about Y.

    This is the rotation order XYZ.
    """
    a, b = np.radians([x, y])
    rx = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    ry = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    return (ry @ rx @ np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)]).T).T


def file_of(model, objects="", connections=""):
    """Returns a file of one triangle on a node with these properties."""
    head = fbx_text.HEAD % {"up": 1, "front": 2, "sign": 1, "unit": 1}
    body = "\n".join(model)
    node = f'Model: 11, "Model::m", "Mesh" {{ Version: 232\nProperties70: {{\n{body}\n}} }}'
    links = f'C: "OO",10,11\nC: "OO",11,0\n{connections}'
    return f"{head}Objects: {{ {fbx_text.TRIANGLE}\n{node}\n{objects} }}\nConnections: {{\n{links} }}\n"


@pytest.mark.parametrize("off", [[ACTIVE % 0], [ACTIVE % 1, LIMITS]])
def test_rotation_order_applies_only_if_active(scene, off):
    plain = world(scene("a.fbx", file_of([ROTATION])))[0]
    np.testing.assert_allclose(plain, turned(90, 45), atol=1e-6)
    left_out = world(scene("b.fbx", file_of([ROTATION, ORDER, PRE, *off])))[0]
    np.testing.assert_allclose(left_out, plain, atol=1e-6)
    active = world(scene("c.fbx", file_of([ROTATION, ORDER, PRE, ACTIVE % 1])))[0]
    assert np.abs(active - plain).max() > 0.1


def layers(curve, of_top=""):
    """Returns objects and links of two animation layers; the base layer hides the node by a value without a curve."""
    objects = """
    AnimationStack: 20, "AnimStack::s", "" { }
    AnimationLayer: 21, "AnimLayer::base", "" { }
    AnimationLayer: 22, "AnimLayer::top", "" { Properties70: { P: "Weight", "Number", "", "A",100 %s } }
    AnimationCurveNode: 23, "AnimCurveNode::Visibility", "" { Properties70: { P: "d|Visibility", "Visibility", "", "A",0 } }
    AnimationCurveNode: 24, "AnimCurveNode::Visibility", "" { Properties70: { P: "d|Visibility", "Visibility", "", "A",0 } }
    AnimationCurveNode: 25, "AnimCurveNode::T", "" { Properties70: { P: "d|X", "Number", "", "A",0 } }
    AnimationCurve: 26, "AnimCurve::", "" { Default: 0
        KeyVer: 4009
        KeyTime: *2 { a: 0,46186158000 }
        KeyValueFloat: *2 { a: 0,100 }
        KeyAttrFlags: *1 { a: 260 }
        KeyAttrDataFloat: *4 { a: 0,0,0,0 }
        KeyAttrRefCount: *1 { a: 2 } }
    """
    objects = objects.replace("%s", of_top)
    links = 'C: "OO",21,20\nC: "OO",22,20\nC: "OO",23,21\nC: "OO",24,22\nC: "OO",25,21\n'
    links += 'C: "OP",23,11, "Visibility"\nC: "OP",24,11, "Visibility"\nC: "OP",25,11, "Lcl Translation"\nC: "OP",26,25, "d|X"\n'
    if curve is not None:
        objects += f"""
    AnimationCurve: 27, "AnimCurve::", "" {{ Default: 1
        KeyVer: 4009
        KeyTime: *1 {{ a: 0 }}
        KeyValueFloat: *1 {{ a: {curve} }}
        KeyAttrFlags: *1 {{ a: 260 }}
        KeyAttrDataFloat: *4 {{ a: 0,0,0,0 }}
        KeyAttrRefCount: *1 {{ a: 1 }} }}
    """
        links += 'C: "OP",27,24, "d|Visibility"\n'
    return objects, links


@pytest.mark.parametrize("curve", [None, 1])
def test_animation_layers_without_curves_do_not_hide(scene, curve):
    description = scene("a.fbx", file_of(['P: "Visibility", "Visibility", "", "A",1'], *layers(curve)), moment=Moment(frame=12))
    assert len(description.instances) == 1
    assert world(description)[0][0][0] > 0  # the node is visible and moves


SHOWN = ['P: "Visibility", "Visibility", "", "A",1']


def test_muted_animation_layer_is_ignored(scene):
    """A muted top layer, which would hide the node, is ignored, while the base layer moves the node."""
    found = scene("a.fbx", file_of(SHOWN, *layers(0, '\nP: "Mute", "bool", "", "",1')), moment=Moment(frame=12))
    assert world(found)[0][0][0] > 0


@pytest.mark.parametrize("state", ["", '\nP: "Solo", "bool", "", "",1'])
def test_topmost_animation_layer_determines_visibility(scene, state):
    with pytest.raises(SceneError, match="has no surface"):
        scene("a.fbx", file_of(SHOWN, *layers(0, state)), moment=Moment(frame=12))


@pytest.mark.parametrize(("suffix", "format"), [(".tga", "TGA"), (".ppm", "PPM"), (".sgi", "SGI")])
def test_embedded_image_keeps_its_name(scene, suffix, format):
    import base64

    out = io.BytesIO()
    Image.fromarray(np.full((2, 2, 3), (240, 160, 80), np.uint8)).save(out, format)
    data = base64.b64encode(out.getvalue()).decode()
    name = f'Filename: "x{suffix}"\nRelativeFilename: "x{suffix}"'
    objects = f"""
    Material: 30, "Material::m", "" {{ ShadingModel: "lambert" }}
    Texture: 31, "Texture::t", "" {{ Type: "TextureVideoClip"
        FileName: "x{suffix}"
        RelativeFilename: "x{suffix}" }}
    Video: 32, "Video::v", "Clip" {{ Type: "Clip"
        {name}
        Content: , "{data}" }}
    """
    links = 'C: "OO",30,11\nC: "OP",31,30, "DiffuseColor"\nC: "OO",32,31\n'
    description = scene("a.fbx", file_of([], objects, links))
    assert description.images[0].pixels[0, 0, :3].tolist() == [240, 160, 80]
