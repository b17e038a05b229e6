"""Tests of compressed glTF files: buffer views by meshopt, images as KTX2 and AVIF."""

import base64
import io
import zlib

import meshopt
import numpy as np
import pytest
from PIL import Image

from renderer.errors import SceneError
from tests.renderer.scene.builders import Gltf

POINTS = np.random.default_rng(1).random((40, 3)).astype(np.float32)
TRIANGLES = np.random.default_rng(2).integers(0, 40, size=(60, 3)).astype(np.uint16)
# 8 x 8 pixels, red above and blue below, from Basis Universal's own encoder.
KTX2 = {
    "ETC1S": "c-mX-9TK5nWU!l;ONxsD2pEBw1BzjQ5ea7iu?`SV0b&&(-T_t91f{JQ5qgk;4wPnM&|p~1$i%?RjBJNJob?|F<bgEMS>;8UC"
    "8<RWPKm{t#R{Q$nPsU(#fdo"
    "zMtX(@AafWQw1DbZfmj>OE@ZnE4!A%Vk6c&`1i`EZ6$J(#h~)}w48jm;4z)F_R;^+(fhiYqWthPr0Ae|aFsU(t#U_|B9bjnyGnIf+0IX&qpa",
    "UASTC": "c-mX-9TK5nWU!l;ONxsD2pEBw1BzjQ5sE<|1Bi8icnXw82M3_E0~!re%fz6;u#Az3fti_sK>)6+9?tp?1oA){=&bUh%#ze12"
    "B*a0%wmPmyv(xHqT<9H1tUE}"
    "0|o{bkS?IM@A3=}<f{<&qw~cX9{iVQdccT_4*(8=A;A",
}


def packed(name="EXT_meshopt_compression", filter=None):
    """Builds a mesh with compressed vertices and triangles, and a buffer laid out as by gltfpack."""
    plain = Gltf()
    plain.mesh(POINTS, TRIANGLES.reshape(-1))
    made = Gltf()
    made.root |= {key: plain.root[key] for key in ("accessors", "meshes", "nodes", "scenes")}
    made.root["extensionsRequired"] = made.root["extensionsUsed"] = [name]
    for data, count, stride, mode in (
        (meshopt.encode_gltf_buffer(POINTS, "ATTRIBUTES"), 40, 12, "ATTRIBUTES"),
        (meshopt.encode_gltf_buffer(TRIANGLES.reshape(-1), "TRIANGLES"), 180, 2, "TRIANGLES"),
    ):
        view = made.root["bufferViews"][made.view(bytes(data))]
        packing = {"buffer": 0, "byteOffset": view["byteOffset"], "byteLength": view["byteLength"], "byteStride": stride}
        packing |= {"count": count, "mode": mode} | ({"filter": filter} if filter else {})
        view |= {"byteOffset": 0, "byteLength": count * stride, "extensions": {name: packing}}
    return made


@pytest.mark.parametrize("name", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
def test_meshopt_round_trip(scene, name):
    mesh = scene("a.glb", packed(name).glb()).meshes[0]
    found = np.sort(mesh.positions[mesh.triangles].reshape(60, -1), axis=1)
    wanted = np.sort(POINTS[TRIANGLES].reshape(60, -1), axis=1)  # corners of a triangle may be rotated
    np.testing.assert_array_equal(found[np.lexsort(found.T)], wanted[np.lexsort(wanted.T)])


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("mode", "LINES", "filter is unknown"),
        ("filter", "BLUR", "filter is unknown"),
        ("count", 41, "and byteStride do not match the"),
        ("byteLength", 1 << 20, "reaches beyond the end of its buffer"),
        ("byteLength", 20, "is damaged"),
    ],
)
def test_damaged_meshopt_is_an_error(scene, key, value, says):
    made = packed()
    made.root["bufferViews"][0]["extensions"]["EXT_meshopt_compression"][key] = value
    with pytest.raises(SceneError, match=rf"a\.glb: .*{says}"):
        scene("a.glb", made.glb())


def textured(extension, image):
    made = Gltf()
    texture = made.texture({"bufferView": made.view(image)})
    made.root["textures"][texture] = {"extensions": {extension: {"source": 0}}}
    made.root["extensionsUsed"] = [extension]
    surface = made.material(pbrMetallicRoughness={"baseColorTexture": {"index": texture}})
    made.mesh(material=surface)
    return made.glb()


@pytest.mark.parametrize("codec", KTX2)
def test_ktx2_images(scene, codec):
    pytest.importorskip("opengl_basisu")
    description = scene("a.glb", textured("KHR_texture_basisu", zlib.decompress(base64.b85decode(KTX2[codec]))))
    pixels = description.images[0].pixels
    assert pixels.shape == (8, 8, 4)
    np.testing.assert_allclose(pixels[:4].reshape(-1, 4), [(255, 0, 0, 255)] * 32, atol=12)
    np.testing.assert_allclose(pixels[4:].reshape(-1, 4), [(0, 0, 255, 255)] * 32, atol=12)
    cut = scene("b.glb", textured("KHR_texture_basisu", zlib.decompress(base64.b85decode(KTX2[codec]))[:90]))
    assert any("the image is damaged" in w for w in cut.warnings)


def test_avif_images(scene):
    out = io.BytesIO()
    Image.new("RGB", (8, 8), (200, 40, 20)).save(out, "AVIF", quality=95)
    description = scene("a.glb", textured("EXT_texture_avif", out.getvalue()))
    np.testing.assert_allclose(description.images[0].pixels[0, 0], (200, 40, 20, 255), atol=6)
