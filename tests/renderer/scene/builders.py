"""Small scene files, made in memory by the tests that read them."""

import base64
import json
import struct

import numpy as np

TRIANGLE = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], np.float32)

_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
_COMPONENTS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}


class Gltf:
    """A glTF file in the making: `array` adds an accessor, `root` is the JSON, `glb()` and `gltf()` give the bytes."""

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
        """A mesh of one primitive on a node of its own; returns the node."""
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
    """An instance's corners in the world, (T, 3, 3)."""
    shown = description.instances[instance]
    mesh = description.meshes[shown.mesh]
    positions = mesh.positions @ shown.transform[:3, :3].T + shown.transform[:3, 3]
    return positions[mesh.triangles]


def cup():
    """The bytes of a GLB with one triangle."""
    g = Gltf()
    g.mesh()
    return g.glb()


def rotation_y(degrees):
    """A 4x4 rotation about +Y."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1]])
