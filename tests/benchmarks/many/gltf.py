"""glTF files with many elements of one kind."""

from __future__ import annotations

import numpy as np

from tests.renderer.scene.builders import TRIANGLE, Gltf

__all__ = ["GLTF"]


def _base() -> Gltf:
    g = Gltf()
    g.root["meshes"].append({"primitives": [{"attributes": {"POSITION": g.array(TRIANGLE)}}]})
    return g


def _places(n: int) -> list[list[float]]:
    return [[float(i % 100), float(i // 100), 0.0] for i in range(n)]


def nodes(n: int) -> bytes:
    g = _base()
    for place in _places(n):
        g.node(mesh=0, translation=place, name="same")
    return g.glb()


def chain(n: int) -> bytes:
    g = _base()
    g.root["nodes"] = [{"children": [i + 1], "translation": [0.001, 0, 0]} for i in range(n)] + [{"mesh": 0}]
    g.root["scenes"][0]["nodes"] = [0]
    return g.glb()


def meshes(n: int) -> bytes:
    g = _base()
    at = g.root["meshes"][0]["primitives"][0]["attributes"]["POSITION"]
    g.root["meshes"] = [{"primitives": [{"attributes": {"POSITION": at}}]} for _ in range(n)]
    for i, place in enumerate(_places(n)):
        g.node(mesh=i, translation=place)
    return g.glb()


def primitives(n: int) -> bytes:
    g = _base()
    at = g.root["meshes"][0]["primitives"][0]["attributes"]["POSITION"]
    g.root["materials"] = [{"pbrMetallicRoughness": {"baseColorFactor": [(i % 255) / 255, 0.5, 0.5, 1]}} for i in range(n)]
    g.root["meshes"] = [{"primitives": [{"attributes": {"POSITION": at}, "material": i} for i in range(n)]}]
    g.node(mesh=0)
    return g.glb()


def missing_textures(n: int) -> bytes:
    g = _base()
    g.root["images"] = [{"uri": f"far/away/{i}.png"} for i in range(n)]
    g.root["textures"] = [{"source": i} for i in range(n)]
    g.root["materials"] = [{"name": f"m{i}", "pbrMetallicRoughness": {"baseColorTexture": {"index": i}}} for i in range(n)]
    g.node(mesh=0)
    return g.glb()


def emissive_textures(n: int) -> bytes:
    """Returns a glTF file of n materials with the same emissive texture."""
    g = _base()
    at = g.root["meshes"][0]["primitives"][0]["attributes"]["POSITION"]
    pixels = np.random.default_rng(1).integers(0, 255, (256, 256, 3), np.uint8)
    from renderer.image.encode import encode

    g.root["images"] = [{"bufferView": g.view(bytes(encode(pixels, "png"))), "mimeType": "image/png"}]
    g.root["textures"] = [{"source": 0}]
    g.root["materials"] = [{"emissiveFactor": [1, 1, (i % 255) / 255], "emissiveTexture": {"index": 0}} for i in range(n)]
    g.root["meshes"] = [{"primitives": [{"attributes": {"POSITION": at}, "material": i} for i in range(n)]}]
    g.node(mesh=0)
    return g.glb()


def cameras(n: int) -> bytes:
    g = _base()
    g.node(mesh=0)
    g.root["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1, "znear": 1}}]
    for place in _places(n):
        g.node(camera=0, translation=place, name="same")
    return g.glb()


def lights(n: int) -> bytes:
    g = _base()
    g.node(mesh=0)
    g.root["extensionsUsed"] = ["KHR_lights_punctual"]
    g.root["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    for place in _places(n):
        g.node(translation=place, extensions={"KHR_lights_punctual": {"light": 0}})
    return g.glb()


def _animated(g: Gltf, channels: list[dict[str, object]], times: np.ndarray, values: np.ndarray) -> bytes:
    sampler = {"input": g.array(times.astype(np.float32)), "output": g.array(values.astype(np.float32))}
    g.root["animations"] = [{"samplers": [sampler], "channels": [{"sampler": 0, "target": each} for each in channels]}]
    return g.glb()


def channels(n: int) -> bytes:
    g = _base()
    for place in _places(n):
        g.node(mesh=0, translation=place)
    return _animated(g, [{"node": i, "path": "translation"} for i in range(n)], np.arange(2), np.eye(3)[:2])


def weight_channels(n: int) -> bytes:
    g = _base()
    primitive = g.root["meshes"][0]["primitives"][0]
    primitive["targets"] = [{"POSITION": primitive["attributes"]["POSITION"]}]
    g.root["meshes"] = [g.root["meshes"][0]] * n
    for i in range(n):
        g.node(mesh=i)
    return _animated(g, [{"node": i, "path": "weights"} for i in range(n)], np.arange(2), np.arange(2.0))


def keyframes(n: int) -> bytes:
    g = _base()
    g.node(mesh=0)
    return _animated(g, [{"node": 0, "path": "translation"}], np.arange(n) / 100, np.random.default_rng(1).random((n, 3)))


def clips(n: int) -> bytes:
    g = _base()
    g.node(mesh=0)
    _animated(g, [{"node": 0, "path": "translation"}], np.arange(2), np.eye(3)[:2])
    g.root["animations"] *= n
    return g.glb()


def joints(n: int) -> bytes:
    g = _base()
    attributes = g.root["meshes"][0]["primitives"][0]["attributes"]
    attributes["JOINTS_0"] = g.array(np.zeros((3, 4), np.uint16))
    attributes["WEIGHTS_0"] = g.array(np.tile(np.array([1, 0, 0, 0], np.float32), (3, 1)))
    g.node(mesh=0, skin=0)
    for place in _places(n):
        g.node(translation=place)
    g.root["skins"] = [{"joints": list(range(1, n + 1))}]
    return g.glb()


def skinned_nodes(n: int) -> bytes:
    """Returns a glTF file of n nodes with one skin of n joints."""
    g = _base()
    attributes = g.root["meshes"][0]["primitives"][0]["attributes"]
    attributes["JOINTS_0"] = g.array(np.zeros((3, 4), np.uint16))
    attributes["WEIGHTS_0"] = g.array(np.tile(np.array([1, 0, 0, 0], np.float32), (3, 1)))
    for _ in range(n):
        g.node(mesh=0, skin=0)
    for place in _places(n):
        g.node(translation=place)
    g.root["skins"] = [{"joints": list(range(n, 2 * n))}]
    return g.glb()


def targets(n: int) -> bytes:
    g = _base()
    primitive = g.root["meshes"][0]["primitives"][0]
    primitive["targets"] = [{"POSITION": primitive["attributes"]["POSITION"]}] * n
    g.root["meshes"][0]["weights"] = [0.001] * n
    g.node(mesh=0)
    return g.glb()


def instances(n: int) -> bytes:
    g = _base()
    g.root["extensionsUsed"] = ["EXT_mesh_gpu_instancing"]
    places = g.array(np.array(_places(n), np.float32))
    g.node(mesh=0, extensions={"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": places}}})
    return g.glb()


def variants(n: int) -> bytes:
    g = _base()
    name = "KHR_materials_variants"
    g.root["extensionsUsed"] = [name]
    g.root["extensions"] = {name: {"variants": [{"name": f"v{i}"} for i in range(n)]}}
    g.root["materials"] = [{"name": f"m{i}"} for i in range(n)]
    mappings = [{"material": i, "variants": [i]} for i in range(n)]
    g.root["meshes"][0]["primitives"][0]["extensions"] = {name: {"mappings": mappings}}
    g.node(mesh=0)
    return g.glb()


_ALL = (
    *(
        nodes,
        chain,
        meshes,
        primitives,
        missing_textures,
        emissive_textures,
        cameras,
        lights,
        channels,
        weight_channels,
        keyframes,
    ),
    *(clips, joints, skinned_nodes, targets, instances, variants),
)
GLTF = {f"glTF {each.__name__.replace('_', ' ')}": (lambda n, make=each: {"a.glb": make(n)}) for each in _ALL}
