"""Converts our scenes to the dictionaries from which Mitsuba 3 makes the same scenes.

Differences of convention are converted here; a material without an equal is refused, since comparing two models would prove
nothing. docs/correctness.md lists the differences.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from renderer.scene.description import Environment, Image, Light, Material, Medium, Mesh, SceneDescription, Texture
from renderer.settings import RenderSettings

__all__ = ["mitsuba_dict", "write_ply"]

_ROUGH_ALPHA = 1e-3  # below this, our microfacets have minimum roughness, while Mitsuba's are a mirror
_WRAP = {"repeat": "repeat", "mirror": "mirror", "clamp": "clamp"}


def mitsuba_dict(mi: Any, description: SceneDescription, settings: RenderSettings, folder: Path) -> dict[str, Any]:
    """Returns Mitsuba's dictionary of the scene with camera, film and integrator.

    mi: the mitsuba module with its variant set. folder: receives the meshes, since Mitsuba reads these from files. Raises
    ValueError for materials without an equal in Mitsuba.
    """
    scatters = description.medium is not None or any(_is_filled(material) for material in description.materials)
    made: dict[str, Any] = {
        "type": "scene",
        "integrator": {
            "type": "volpathmis" if scatters else "path",
            "max_depth": settings.max_depth,
            "rr_depth": 1000,
        },
        "sensor": _sensor(mi, settings),
    }
    if description.medium is not None:
        made["sensor"]["medium"] = _medium(description.medium)
    bsdfs = [_bsdf(mi, description, material) for material in description.materials]
    meshes = [write_ply(mesh, folder / f"mesh{i}.ply") for i, mesh in enumerate(description.meshes)]
    uses = [0] * len(meshes)
    for instance in description.instances:
        uses[instance.mesh] += 1
    for i, mesh in enumerate(description.meshes):
        if uses[i] > 1:
            made[f"group{i}"] = {"type": "shapegroup", "mesh": _shape(mi, description, bsdfs, meshes[i], mesh, mesh.material)}
    for i, instance in enumerate(description.instances):
        mesh = description.meshes[instance.mesh]
        to_world = mi.ScalarTransform4f(np.array(instance.transform, np.float64))
        if uses[instance.mesh] > 1:
            if instance.material not in (None, mesh.material):
                raise ValueError("Mitsuba's instances share their group's material")
            made[f"instance{i}"] = {
                "type": "instance",
                "to_world": to_world,
                "group": {"type": "ref", "id": f"group{instance.mesh}"},
            }
        else:
            number = mesh.material if instance.material is None else instance.material
            made[f"mesh{i}"] = _shape(mi, description, bsdfs, meshes[instance.mesh], mesh, number) | {"to_world": to_world}
    for i, sphere in enumerate(description.spheres):
        made[f"sphere{i}"] = {
            "type": "sphere",
            "center": list(sphere.center),
            "radius": sphere.radius,
            "bsdf": bsdfs[sphere.material],
        } | _emitter(mi, description, description.materials[sphere.material])
    for i, light in enumerate(description.lights):
        made[f"light{i}"] = _light(mi, light)
    if description.environment is not None:
        made["environment"] = _environment(mi, description, description.environment)
    return made


def _is_filled(material: Material) -> bool:
    return max(material.sigma_a) > 0 or max(material.sigma_s) > 0


def _medium(medium: Material | Medium) -> dict[str, Any]:
    """Returns the medium as Mitsuba's dictionary.

    Mitsuba limits colours to 1, so the extinction is divided by its largest component, which becomes the `scale`.
    """
    scattered = np.array(medium.sigma_s, float)
    total = scattered + np.array(medium.sigma_a, float)
    return {
        "type": "homogeneous",
        "albedo": _rgb(tuple(scattered / np.maximum(total, 1e-30))),
        "sigma_t": _rgb(tuple(total / total.max())),
        "scale": float(total.max()),
        "phase": {"type": "hg", "g": medium.g},
    }


def _rgb(color: tuple[float, ...]) -> dict[str, Any]:
    return {"type": "rgb", "value": [float(c) for c in color]}


def _sensor(mi: Any, settings: RenderSettings) -> dict[str, Any]:
    view = settings.view
    frame = mi.ScalarTransform4f().look_at(origin=list(view.eye), target=list(view.target), up=list(view.up))
    sensor: dict[str, Any] = {
        "near_clip": 1e-3,
        "far_clip": 1e5,
        "sampler": {"type": "independent"},
        "film": {
            "type": "hdrfilm",
            "width": settings.width,
            "height": settings.height,
            "rfilter": {"type": "box"},
            "pixel_format": "rgb",
            "component_format": "float32",
        },
    }
    if view.projection == "orthographic":
        # Mitsuba's view spans -1 ... 1 across its width.
        across = view.height / 2 * settings.width / settings.height
        return sensor | {"type": "orthographic", "to_world": frame @ mi.ScalarTransform4f().scale([across, across, 1.0])}
    if view.projection != "perspective":
        raise ValueError(f"Mitsuba has no {view.projection} camera")
    sensor |= {"to_world": frame, "fov": view.fov, "fov_axis": "y"}
    if view.aperture == 0:
        return sensor | {"type": "perspective"}
    focus = view.focus if view.focus is not None else math.dist(view.eye, view.target)
    return sensor | {"type": "thinlens", "aperture_radius": view.aperture, "focus_distance": focus}


def write_ply(mesh: Mesh, path: Path) -> Path:
    """Writes the mesh as binary PLY, and returns the path."""
    columns = {name: mesh.positions[:, i] for i, name in enumerate("xyz")}
    if mesh.normals is not None:
        columns |= {name: mesh.normals[:, i] for i, name in enumerate(("nx", "ny", "nz"))}
    if mesh.uvs is not None:
        columns |= {name: mesh.uvs[:, i] for i, name in enumerate("uv")}
    properties = "".join(f"property float {name}\n" for name in columns)
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(mesh.positions)}\n{properties}"
        f"element face {len(mesh.triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.zeros(len(mesh.triangles), [("count", "u1"), ("corner", "<i4", 3)])
    faces["count"], faces["corner"] = 3, mesh.triangles
    path.write_bytes(header.encode() + np.column_stack(list(columns.values())).astype("<f4").tobytes() + faces.tobytes())
    return path


def _shape(mi: Any, description: SceneDescription, bsdfs: list[Any], path: Path, mesh: Mesh, number: int) -> dict[str, Any]:
    shape = {"type": "ply", "filename": str(path), "face_normals": mesh.normals is None, "bsdf": bsdfs[number]}
    return shape | _emitter(mi, description, description.materials[number])


def _emitter(mi: Any, description: SceneDescription, material: Material) -> dict[str, Any]:
    """Returns the part of a shape's Mitsuba dictionary that follows from the material but is no BSDF.

    This is the emitter, or the medium inside the shape; it is empty for other materials. Raises ValueError for two-sided
    emitters.
    """
    if _is_filled(material):
        return {"interior": _medium(material)}
    if max(material.emission) <= 0:
        return {}
    if material.double_sided:
        raise ValueError("Mitsuba's area lights shine to one side")
    if material.emission_texture is None:
        return {"emitter": {"type": "area", "radiance": _rgb(material.emission)}}
    radiance = _texture(mi, description, material.emission_texture, material.emission)
    return {"emitter": {"type": "area", "radiance": radiance}}


def _linear(image: Image) -> np.ndarray:
    """Returns the image's colours (h, w, 3) as linear values, without their transfer function."""
    if image.pixels.dtype != np.uint8:
        return np.asarray(image.pixels[..., :3], np.float32)
    level = image.pixels[..., :3] / 255.0
    if image.srgb:
        level = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)
    return level.astype(np.float32)


