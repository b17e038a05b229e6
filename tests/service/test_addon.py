"""Tests of the add-on's zip archive: it meets Blender's requirements.

The service and the command line make the same bytes.
"""

from __future__ import annotations

import ast
import io
import re
import tomllib
import zipfile

import pytest
import typer
from typer.testing import CliRunner

from rayfarm.commands import blender_addon
from renderer import __version__
from service.addon import FOLDER, addon_zip
from tests.helpers import ROOT

NUMBERS = tuple(int(part) for part in __version__.split(".")[:3])
ALLOWED = {"bpy", "bpy_extras", "gpu", "gpu_extras", "mathutils", "numpy"}


@pytest.fixture(scope="module")
def archive() -> zipfile.ZipFile:
    return zipfile.ZipFile(io.BytesIO(addon_zip()))


def test_manifest_is_valid_for_blender(archive: zipfile.ZipFile) -> None:
    manifest = tomllib.loads(archive.read(f"{FOLDER}/blender_manifest.toml").decode())
    assert manifest["version"] == ".".join(map(str, NUMBERS))
    assert manifest["blender_version_min"] == "4.2.0"
    assert {"schema_version", "id", "name", "tagline", "maintainer", "type", "license"} <= set(manifest)
    assert len(manifest["tagline"]) <= 64
    assert not manifest["tagline"].endswith(".")
    assert all(len(why) <= 64 and not why.endswith(".") for why in manifest["permissions"].values())


def test_bl_info_equals_manifest(archive: zipfile.ZipFile) -> None:
    tree = ast.parse(archive.read(f"{FOLDER}/__init__.py"))
    said = next(node.value for node in tree.body if isinstance(node, ast.Assign) and node.targets[0].id == "bl_info")
    info = ast.literal_eval(said)
    assert info["version"] == NUMBERS
    assert info["blender"] == (4, 2, 0)


@pytest.mark.long
def test_addon_imports_only_available_modules(archive: zipfile.ZipFile) -> None:
    import sys

    names = [name for name in archive.namelist() if name.endswith(".py")]
    assert {
        f"{FOLDER}/{path.relative_to(ROOT / 'blender' / FOLDER).as_posix()}" for path in (ROOT / "blender").rglob("*.py")
    } == {*names}
    for name in names:
        for node in ast.walk(ast.parse(archive.read(name))):
            wanted = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            wanted += [node.module or ""] if isinstance(node, ast.ImportFrom) and not node.level else []
            foreign = {each.partition(".")[0] for each in wanted} - sys.stdlib_module_names - ALLOWED
            assert not foreign, f"{name} imports {foreign}"
    pure = [name for name in names if "/farm/" in name or "/scene/" in name]
    needs_blender = re.compile(rb"^(import|from) bpy", re.MULTILINE)
    assert not [name for name in pure if needs_blender.search(archive.read(name))], (
        "these can be imported, and tested, without Blender"
    )


def test_equal_sources_give_equal_archive() -> None:
    assert addon_zip() == addon_zip()


def test_command_writes_addon(tmp_path) -> None:
    program = typer.Typer()
    blender_addon.register(program)
    for output in (tmp_path / "addon.zip", tmp_path):
        done = CliRunner().invoke(program, ["-o", str(output)])
        assert done.exit_code == 0, done.output
    assert (tmp_path / "addon.zip").read_bytes() == (tmp_path / "rayfarm-blender.zip").read_bytes() == addon_zip()
