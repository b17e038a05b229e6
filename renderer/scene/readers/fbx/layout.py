"""The structures of ufbx's C interface (ufbx.h, 0.21) for ctypes, as far as they are used here.

A field called `_` is unused. Lists and strings are a pointer and a count; the type of a list's elements is given where the list
is read.
"""

from __future__ import annotations

import ctypes
from typing import Any

__all__ = [
    "FBX_MAPS",
    "FEATURES",
    "PBR_MAPS",
    "Anim",
    "AnimCurve",
    "AnimLayer",
    "AnimOptions",
    "AnimProp",
    "AnimStack",
    "AnimValue",
    "BlendChannel",
    "BlendDeformer",
    "BlendKeyframe",
    "BlendShape",
    "Camera",
    "Connection",
    "Element",
    "Error",
    "EvaluateOptions",
    "Face",
    "Light",
    "List",
    "LoadOptions",
    "Material",
    "MaterialMap",
    "MaterialTexture",
    "Mesh",
    "Node",
    "Notice",
    "PropOverride",
    "Scene",
    "SkinCluster",
    "SkinDeformer",
    "Texture",
    "UvSet",
]


class List(ctypes.Structure):
    """The layout of ufbx's list types: a pointer and a count. Strings and blobs have the same layout."""

    _fields_ = (("data", ctypes.c_void_p), ("count", ctypes.c_size_t))


_KINDS: dict[str, Any] = {
    "list": List,
    "ptr": ctypes.c_void_p,
    "real": ctypes.c_double,
    "bool": ctypes.c_bool,
    "int": ctypes.c_int32,
    "uint": ctypes.c_uint32,
    "long": ctypes.c_int64,
    "size": ctypes.c_size_t,
    "char": ctypes.c_char,
    "byte": ctypes.c_ubyte,
}


def _fields(text: str) -> list[tuple[str, Any]]:
    """Parses "name:kind" words into ctypes fields. A kind may end in an array length; each `_` gets a unique name."""
    found: list[tuple[str, Any]] = []
    for word in text.split():
        name, _, kind = word.partition(":")
        base, _, times = kind.partition("*")
        type_ = _KINDS[base] * int(times) if times else _KINDS[base]
        found.append((f"_{len(found)}" if name == "_" else name, type_))
    return found


def _structure(name: str, text: str, base: type[ctypes.Structure] = ctypes.Structure) -> Any:
    """Defines a ctypes structure from its fields, whose kinds may be structures defined before it."""
    made = type(name, (base,), {"_fields_": _fields(text)})
    _KINDS[name] = made
    return made


def _names(text: str) -> tuple[str, ...]:
    return tuple(text.split())