def _texture(
    mi: Any, description: SceneDescription, number: int, factor: tuple[float, ...] = (1.0, 1.0, 1.0), channel: int | None = None
) -> dict[str, Any]:
    texture: Texture = description.textures[number]
    if texture.wrap_s != texture.wrap_t:
        raise ValueError("Mitsuba repeats a bitmap the same way in both directions")
    image = description.images[texture.image]
    if channel == 3:
        pixels = (image.pixels[..., 3:4] / 255.0).astype(np.float32)
    else:
        pixels = _linear(image) * np.array(factor, np.float32)
    a, b, c, d, e, f = texture.transform
    return {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.ascontiguousarray(pixels, np.float32)),
        "raw": True,
        "filter_type": "nearest" if texture.filter == "nearest" else "bilinear",
        "wrap_mode": _WRAP[texture.wrap_s],
        "to_uv": mi.ScalarTransform3f(np.array([[a, b, c], [d, e, f], [0, 0, 1]], np.float64)),
    }


def _base(mi: Any, description: SceneDescription, material: Material) -> dict[str, Any]:
    if material.base_color_texture is None:
        return _rgb(material.base_color)
    return _texture(mi, description, material.base_color_texture, material.base_color)


def _bsdf(mi: Any, description: SceneDescription, material: Material) -> dict[str, Any]:
    if material.kind == "interface":
        return {"type": "null"}
    bsdf = _scattering(mi, description, material)
    if material.normal_texture is not None:
        if material.normal_scale != 1.0:
            raise ValueError("Mitsuba's normal maps have no scale")
        bsdf = {
            "type": "normalmap",
            "normalmap": _texture(mi, description, material.normal_texture),
            "bsdf": bsdf,
            "use_shadowing_function": False,
        }
    if material.kind != "glass":
        bsdf = {"type": "twosided", "bsdf": bsdf}
    if material.alpha_mode == "opaque":
        return bsdf
    if material.alpha_mode == "mask":
        raise ValueError("Mitsuba has no cut-off of its alpha; give it blend with an image of zeros and ones")
    opacity: Any = material.opacity
    if material.base_color_texture is not None:
        opacity = _texture(mi, description, material.base_color_texture, channel=3)
    return {"type": "mask", "opacity": opacity, "bsdf": bsdf}


