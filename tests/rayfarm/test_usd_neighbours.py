"""Tests of finding the files that a USD scene refers to, also in binary layers, where names are compressed."""

from pxr import UsdGeom

from rayfarm.scene_files import files_to_upload
from tests.renderer.scene.usd_files import TYPES, bind, material, mesh, stage, texture


def test_files_named_by_binary_stage_are_found(tmp_path):
    part = stage(tmp_path / "part.usdc")
    part.SetDefaultPrim(UsdGeom.Xform.Define(part, "/p").GetPrim())
    bind(
        mesh(part, "/p/m"),
        material(part, "/p/look", diffuseColor=(TYPES.Color3f, texture(part, "/p/look/t", "./maps/skin.<UDIM>.png")))[0],
    )
    part.GetRootLayer().Save()
    main = stage(tmp_path / "main.usdc")
    UsdGeom.Xform.Define(main, "/a").GetPrim().GetReferences().AddReference("./part.usdc")
    main.GetRootLayer().Save()
    (tmp_path / "maps").mkdir()
    for name in ("maps/skin.1001.png", "maps/skin.1002.png", "holiday.png"):
        (tmp_path / name).write_bytes(b"x")
    assert set(files_to_upload(tmp_path / "main.usdc")) == {"main.usdc", "part.usdc", "maps/skin.1001.png", "maps/skin.1002.png"}
