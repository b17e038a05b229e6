"""Tests of `rayfarm mcp` with the protocol's own client: over standard input and output to a real farm, and with roles."""

from __future__ import annotations

import base64
import io
import os
import sys
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import TYPE_CHECKING, Any

import anyio
import httpx
import pytest
from PIL import Image

from rayfarm.client import Client
from rayfarm.login import farm_client
from tests.helpers import ROOT, Farm, running_redis
from tests.rayfarm.program import rayfarm
from tests.service.conftest import Service

if TYPE_CHECKING:  # mcp takes half a second to import, in each process that collects tests
    from mcp import Client as McpClient
    from mcp import StdioServerParameters
    from mcp.types import CallToolResult

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
READ = {"list_scenes", "inspect_scene", "list_jobs", "job_status", "wait_for_job", "list_workers", "get_picture"}


def started(url: str, *arguments: str | Path) -> StdioServerParameters:
    from mcp import StdioServerParameters

    return StdioServerParameters(
        command=sys.executable,
        args=["-m", "rayfarm", "mcp", "--server", url, *map(str, arguments)],
        env=dict(os.environ),
        cwd=ROOT,
    )


def use(server: Any, act: Callable[[McpClient], Coroutine[Any, Any, None]], mode: str = "auto") -> None:
    from mcp import Client as McpClient

    async def run() -> None:
        with anyio.fail_after(180):
            async with McpClient(server, mode=mode) as client:
                await act(client)

    anyio.run(run)


def value(result: CallToolResult) -> dict[str, Any]:
    assert not result.is_error, result.content
    assert result.structured_content is not None
    return result.structured_content


def sentence(result: CallToolResult) -> str:
    assert result.is_error, result.content
    return str(result.content[0].text)  # type: ignore[union-attr]


def test_an_assistant_renders_a_picture(farm: Farm, tmp_path: Path) -> None:
    scene = tmp_path / "box.yaml"
    scene.write_text((ROOT / "scenes" / "cornell-box.yaml").read_text())
    done: list[float] = []

    async def note(progress: float, total: float | None, message: str | None) -> None:
        done.append(progress)

    async def act(client: McpClient) -> None:
        assert client.instructions is not None and farm.url in client.instructions
        tools = {tool.name: tool for tool in (await client.list_tools()).tools}
        assert set(tools) == READ | {"submit_job", "upload_scene", "cancel_job"}
        assert all(tool.description for tool in tools.values())
        assert {name for name, tool in tools.items() if tool.annotations and tool.annotations.read_only_hint} == READ
        uploaded = value(await client.call_tool("upload_scene", {"path": "box.yaml"}))
        assert uploaded["status"] == "ready" and uploaded["cameras"]
        assert uploaded["id"] in [row["id"] for row in value(await client.call_tool("list_scenes", {"search": "box"}))["scenes"]]
        assert value(await client.call_tool("inspect_scene", {"scene": uploaded["id"]}))["counts"] == uploaded["counts"]
        asked = {"width": 64, "height": 48, "spp": 16, "camera": 0, "settings": {"max_depth": 4, "seed": 7}, "name": "small"}
        job = value(await client.call_tool("submit_job", {"scene": uploaded["id"], **asked}))
        ended = value(await client.call_tool("wait_for_job", {"job": job["id"], "timeout_s": 120}, progress_callback=note))
        assert (ended["state"], ended["progress"], ended["name"]) == ("finished", 1.0, "small")
        assert (ended["settings"]["seed"], ended["settings"]["max_depth"], ended["spp"]) == (7, 4, 16)
        assert done and done == sorted(done) and done[-1] == 1.0
        shown = await client.call_tool("get_picture", {"job": job["id"], "width": 40})
        assert not shown.is_error
        picture, caption = shown.content
        assert (picture.type, picture.mime_type) == ("image", "image/png")
        with Image.open(io.BytesIO(base64.b64decode(picture.data))) as image:
            assert image.size == (40, 30)
            assert max(high for _, high in image.convert("RGB").getextrema()) > 150
        assert "finished: 100 %" in caption.text
        with farm.client() as direct:
            assert direct.job(job["id"]).state == "finished"
        assert value(await client.call_tool("list_workers"))["workers"][0]["slots"] == 2
        endless = value(await client.call_tool("submit_job", {"scene": uploaded["id"], "spp": 100_000}))
        soon = value(await client.call_tool("wait_for_job", {"job": endless["id"], "timeout_s": 0}))
        assert soon["state"] in ("queued", "running")
        assert value(await client.call_tool("cancel_job", {"job": endless["id"]}))["state"] == "cancelled"
        cancelled = value(await client.call_tool("list_jobs", {"state": "cancelled"}))["jobs"]
        assert endless["id"] in [row["id"] for row in cancelled]

    use(started(farm.url, "--folder", tmp_path), act)