Props = _structure("Props", "_:list _:size _:ptr")
Element = _structure(
    "Element",
    "name:list props:Props element_id:uint typed_id:uint instances:list type:int _:list connections_dst:list _:ptr scene:ptr",
)
Connection = _structure("Connection", "src:ptr dst:ptr src_prop:list dst_prop:list")
Node = _structure(
    "Node",
    "parent:ptr children:list mesh:ptr light:ptr camera:ptr bone:ptr attrib:ptr _:ptr _:ptr attrib_type:int all_attribs:list"
    " _:int _:int local:real*10 geometry:real*10 _:real*3 _:ptr _:int _:real*3 node_to_parent:real*12 node_to_world:real*12"
    " geometry_to_node:real*12 geometry_to_world:real*12 _:real*12 _:real*3 _:real*4 _:real _:real*4 _:real _:real _:int"
    " materials:list _:ptr visible:bool is_root:bool",
    Element,
)
Vertex = _structure("Vertex", "exists:bool values:list indices:list _:size _:bool _:list")
UvSet = _structure("UvSet", "name:list index:uint uv:Vertex tangent:Vertex bitangent:Vertex")
Face = _structure("Face", "begin:uint count:uint")
Mesh = _structure(
    "Mesh",
    "num_vertices:size num_indices:size num_faces:size num_triangles:size _:size _:size num_empty:size num_points:size"
    " num_lines:size faces:list face_smoothing:list face_material:list face_group:list face_hole:list edges:list _:list"
    " edge_crease:list _:list vertex_indices:list vertices:list _:list"
    " position:Vertex normal:Vertex uv:Vertex tangent:Vertex bitangent:Vertex"
    " color:Vertex crease:Vertex uv_sets:list color_sets:list materials:list _:list _:list _:list _:list skinned_is_local:bool"
    " skinned_position:Vertex skinned_normal:Vertex skins:list blends:list caches:list _:list _:uint subdivision_levels:uint"
    " subdivision_mode:int _:int _:int _:bool generated_normals:bool",
    Element,
)
Light = _structure(
    "Light",
    "color:real*3 intensity:real direction:real*3 kind:int decay:int shape:int inner_angle:real outer_angle:real shines:bool",
    Element,
)
Camera = _structure(
    "Camera",
    "projection:int _:bool resolution:real*2 fov:real*2 fov_tan:real*2 _:real orthographic:real*2 _:real*2 aspect:real"
    " near:real far:real _:int*7 focal_mm:real",
    Element,
)
SkinDeformer = _structure("SkinDeformer", "method:int clusters:list vertices:list weights:list most_weights:size", Element)
SkinCluster = _structure(
    "SkinCluster", "bone:ptr _:real*12 _:real*12 _:real*12 geometry_to_world:real*12 _:real*10 _:size _:list _:list", Element
)
BlendDeformer = _structure("BlendDeformer", "channels:list", Element)
BlendKeyframe = _structure("BlendKeyframe", "shape:ptr target_weight:real weight:real")
BlendChannel = _structure("BlendChannel", "weight:real keyframes:list target:ptr", Element)
BlendShape = _structure("BlendShape", "_:size vertices:list positions:list normals:list _:list", Element)

MaterialMap = _structure(
    "MaterialMap", "value:real*4 number:long texture:ptr has_value:bool texture_enabled:bool disabled:bool components:byte"
)
FBX_MAPS = _names(
    "diffuse_factor diffuse_color specular_factor specular_color specular_exponent reflection_factor reflection_color"
    " transparency_factor transparency_color emission_factor emission_color ambient_factor ambient_color normal_map bump"
    " bump_factor displacement_factor displacement vector_displacement_factor vector_displacement"
)
PBR_MAPS = _names(
    "base_factor base_color roughness metalness diffuse_roughness specular_factor specular_color specular_ior"
    " specular_anisotropy specular_rotation transmission_factor transmission_color transmission_depth transmission_scatter"
    " transmission_scatter_anisotropy transmission_dispersion transmission_roughness transmission_extra_roughness"
    " transmission_priority transmission_enable_in_aov subsurface_factor subsurface_color subsurface_radius subsurface_scale"
    " subsurface_anisotropy subsurface_tint_color subsurface_type sheen_factor sheen_color sheen_roughness coat_factor"
    " coat_color coat_roughness coat_ior coat_anisotropy coat_rotation coat_normal coat_affect_base_color"
    " coat_affect_base_roughness thin_film_factor thin_film_thickness thin_film_ior emission_factor emission_color opacity"
    " indirect_diffuse indirect_specular normal_map tangent_map displacement_map matte_factor matte_color ambient_occlusion"
    " glossiness coat_glossiness transmission_glossiness"
)
FEATURES = _names(
    "pbr metalness diffuse specular emission transmission coat sheen opacity ambient_occlusion matte unlit ior"
    " diffuse_roughness transmission_roughness thin_walled caustics exit_to_background internal_reflections double_sided"
    " roughness_as_glossiness coat_roughness_as_glossiness transmission_roughness_as_glossiness"
)
Material = _structure(
    "Material",
    f"fbx:MaterialMap*{len(FBX_MAPS)} pbr:MaterialMap*{len(PBR_MAPS)} features:bool*{2 * len(FEATURES)} shader:int _:ptr"
    " model:list _:list textures:list",
    Element,
)
MaterialTexture = _structure("MaterialTexture", "property:list _:list texture:ptr")
Texture = _structure(
    "Texture",
    "kind:int filename:list absolute:list relative:list _:list _:list _:list content:list video:ptr _:uint has_file:bool"
    " layers:list shader:ptr files:list uv_set:list wrap_u:int wrap_v:int has_transform:bool _:real*10 _:real*12"
    " uv_to_texture:real*12",
    Element,
)
Anim = _structure("Anim", "begin:real end:real layers:list")
AnimStack = _structure("AnimStack", "begin:real end:real layers:list anim:ptr", Element)
AnimLayer = _structure("AnimLayer", "weight:real _:bool _:bool _:bool _:bool _:bool values:list properties:list", Element)
AnimProp = _structure("AnimProp", "element:ptr _:uint name:list value:ptr")
AnimValue = _structure("AnimValue", "_:real*3 curves:ptr*3", Element)
AnimCurve = _structure("AnimCurve", "keys:list _:int*2 _:int*2 least:real most:real", Element)

