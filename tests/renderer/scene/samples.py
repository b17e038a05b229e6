"""Writes sample files with trimesh, whose files differ from those of the tests' own builders."""

import io
import zipfile
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import trimesh
from PIL import Image
from trimesh.visual.material import PBRMaterial, SimpleMaterial
from trimesh.visual.texture import TextureVisuals

MODES = {"bed": "OPAQUE", "pane": "BLEND", "leaf": "MASK"}


def body() -> trimesh.Trimesh:
    """Returns a bumpy ball of 1,280 triangles with normals and texture coordinates."""
    mesh = trimesh.creation.icosphere(subdivisions=3)
    bumps = 1 + 0.1 * np.sin(5 * mesh.vertices).prod(axis=1)
    mesh = trimesh.Trimesh(mesh.vertices * bumps[:, None], mesh.faces, process=False)
    mesh.vertex_normals  # noqa: B018 - worked out here, so that the exporters write them
    return mesh


def uv(mesh: trimesh.Trimesh) -> np.ndarray:
    x, y, z = (mesh.vertices / np.linalg.norm(mesh.vertices, axis=1)[:, None]).T
    return np.column_stack([np.arctan2(y, x) / (2 * np.pi) + 0.5, np.arcsin(z) / np.pi + 0.5])


def checks(size: int = 32) -> Image.Image:
    """Returns a checkerboard image of two colours."""
    odd = np.indices((size, size)).sum(axis=0) // 4 % 2
    return Image.fromarray(np.where(odd[..., None], (200, 60, 20), (240, 230, 200)).astype(np.uint8))


def toy() -> trimesh.Scene:
    """Returns the textured body with a wheel two nodes below it, and a camera that looks at it."""
    painted = body()
    painted.visual = TextureVisuals(uv(painted), material=PBRMaterial("paint", baseColorTexture=checks(), metallicFactor=0.0))
    wheel = trimesh.creation.cylinder(radius=0.5, height=0.2, sections=24)
    wheel.visual = TextureVisuals(material=PBRMaterial("rubber", baseColorFactor=[30, 30, 30, 255], roughnessFactor=0.9))
    scene = trimesh.Scene()
    scene.add_geometry(painted, node_name="body", geom_name="body")
    scene.geometry["wheel"] = wheel
    for name, x in (("front", 1.2), ("rear", -1.2)):
        place = trimesh.transformations.translation_matrix((x, -0.6, 0)) @ trimesh.transformations.rotation_matrix(x, (0, 0, 1))
        scene.graph.update(name, "body", matrix=place, geometry="wheel")
    scene.camera = trimesh.scene.Camera(resolution=(640, 480), fov=(60, 45))
    scene.camera_transform = trimesh.transformations.translation_matrix((0, 0, 6))
    return scene


def modes() -> trimesh.Scene:
    """Returns a scene with one box for each alpha mode of glTF."""
    scene = trimesh.Scene()
    for i, (name, mode) in enumerate(MODES.items()):
        box = trimesh.creation.box()
        cutoff = {"alphaCutoff": 0.25} if mode == "MASK" else {}
        box.visual = TextureVisuals(material=PBRMaterial(name, alphaMode=mode, baseColorFactor=[90, 90, 200, 128], **cutoff))
        scene.add_geometry(box, geom_name=name, transform=trimesh.transformations.translation_matrix((2 * i, 0, 0)))
    return scene


def write(folder: Path) -> None:
    """Writes all sample files to the folder; a sample of several files has a subfolder."""
    (folder / "toy.glb").write_bytes(toy().export(file_type="glb"))
    (folder / "modes.glb").write_bytes(modes().export(file_type="glb"))
    for name, data in trimesh.exchange.gltf.export_gltf(toy()).items():  # one file per buffer
        _put(folder / "parts" / name, data)
    bare = body()
    for name, options in {"body.ply": {}, "ascii.ply": {"encoding": "ascii"}, "body.stl": {}, "body.dae": {}}.items():
        (folder / name).write_bytes(_bytes(bare.export(file_type=name.rpartition(".")[2], **options)))
    (folder / "body.obj").write_text(bare.export(file_type="obj"))
    painted = body()
    painted.visual = TextureVisuals(uv(painted), material=SimpleMaterial(image=checks()))
    text, textures = trimesh.exchange.obj.export_obj(painted, return_texture=True, mtl_name="paint.mtl")
    _put(folder / "painted" / "painted.obj", text)
    for name, data in textures.items():  # under a name with a space, as artists often choose
        content = data.replace(b"material_0.png", b"body uv.png") if name.endswith(".mtl") else data
        _put(folder / "painted" / ("body uv.png" if name.endswith(".png") else name), content)
    _mac_zip(folder / "mac.zip", bare)
    _environment(folder / "sky.exr")


def _put(path: Path, data: str | bytes) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(_bytes(data))


def _bytes(data: str | bytes) -> bytes:
    return data.encode() if isinstance(data, str) else data


def _mac_zip(path: Path, mesh: trimesh.Trimesh) -> None:
    """Writes a zip of three models as macOS packs folders: with entries for folders, and an AppleDouble file beside each file."""
    picture = io.BytesIO()
    checks().save(picture, "PNG")
    small = trimesh.creation.box()
    files = {"cow_texture.png": picture.getvalue(), "cow_control_mesh.obj": small.export(file_type="obj").encode()}
    files |= {"cow_quadrangulated.obj": small.subdivide().export(file_type="obj").encode()}
    mesh.visual = TextureVisuals(uv(mesh))
    lines = mesh.export(file_type="obj", write_texture=False).splitlines(keepends=True)
    bare = "".join(line for line in lines if not line.startswith(("mtllib", "usemtl")))  # no material refers to the image
    files |= {"cow_triangulated.obj": bare.encode(), "README.txt": b"A cow.\n"}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("cow/", "__MACOSX/", "__MACOSX/cow/"):
            archive.writestr(name, b"")
        for name, data in files.items():
            archive.writestr(f"cow/{name}", data)
            archive.writestr(f"__MACOSX/cow/._{name}", b"\0\5\x16\7\0\2\0\0Mac OS X        " + bytes(180))
        archive.writestr("__MACOSX/._cow", bytes(212))


def _environment(path: Path) -> None:
    """Writes a sky image of half floats: bright in the upper half, with a lamp of radiance 500."""
    sky = np.repeat(np.linspace(1.5, 0.05, 256, dtype=np.float32)[:, None, None], 512, axis=1).repeat(3, axis=2)
    sky[40:48, 100:110] = 500
    file = oiio.ImageOutput.create(str(path))
    file.open(str(path), oiio.ImageSpec(512, 256, 3, "half"))
    file.write_image(np.ascontiguousarray(sky))
    file.close()