def test_the_farms_roles_apply(tmp_path: Path, redis_server: running_redis, monkeypatch: pytest.MonkeyPatch) -> None:
    from rayfarm.mcp_server import create_server

    service = Service(tmp_path / "data", redis_server, host="0.0.0.0", trusted_proxies="127.0.0.1")
    try:
        owner = (tmp_path / "data" / "owner-token").read_text().strip()
        with httpx.Client(base_url=service.url, headers={"Authorization": f"Bearer {owner}"}, verify=False) as http:
            scene = http.post("/api/scenes", files={"files": ("scene.obj", TRIANGLE)}).json()["id"]
            viewer = http.post("/api/tokens", json={"name": "screen", "role": "view"}).json()["secret"]
        (tmp_path / "mine.obj").write_text(TRIANGLE)

        async def look(client: McpClient) -> None:
            assert [row["id"] for row in value(await client.call_tool("list_scenes"))["scenes"]] == [scene]
            for tool, asked in (("submit_job", {"scene": scene}), ("upload_scene", {"path": "mine.obj"})):
                said = sentence(await client.call_tool(tool, asked))
                assert "This needs the role submit; owner has the role view" in said

        monkeypatch.setenv("RAYFARM_API_TOKEN", viewer)
        with farm_client(service.url) as screen:
            use(create_server(screen, [tmp_path]), look, mode="legacy")

        async def knock(client: McpClient) -> None:
            assert "log in" in sentence(await client.call_tool("list_scenes")).lower()

        with Client(service.url, token="") as nobody:
            use(create_server(nobody), knock)
    finally:
        service.stop()


def test_only_files_of_the_given_folders_are_uploaded(service: Service, tmp_path: Path) -> None:
    from rayfarm.mcp_server import create_server

    shared, private = tmp_path / "shared", tmp_path / "private"
    shared.mkdir()
    private.mkdir()
    (private / "secret.obj").write_text(TRIANGLE)
    (shared / "link.obj").symlink_to(private / "secret.obj")
    (shared / "named.obj").write_text("mtllib colours.mtl\n" + TRIANGLE)
    (private / "colours.mtl").write_text("newmtl a\n")
    (shared / "colours.mtl").symlink_to(private / "colours.mtl")

    async def act(client: McpClient) -> None:
        for path in (private / "secret.obj", "../private/secret.obj", "link.obj", "/etc/passwd"):
            said = sentence(await client.call_tool("upload_scene", {"path": str(path)}))
            assert "is not in a folder whose scenes may be uploaded" in said
        assert "leads outside" in sentence(await client.call_tool("upload_scene", {"path": "named.obj"}))
        assert "There is no file" in sentence(await client.call_tool("upload_scene", {"path": "none.obj"}))
        assert value(await client.call_tool("list_scenes"))["scenes"] == []

    async def without_folder(client: McpClient) -> None:
        assert "upload_scene" not in {tool.name for tool in (await client.list_tools()).tools}
        assert "no scene" in sentence(await client.call_tool("inspect_scene", {"scene": "nowhere"})).lower()

    with Client(service.url) as farm:
        use(create_server(farm, [shared]), act)
        use(create_server(farm), without_folder)


def test_what_is_missing_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done = rayfarm("mcp", "--folder", tmp_path / "none")
    assert done.returncode == 1 and "which is not a folder" in done.stderr
    monkeypatch.setitem(sys.modules, "mcp.server.mcpserver", None)
    monkeypatch.delitem(sys.modules, "rayfarm.mcp_server")
    done = rayfarm("mcp")
    assert done.returncode == 1 and 'pip install "rayfarm[mcp]"' in done.stderr