Notice = _structure("Notice", "kind:int description:list _:uint count:size")
_Application = _structure("Application", "_:list _:list _:list")
_Thumbnail = _structure("Thumbnail", "_:Props _:uint _:uint _:int _:list")
_Metadata = _structure(
    "Metadata",
    "warnings:list is_text:bool version:uint format:int _:bool _:bool _:bool _:bool _:bool*15 creator:list _:bool _:list _:list"
    " _:list _:list exporter:int _:uint _:Props _:Application _:Application _:Thumbnail _:bool _:bool _:bool _:size _:size"
    " _:size _:size _:size _:size _:size _:real _:bool _:real _:long _:list _:list _:int _:int _:int _:int _:int _:real*4"
    " root_scale:real _:int _:real",
)
_Settings = _structure(
    "Settings",
    "_:Props right:int up:int front:int unit_meters:real fps:real _:real*3 camera:list _:int _:int _:int _:int unit:real",
)
Scene = _structure(
    "Scene",
    "metadata:Metadata settings:Settings root:ptr anim:ptr unknowns:list nodes:list meshes:list lights:list cameras:list"
    " bones:list empties:list line_curves:list nurbs_curves:list nurbs_surfaces:list trim_surfaces:list trim_boundaries:list"
    " procedural:list stereo_cameras:list camera_switchers:list markers:list lod_groups:list skins:list clusters:list"
    " blends:list channels:list shapes:list caches:list cache_files:list materials:list textures:list videos:list shaders:list"
    " bindings:list stacks:list layers:list values:list curves:list display_layers:list _:list _:list characters:list"
    " constraints:list",
)

_Frame = _structure("Frame", "_:uint _:list _:list")
Error = _structure("Error", "kind:int description:list _:uint _:Frame*8 info_length:size info:char*256")
_Allocator = _structure("Allocator", "_:ptr*5 memory:size _:size _:size _:size")
_Threads = _structure("Threads", "_:ptr*5 _:size _:size")
_Callback = _structure("Callback", "_:ptr*2")
_Axes = _structure("Axes", "right:int up:int front:int")
LoadOptions = _structure(
    "LoadOptions",
    "_:uint temporary:Allocator result:Allocator _:Threads _:bool*4 evaluate_skinning:bool _:bool load_external:bool _:bool"
    " _:bool _:bool clean_skin_weights:bool blender_pbr:bool _:bool _:bool _:bool unsafe:bool index_errors:int"
    " connect_broken:bool _:bool _:bool _:bool make_normals:bool _:bool _:char depth_limit:uint _:long _:size _:list _:list"
    " _:Callback _:long _:Callback _:int _:int space:int _:int _:bool _:int _:bool _:bool axes:Axes unit_meters:real _:Axes"
    " _:Axes _:list _:list normalize:bool _:bool _:bool _:real*10 _:real unicode_errors:int _:bool _:bool format:int _:size"
    " no_content:bool no_extension:bool _:bool*4 _:list _:list _:real _:Axes _:uint",
)
EvaluateOptions = _structure(
    "EvaluateOptions", "_:uint temporary:Allocator result:Allocator _:bool _:bool _:uint _:bool _:Callback _:uint"
)
PropOverride = _structure("PropOverride", "element:uint name:list value:real*4 text:list number:long")
AnimOptions = _structure("AnimOptions", "_:uint layers:list _:list overrides:list _:list _:bool result:Allocator _:uint")
