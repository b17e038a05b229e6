"""Small scene files, built in memory for the tests that read them."""

import base64
import json
import struct

import numpy as np

TRIANGLE = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], np.float32)

_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
_COMPONENTS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}


class Gltf:
    """Builds a glTF file: `array` adds an accessor, `root` is the JSON, `glb()` and `gltf()` return the file's bytes."""

    def __init__(self):
        self.binary = bytearray()
        self.root = {"asset": {"version": "2.0"}, "accessors": [], "bufferViews": [], "meshes": [], "nodes": [], "scene": 0}
        self.root["scenes"] = [{"nodes": []}]

    def view(self, data, **more):
        self.binary += bytes(-len(self.binary) % 4)
        self.root["bufferViews"].append({"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data), **more})
        self.binary += data
        return len(self.root["bufferViews"]) - 1

    def array(self, values, **more):
        values = np.asarray(values)
        component = _COMPONENTS[values.dtype.str[1:]]
        width = 1 if values.ndim == 1 else values.shape[1]
        accessor = {"bufferView": self.view(values.tobytes()), "componentType": component, "count": len(values)}
        self.root["accessors"].append({**accessor, "type": _TYPES[width], **more})
        return len(self.root["accessors"]) - 1

    def mesh(self, positions=TRIANGLE, indices=None, mode=4, material=None, **attributes):
        """Adds a mesh of one primitive on a new node, and returns the node's index."""
        primitive = {"attributes": {"POSITION": self.array(positions)}, "mode": mode}
        primitive["attributes"] |= {key: self.array(values) for key, values in attributes.items()}
        if indices is not None:
            primitive["indices"] = self.array(indices)
        if material is not None:
            primitive["material"] = material
        self.root["meshes"].append({"primitives": [primitive]})
        return self.node(mesh=len(self.root["meshes"]) - 1)

    def node(self, top=True, **fields):
        self.root["nodes"].append(fields)
        if top:
            self.root["scenes"][0]["nodes"].append(len(self.root["nodes"]) - 1)
        return self.root["nodes"][-1]

    def material(self, **fields):
        self.root.setdefault("materials", []).append(fields)
        return len(self.root["materials"]) - 1

    def texture(self, image, **sampler):
        for key, value in (("images", image), ("samplers", sampler)):
            self.root.setdefault(key, []).append(value)
        last = len(self.root["images"]) - 1
        self.root.setdefault("textures", []).append({"source": last, "sampler": last})
        return len(self.root["textures"]) - 1

    def glb(self):
        text = json.dumps({**self.root, "buffers": [{"byteLength": len(self.binary)}]}).encode()
        text += b" " * (-len(text) % 4)
        binary = bytes(self.binary) + bytes(-len(self.binary) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def gltf(self, uri=None):
        data = "data:application/octet-stream;base64," + base64.b64encode(self.binary).decode()
        return json.dumps({**self.root, "buffers": [{"byteLength": len(self.binary), "uri": uri or data}]}).encode()


def world(description, instance=0):
    """Returns the triangle corners (T, 3, 3) of one instance of a scene description, in world space."""
    shown = description.instances[instance]
    mesh = description.meshes[shown.mesh]
    positions = mesh.positions @ shown.transform[:3, :3].T + shown.transform[:3, 3]
    return positions[mesh.triangles]


def cup():
    """Returns a GLB file of one triangle."""
    g = Gltf()
    g.mesh()
    return g.glb()


VARIANTS = "KHR_materials_variants"


def shoe(**more):
    """Builds a file with material variants and two primitives, of which the second is always black.

    The first primitive is red by default, green in the variants "beach" and "day", and blue in "night".
    """
    g = Gltf()
    for color in ([1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1], [0, 0, 0, 1]):
        g.material(name=str(color[:3]), pbrMetallicRoughness={"baseColorFactor": color})
    g.mesh(material=0)
    g.mesh(material=3)
    mappings = [{"material": 1, "variants": [0, 2]}, {"material": 2, "variants": [1]}]
    g.root["meshes"][0]["primitives"][0]["extensions"] = {VARIANTS: {"mappings": mappings, **more}}
    g.root["extensions"] = {VARIANTS: {"variants": [{"name": "beach"}, {"name": "night"}, {"name": "day"}]}}
    g.root["extensionsUsed"] = g.root["extensionsRequired"] = [VARIANTS]
    return g


def full_gltf(png):
    """Builds a file that uses nearly every feature; `png` makes its texture."""
    g = Gltf()
    texture = g.texture({"bufferView": g.view(png(1, 2, 3)), "mimeType": "image/png"})
    moved = {"index": texture, "texCoord": 1, "extensions": {"KHR_texture_transform": {"scale": [2, 2]}}}
    extensions = {
        "KHR_materials_transmission": {"transmissionFactor": 1, "transmissionTexture": {"index": texture}},
        "KHR_materials_volume": {"thicknessFactor": 0, "attenuationDistance": 2, "attenuationColor": [1, 0.5, 0.5]},
        "KHR_materials_iridescence": {"iridescenceFactor": 1, "iridescenceThicknessMaximum": 300},
        "KHR_materials_anisotropy": {"anisotropyStrength": 0.5, "anisotropyRotation": 1},
    }
    g.material(
        pbrMetallicRoughness={"baseColorFactor": [1, 1, 1, 0.5], "baseColorTexture": {"index": texture}},
        normalTexture=moved,
        emissiveFactor=[1, 1, 1],
        alphaMode="BLEND",
        extensions=extensions,
    )
    points = np.random.default_rng(1).random((4, 3), np.float32)
    node = g.mesh(points, np.array([0, 1, 2, 3], np.uint16), 5, 0, TEXCOORD_0=points[:, :2].copy(), NORMAL=points, COLOR_0=points)
    node["rotation"] = [0, 0, 0, 1]
    g.root["cameras"] = [
        {"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}},
        {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1}},
    ]
    g.node(camera=0, matrix=np.eye(4).reshape(-1).tolist())
    spot = {"type": "spot", "intensity": 3, "spot": {"innerConeAngle": 0.2}}
    g.root["extensions"] = {"KHR_lights_punctual": {"lights": [spot]}}
    g.node(camera=1, extensions={"KHR_lights_punctual": {"light": 0}})
    bones = {"JOINTS_0": np.zeros((4, 4), np.uint8), "WEIGHTS_0": np.ones((4, 4), np.float32)}
    g.mesh(points, None, 5, 0, **bones)["skin"] = 0
    g.root["skins"] = [
        {"joints": [1, 2], "inverseBindMatrices": g.array(np.tile(np.eye(4, dtype=np.float32).reshape(16), (2, 1)))}
    ]
    g.root["meshes"][1] |= {"weights": [0.5]}
    g.root["meshes"][1]["primitives"][0]["targets"] = [{"POSITION": g.array(points)}]
    copies = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": g.array(points)}}}
    g.node(mesh=0, extensions=copies)
    return g


POINTER = "KHR_animation_pointer"


def clip(g, name, *channels):
    """Adds an animation named `name` to the file. A channel is (node or pointer, path, times, values, interpolation)."""
    samplers, targets = [], []
    for where, path, times, values, way in channels:
        samplers.append({"input": g.array(np.float32(times)), "output": g.array(np.float32(values)), "interpolation": way})
        target = {"node": where, "path": path}
        if path == "pointer":
            target = {"path": path, "extensions": {POINTER: {"pointer": where}}}
        targets.append({"sampler": len(samplers) - 1, "target": target})
    g.root.setdefault("animations", []).append({"name": name, "samplers": samplers, "channels": targets})
    return g


def moving_gltf(png):
    """Builds a file that uses nearly every feature, much of it moving from 0 to 1 s."""
    g = full_gltf(png)
    material = "/materials/0"
    light = "/extensions/KHR_lights_punctual/lights/0"
    return clip(
        g,
        "everything",
        (f"{material}/pbrMetallicRoughness/baseColorFactor", "pointer", [0, 1], [(0, 0, 0, 0), (1, 0.5, 0.25, 1)], "LINEAR"),
        (f"{material}/pbrMetallicRoughness/roughnessFactor", "pointer", [0, 1], [0, 1], "LINEAR"),
        (f"{material}/emissiveFactor", "pointer", [0, 1], [(0, 0, 0), (1, 1, 0)], "LINEAR"),
        (f"{material}/extensions/KHR_materials_emissive_strength/emissiveStrength", "pointer", [0, 1], [0, 8], "LINEAR"),
        (f"{material}/extensions/KHR_materials_transmission/transmissionFactor", "pointer", [0, 1], [0, 1], "LINEAR"),
        (f"{material}/extensions/KHR_materials_volume/attenuationDistance", "pointer", [0, 1], [1, 3], "LINEAR"),
        (f"{material}/extensions/KHR_materials_clearcoat/clearcoatFactor", "pointer", [0, 1], [0, 1], "LINEAR"),
        (f"{material}/normalTexture/scale", "pointer", [0, 1], [1, 3], "LINEAR"),
        (f"{material}/normalTexture/extensions/KHR_texture_transform/offset", "pointer", [0, 1], [(0, 0), (1, 2)], "LINEAR"),
        (f"{material}/pbrMetallicRoughness/baseColorTexture/extensions/KHR_texture_transform/scale", "pointer", [0, 1],
         [(1, 1), (3, 5)], "LINEAR"),
        (f"{light}/intensity", "pointer", [0, 1], [0, 1366], "LINEAR"),
        (f"{light}/color", "pointer", [0, 1], [(1, 1, 1), (1, 0, 0)], "LINEAR"),
        (f"{light}/spot/outerConeAngle", "pointer", [0, 1], [0.3, 0.5], "LINEAR"),
        ("/cameras/0/perspective/yfov", "pointer", [0, 1], [0.5, 1.5], "LINEAR"),
        ("/cameras/1/orthographic/ymag", "pointer", [0, 1], [1, 3], "LINEAR"),
        ("/cameras/1/orthographic/zfar", "pointer", [0, 1], [1, 3], "LINEAR"),
        ("/nodes/3/weights/0", "pointer", [0, 1], [0, 1], "LINEAR"),
    )  # fmt: skip


def rotation_y(degrees):
    """Returns a 4 x 4 rotation matrix about +Y."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1]])
