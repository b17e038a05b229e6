"""Tests of the hooks for Maya, Houdini, Nuke and AYON with substitutes for these programs, which are not installed here.

The substitutes have the calls that the hooks make and nothing else; the USD files, the program `rayfarm` and the farm are real.
"""

from __future__ import annotations

import importlib
import json
import sys
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdLux

from renderer.scene.animation import Moment
from renderer.scene.load import read
from tests.helpers import ROOT, Farm
from tests.rayfarm.program import rayfarm
from tests.rayfarm.test_with_farm import pixels

FIRST, LAST = 1001, 1004


@pytest.fixture(autouse=True)
def hooks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "submitters" / "ayon_publish"))
    monkeypatch.syspath_prepend(str(ROOT / "submitters"))
    monkeypatch.delitem(sys.modules, "submit_rayfarm", raising=False)
    for name in [name for name in sys.modules if name.split(".")[0] == "rayfarm_submit"]:
        monkeypatch.delitem(sys.modules, name)


@pytest.fixture
def calls(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Replaces the program `rayfarm` by one that prints a job's id; returns the file to which it writes its arguments."""
    program, written = tmp_path / "rayfarm", tmp_path / "calls.json"
    program.write_text(
        f"#!{sys.executable}\nimport json, sys\n"
        f"if '-o' in sys.argv: sys.exit(print('All 3 frames are there', file=sys.stderr))\n"
        f"if 'bad' in sys.argv: sys.exit('rayfarm: The scene cannot be read.')\n"
        f"json.dump(sys.argv[1:], open({str(written)!r}, 'w'))\nprint('7f3a1c')\n"
    )
    program.chmod(0o755)
    monkeypatch.setenv("RAYFARM_PROGRAM", str(program))
    return written


def hook(name: str) -> Any:
    return importlib.import_module(f"rayfarm_submit.{name}")


def write_stage(path: str, first: float, last: float, prepend: str = "") -> None:
    """Writes a ball that moves from frame to frame, a light and a camera, as a program's export does."""
    stage = Usd.Stage.CreateNew(path)
    stage.SetTimeCodesPerSecond(24)
    stage.SetStartTimeCode(first)
    stage.SetEndTimeCode(last)
    ball = UsdGeom.Sphere.Define(stage, "/ball").AddTranslateOp()
    for frame in range(int(first), int(last) + 1):
        ball.Set(Gf.Vec3d(0.2 * (frame - FIRST), 0, 0), frame)
    UsdLux.DomeLight.Define(stage, "/dome")
    UsdGeom.Camera.Define(stage, f"/{prepend}shotCam").AddTranslateOp().Set(Gf.Vec3d(0, 0, 12))
    stage.Save()


def maya_program(animation: bool = True) -> ModuleType:
    """Returns a substitute for Maya's module, with a scene that has two cameras."""
    values = {
        "defaultRenderGlobals.animation": animation,
        "defaultRenderGlobals.startFrame": FIRST,
        "defaultRenderGlobals.endFrame": LAST,
        "defaultRenderGlobals.byFrameStep": 2,
        "defaultResolution.width": 48,
        "defaultResolution.height": 32,
        "|persp|perspShape.renderable": False,
        "|rig|anim:shotCam|anim:shotCamShape.renderable": True,
    }
    cmds = MagicMock(spec=["getAttr", "currentTime", "file", "loadPlugin", "mayaUSDExport", "ls"])
    cmds.getAttr.side_effect = values.__getitem__
    cmds.currentTime.return_value = 1002.0
    cmds.file.return_value = "/shots/sh010/light v3.ma"
    cmds.ls.return_value = [name.removesuffix(".renderable") for name in values if name.endswith(".renderable")]
    cmds.mayaUSDExport.side_effect = lambda file, **more: write_stage(file, *more["frameRange"], prepend="anim_")
    program = ModuleType("maya")
    program.cmds = cmds  # type: ignore[attr-defined]
    return program


def test_maya_exports_and_submits_its_render_settings(tmp_path: Path, calls: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "maya", maya_program())
    job = hook("maya").submit(str(tmp_path / "out"), server="http://studio:8000", options=["--spp", "256"])
    stage = tmp_path / "out" / "light v3.usdc"
    assert job == "7f3a1c"
    assert json.loads(calls.read_text()) == [
        "submit", str(stage), "--frames", "1001-1004x2", "--camera", "anim_shotCam", "--size", "48x32",
        "--server", "http://studio:8000", "--spp", "256",
    ]  # fmt: skip
    monkeypatch.setitem(sys.modules, "maya", maya_program(animation=False))
    hook("maya").submit(str(tmp_path / "still"))
    assert json.loads(calls.read_text())[2:4] == ["--frames", "1002"]


def test_frames_keep_the_numbers_of_the_shot(tmp_path: Path) -> None:
    """Frame 1003 of a stage whose start was set to 0 is what frame 2 was when it began at 1001."""
    write_stage(str(tmp_path / "a.usda"), FIRST, LAST)
    before = read(tmp_path, "a.usda", moment=Moment(2))
    hook("farm").keep_frame_numbers(tmp_path / "a.usda")
    after = read(tmp_path, "a.usda", moment=Moment(1003))
    assert before.spheres[0].center == after.spheres[0].center == pytest.approx((0.004, 0, 0)), "2 steps of 0.2 cm"


def houdini_program(written: list[str]) -> ModuleType:
    """Returns a substitute for Houdini's module, with a LOP node /stage/OUT."""
    parms: dict[str, MagicMock] = {}
    writer = MagicMock(spec=["setInput", "parm", "errors", "destroy"])
    writer.parm.side_effect = lambda name: parms.setdefault(name, MagicMock(spec=["set", "deleteAllKeyframes", "pressButton"]))
    value = lambda name: parms[name].set.call_args.args[0]  # noqa: E731
    writer.errors.return_value = ()

    def press() -> None:
        assert (value("trange"), value("savestyle")) == ("normal", "flattenalllayers")
        written.append(value("lopoutput"))
        write_stage(value("lopoutput"), value("f1"), value("f2"))

    parms["execute"] = MagicMock(pressButton=MagicMock(side_effect=press))
    source = MagicMock(spec=["name", "parent"])
    source.name.return_value = "OUT"
    source.parent.return_value.createNode.side_effect = {"usd_rop": writer}.__getitem__
    program = ModuleType("hou")
    program.node = {"/stage/OUT": source}.get  # type: ignore[attr-defined]
    program.playbar = SimpleNamespace(frameRange=lambda: (FIRST, LAST))  # type: ignore[attr-defined]
    program.text = SimpleNamespace(expandString=lambda text: text.replace("$HIP", written[0]))  # type: ignore[attr-defined]
    program.writer = writer  # type: ignore[attr-defined]
    return program


def test_houdini_exports_a_node_and_removes_its_writer(tmp_path: Path, calls: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written = [str(tmp_path)]
    program = houdini_program(written)
    monkeypatch.setitem(sys.modules, "hou", program)
    hook("houdini").submit("/stage/OUT", "$HIP/render", camera="shotCam")
    stage = tmp_path / "render" / "OUT.usdc"
    assert written[1:] == [str(stage)]
    assert json.loads(calls.read_text()) == ["submit", str(stage), "--frames", "1001-1004", "--camera", "shotCam"]
    program.writer.errors.return_value = ("No stage.",)
    with pytest.raises(hook("farm").FarmError, match="No stage"):
        hook("houdini").submit("/stage/OUT", "$HIP/render")
    assert program.writer.destroy.call_count == 2
    with pytest.raises(hook("farm").FarmError, match="no node /stage/NO"):
        hook("houdini").submit("/stage/NO", "$HIP/render")


def ayon_modules(monkeypatch: pytest.MonkeyPatch) -> None:
    """Installs substitutes for the modules that AYON's publisher has."""
    mixin = type("AYONPyblishPluginMixin", (), {"get_attr_values_from_data": lambda self, data: data["attributes"]})
    for name, content in {
        "pyblish.api": {"InstancePlugin": type("InstancePlugin", (), {}), "IntegratorOrder": 3},
        "ayon_core.lib": {each: lambda name, **more: (name, more) for each in ("BoolDef", "NumberDef", "TextDef")},
        "ayon_core.pipeline.publish": {"AYONPyblishPluginMixin": mixin},
    }.items():
        parts = name.split(".")
        for n in range(1, len(parts) + 1):
            monkeypatch.setitem(sys.modules, ".".join(parts[:n]), ModuleType(".".join(parts[:n])))
        sys.modules[name].__dict__.update(content)
    setattr(sys.modules["pyblish"], "api", sys.modules["pyblish.api"])  # noqa: B010


def test_ayon_submits_published_usd_where_asked_to(tmp_path: Path, calls: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ayon_modules(monkeypatch)
    plugin = importlib.import_module("submit_rayfarm").SubmitRayfarm()
    plugin.log = MagicMock()
    defaults = {name: more["default"] for name, more in plugin.get_attribute_defs()}
    data: dict[str, Any] = {"attributes": defaults, "frameStart": FIRST, "frameEnd": LAST}
    plugin.process(SimpleNamespace(data=data))
    data["attributes"] = {**defaults, "rayfarm": True, "rayfarm_priority": 5}
    plugin.process(SimpleNamespace(data=data))
    assert not calls.exists() and plugin.log.warning.called
    paths = ("/publish/review.mov", "/publish/shot_v003.usd")
    data["published_representations"] = {path: {"representation": {"attrib": {"path": path}}} for path in paths}
    plugin.process(SimpleNamespace(data=data))
    assert data["rayfarmJob"] == "7f3a1c"
    assert json.loads(calls.read_text()) == ["submit", paths[1], "--frames", "0-3", "--spp", "256", "--priority", "5"]


def test_faults_are_sentences(tmp_path: Path, calls: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    farm = hook("farm")
    with pytest.raises(farm.FarmError, match=r"^rayfarm: The scene cannot be read\.$"):
        farm.submit(tmp_path / "a.usd", options=["bad"])
    with pytest.raises(farm.FarmError, match="All 3 frames"):
        farm.submit(tmp_path / "a.usd", options=["-o", "a.#.png"])
    with pytest.raises(farm.FarmError, match="frames begin at 0"):
        farm.frames_of(-5, 10)
    assert farm.frames_of(1001001, 1001100.5, 0.5) == "1001001-1001100.5x0.5"
    monkeypatch.delenv("RAYFARM_PROGRAM")
    monkeypatch.setenv("PATH", "")
    with pytest.raises(farm.FarmError, match="RAYFARM_PROGRAM"):
        farm.submit(tmp_path / "a.usd")
    monkeypatch.delenv("RAYFARM_SERVER", raising=False)
    with pytest.raises(farm.FarmError, match="RAYFARM_SERVER"):
        farm.Farm()
    with pytest.raises(farm.FarmError, match="does not answer"):
        farm.Farm("http://127.0.0.1:9").job("x y")


class Short(BaseHTTPRequestHandler):
    """Answers with 3 bytes of 10 to requests for a picture, and with a page to others."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Length", "10" if "image" in self.path else "3")
        self.end_headers()
        self.wfile.write(b"<a>")

    def log_message(self, *args: object) -> None:
        """Writes no log."""


def test_broken_answers_are_no_pictures(tmp_path: Path) -> None:
    farm = hook("farm")
    with ThreadingHTTPServer(("127.0.0.1", 0), Short) as server:
        threading.Thread(target=server.serve_forever, args=(0.01,)).start()
        there = farm.Farm(f"http://127.0.0.1:{server.server_port}")
        with pytest.raises(farm.FarmError, match="does not answer"):
            there.fetch("x", 1, tmp_path / "a.exr")
        with pytest.raises(farm.FarmError, match="no farm"):
            there.job("x")
        server.shutdown()
    assert not (tmp_path / "a.exr").exists()


def nuke_program() -> ModuleType:
    """Returns a substitute for Nuke's module."""
    nodes: dict[str, Any] = {}

    def make(name: str) -> Any:
        knobs: dict[str, MagicMock] = {}
        nodes[name] = MagicMock()
        nodes[name].__getitem__.side_effect = lambda knob: knobs.setdefault(knob, MagicMock(spec=["setValue", "fromUserText"]))
        return nodes[name]

    program = ModuleType("nuke")
    program.toNode = nodes.get  # type: ignore[attr-defined]
    program.nodes = SimpleNamespace(Read=make)  # type: ignore[attr-defined]
    return program


@pytest.mark.long
def test_from_maya_by_a_farm_to_nuke(farm: Farm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A shot that the hook for Maya submits to a real farm comes back to Nuke with the numbers and pixels of the shot."""
    monkeypatch.setitem(sys.modules, "maya", maya_program())
    monkeypatch.setitem(sys.modules, "nuke", nuke_program())
    monkeypatch.setenv("RAYFARM_PROGRAM", str(Path(sys.executable).parent / "rayfarm"))
    job = hook("maya").submit(str(tmp_path / "out"), server=farm.url, options=["--spp", "4"])
    with pytest.raises(hook("farm").FarmError, match="no job 'none'"):
        hook("nuke").read("none", str(tmp_path / "read"), farm.url)
    with farm.client() as client:
        assert client.wait(job, timeout_s=120).state == "finished"
    node = hook("nuke").read(job, str(tmp_path / "read"), farm.url)
    assert hook("nuke").read(job, str(tmp_path / "read"), farm.url) is node
    pattern = f"{tmp_path}/read/{job}.####.exr"
    node["file"].fromUserText.assert_called_with(f"{pattern} 1001-1003")
    scene = tmp_path / "out" / "light v3.usdc"
    words = ["--frames=1001,1003", "--size=48x32", "--spp=4", "--camera=anim_shotCam", "--aov=all"]
    assert rayfarm("render", scene, "-o", tmp_path / "near.####.exr", *words).returncode == 0
    for number in (1001, 1003):
        assert np.array_equal(pixels(tmp_path / "read" / f"{job}.{number}.exr"), pixels(tmp_path / f"near.{number}.exr"))