def _scattering(mi: Any, description: SceneDescription, material: Material) -> dict[str, Any]:
    base = _base(mi, description, material)
    smooth = material.kind in ("glass", "conductor")
    roughness = material.roughness if material.roughness is not None else 0.0 if smooth else 1.0
    alpha = roughness**2
    facets = {"distribution": material.distribution, "alpha": alpha}
    if material.kind == "diffuse":
        return {"type": "diffuse", "reflectance": base}
    if material.kind == "mirror":
        return {"type": "conductor", "material": "none", "specular_reflectance": base}
    if material.kind == "glass":
        glass = {"int_ior": material.ior, "ext_ior": 1.0, "specular_transmittance": base}
        if alpha < _ROUGH_ALPHA:
            return glass | {"type": "dielectric"}
        return glass | facets | {"type": "roughdielectric"}
    if material.kind == "conductor":
        metal = {"eta": _rgb(material.eta), "k": _rgb(material.k)}
        if alpha < _ROUGH_ALPHA:
            return metal | {"type": "conductor"}
        return metal | facets | {"type": "roughconductor"}
    if material.kind == "metallic_roughness" and material.metallic == 1 and material.base_color == (1.0, 1.0, 1.0):
        # A white metal has no Fresnel effect in either model.
        return facets | {"type": "roughconductor", "material": "none", "alpha": max(alpha, _ROUGH_ALPHA)}
    if material.kind == "plastic":
        coat = {"int_ior": material.ior, "ext_ior": 1.0, "specular_reflectance": _rgb(material.specular_color)}
        return facets | coat | {"type": "roughplastic", "diffuse_reflectance": base, "nonlinear": material.nonlinear}
    raise ValueError(f"Mitsuba has no twin of {material.kind} with metallic {material.metallic:g}")


def _light(mi: Any, light: Light) -> dict[str, Any]:
    if light.radius > 0 or light.angle > 0:
        raise ValueError("Mitsuba's lights without a body cast sharp shadows")
    if light.kind == "point":
        return {"type": "point", "position": list(light.position), "intensity": _rgb(light.intensity)}
    if light.kind == "directional":
        return {"type": "directional", "direction": list(light.direction), "irradiance": _rgb(light.intensity)}
    direction = np.array(light.direction, float)
    up = (0, 1, 0) if abs(direction[1]) < 0.9 * np.linalg.norm(direction) else (1, 0, 0)
    position = np.array(light.position, float)
    frame = mi.ScalarTransform4f().look_at(origin=position.tolist(), target=(position + direction).tolist(), up=list(up))
    if light.falloff != "linear" and light.outer_cone - light.inner_cone > 0.1:
        raise ValueError("Mitsuba's spot lights fall off linearly between the cones; let them be one, or the falloff linear")
    return {
        "type": "spot",
        "to_world": frame,
        "intensity": _rgb(light.intensity),
        "cutoff_angle": light.outer_cone,
        "beam_width": light.inner_cone,
    }


def _environment(mi: Any, description: SceneDescription, environment: Environment) -> dict[str, Any]:
    color = np.array(environment.color, float) * environment.strength
    if environment.image is None:
        return {"type": "constant", "radiance": _rgb(tuple(color))}
    pixels = _linear(description.images[environment.image]) * color.astype(np.float32)
    # Our first and last rows are centred half a row from the poles, Mitsuba's on the poles. With 2h + 1 rows, Mitsuba's include
    # ours.
    height = len(pixels)
    place = np.clip(np.arange(2 * height + 1) / 2 - 0.5, 0, height - 1)
    low = np.minimum(place.astype(int), max(height - 2, 0))
    t = (place - low)[:, None, None].astype(np.float32)
    rows = pixels[low] * (1 - t) + pixels[np.minimum(low + 1, height - 1)] * t
    turn = mi.ScalarTransform4f().rotate([0, 1, 0], environment.rotation + 180.0)
    return {"type": "envmap", "bitmap": mi.Bitmap(np.ascontiguousarray(rows, np.float32)), "to_world": turn}
