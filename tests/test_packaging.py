"""Tests that a wheel installed by `pip install rayfarm` runs a whole farm in any folder."""

from __future__ import annotations

import importlib.metadata
import os
import re
import subprocess
import sys
import tarfile
import tomllib
import venv
import zipfile
from pathlib import Path

import grimp
import httpx
import pytest
from packaging.requirements import Requirement

import renderer
from service import locations
from tests.helpers import ROOT, Farm, farm_of, stop_farm

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
OURS = ("renderer", "protocol", "telemetry", "worker", "service", "rayfarm")


def normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def built(source: Path, to: Path, *targets: str) -> Path:
    """Runs the build backend on `source` without downloads, and returns the folder `to` with the built archives."""
    wanted = [f"--target={target}" for target in targets]
    command = [sys.executable, "-m", "hatchling", "build", *wanted, "--directory", str(to)]
    done = subprocess.run(command, cwd=source, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return to


def wheel_in(folder: Path) -> Path:
    return next(folder.glob("rayfarm-*.whl"))


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Returns the path of the wheel; the source archive is in the same folder."""
    return wheel_in(built(ROOT, tmp_path_factory.mktemp("wheel"), "sdist", "wheel"))


def content(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return {name for name in archive.namelist() if ".dist-info/" not in name}


def test_wheel_contents(wheel: Path) -> None:
    files = content(wheel)
    assert {name.partition("/")[0] for name in files} == set(OURS), "no other package at the top of site-packages"
    for package in OURS:
        sources = {path.relative_to(ROOT).as_posix() for path in (ROOT / package).rglob("*.py")}
        assert sources <= files
        assert f"{package}/py.typed" in files
    for folder in ("web/js", "web/css", "web/examples"):
        shown = {path.relative_to(ROOT).as_posix() for path in (ROOT / folder).rglob("*") if path.is_file()}
        assert {f"service/{name}" for name in shown} <= files
    scenes = {path.relative_to(ROOT).as_posix() for path in (ROOT / "scenes").rglob("*.yaml")}
    assert {name.replace("scenes", "service/examples", 1) for name in scenes} <= files
    addon = {path.relative_to(ROOT).as_posix() for path in (ROOT / "blender").rglob("*") if path.suffix in (".py", ".toml")}
    assert {f"service/{name}" for name in addon} <= files
    assert {"service/web/index.html", "service/docs_page/index.html", "renderer/scene/schema.json"} <= files
    assert any(name.endswith(".npy") for name in files)
    assert not [name for name in files if name.startswith("service/examples/") and name.endswith(".py")]
    assert not [name for name in files if "__pycache__" in name or "node_modules" in name or name.startswith("renderer/kernels/")]
    assert wheel.name.endswith("-py3-none-any.whl")


def test_wheel_metadata(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        info = f"rayfarm-{renderer.__version__}.dist-info"
        said = archive.read(f"{info}/METADATA").decode()
        assert b"Apache License" in archive.read(f"{info}/licenses/LICENSE")
    assert f"Version: {renderer.__version__}\n" in said
    assert "License-Expression: Apache-2.0\n" in said


def test_wheel_with_kernels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A wheel that is built with compiled kernels is tagged for this Python and system only.

    Building fails if the given folder has no kernels.
    """
    compiled = tmp_path / "compiled" / "kernels" / "abc"
    compiled.mkdir(parents=True)
    monkeypatch.setenv("RAYFARM_WHEEL_KERNELS", str(tmp_path / "compiled"))
    refused = subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "--target=wheel", "--directory", str(tmp_path / "none")],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert refused.returncode != 0
    assert "which has no kernels; make them by: python -m renderer.precompile" in refused.stderr
    (compiled / "plain.done").write_text("a.code\n")
    (compiled / "a.code").write_bytes(b"code")
    made = wheel_in(built(ROOT, tmp_path / "wheel", "wheel"))
    assert {"renderer/kernels/abc/plain.done", "renderer/kernels/abc/a.code"} <= content(made)
    assert f"cp{sys.version_info[0]}{sys.version_info[1]}-" in made.name
    assert not made.name.endswith("-any.whl")


@pytest.mark.long
def test_source_archive_builds_the_same_wheel(wheel: Path, tmp_path: Path) -> None:
    with tarfile.open(next(wheel.parent.glob("rayfarm-*.tar.gz"))) as archive:
        archive.extractall(tmp_path / "source", filter="data")
    made = wheel_in(built(next((tmp_path / "source").iterdir()), tmp_path / "again", "wheel"))
    assert content(made) == content(wheel)


def everything_works(farm: Farm) -> None:
    """Asserts that the farm serves the page and the examples, and renders an uploaded scene."""
    page = httpx.get(farm.url)
    assert (page.status_code, "<title>" in page.text) == (200, True)
    module = httpx.get(f"{farm.url}/js/main.js")
    assert (module.status_code, module.headers["content-type"].partition(";")[0]) == (200, "text/javascript")
    assert {"cornell-box", "christmas"} <= {example["name"] for example in httpx.get(f"{farm.url}/api/examples").json()}
    with farm.client() as client:
        scene = client.wait_for_scene(client.upload([ROOT / "scenes" / "cornell-box.yaml"]).id)
        job = client.wait(client.submit(scene.id, width=32, height=32, spp=4).id, timeout_s=120)
        assert job.state == "finished", farm.logs()
        assert client.image(job.id).startswith(b"\x89PNG")


@pytest.mark.long
def test_farm_runs_from_the_unpacked_wheel(wheel: Path, tmp_path: Path) -> None:
    """`rayfarm up` runs from the unpacked wheel, with the dependencies of this environment, in any folder."""
    site, elsewhere, home = tmp_path / "site", tmp_path / "elsewhere", tmp_path / "home"
    elsewhere.mkdir()
    home.mkdir()
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    up = [sys.executable, "-m", "rayfarm", "up", "--port=0", "--workers=1", "--no-browser"]
    environment = {"PYTHONPATH": str(site), "XDG_DATA_HOME": str(home), "RAYFARM_DATA": ""}
    farm = farm_of(up, home / "rayfarm", elsewhere, **environment)
    try:
        everything_works(farm)
        assert str(home / "rayfarm") in farm.log.read_text(), "it says where its data lies"
        assert not list(elsewhere.iterdir())
        bench = [sys.executable, "-m", "rayfarm", "bench", "bvh", "--size=2x2", "--patience=0"]
        done = subprocess.run(
            bench, cwd=elsewhere, env={**os.environ, **environment}, capture_output=True, text=True, check=False
        )
        assert "Without the BVH this takes about" in done.stderr  # the example scene was found
    finally:
        stop_farm(farm)


@pytest.mark.long
@pytest.mark.timeout(900)
def test_wheel_installs_into_an_empty_environment(wheel: Path, tmp_path: Path) -> None:
    """The wheel installs into an empty environment, with dependencies downloaded by pip."""
    venv.create(tmp_path / "venv", with_pip=True)
    program = tmp_path / "venv" / "bin"
    pip = [program / "python", "-m", "pip", "--disable-pip-version-check", "install", "--quiet"]
    fetch = {name: value for name, value in os.environ.items() if name != "SSL_CERT_DIR"}  # set by tests/conftest.py
    command = [*pip, wheel, "--constraint", ROOT / "constraints.txt"]
    done = subprocess.run(command, cwd=tmp_path, env=fetch, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    home = tmp_path / "home"
    home.mkdir()
    up = [str(program / "rayfarm"), "up", "--port=0", "--workers=1", "--no-browser"]
    farm = farm_of(up, home / "rayfarm", tmp_path, PYTHONPATH="", XDG_DATA_HOME=str(home), RAYFARM_DATA="")
    try:
        everything_works(farm)
    finally:
        stop_farm(farm)


def test_default_data_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    monkeypatch.setenv("RAYFARM_DATA", str(tmp_path / "named"))
    assert locations.default_data_folder() == tmp_path / "named"
    monkeypatch.delenv("RAYFARM_DATA")
    assert locations.default_data_folder() == ROOT / "data"
    monkeypatch.setattr(locations, "SOURCE_CHECKOUT", None)
    assert locations.default_data_folder().is_relative_to(tmp_path if sys.platform == "linux" else Path.home())
    assert not (tmp_path / "rayfarm").exists(), "asking makes no folder"


# renderer/blender/inside runs in Blender's own Python, which has these modules.
BLENDERS_OWN = {"bmesh", "bpy", "mathutils", "zstandard"}
# Imported where files of pictures are made, which no worker does: HDR stills and OCIO views.
NOT_USED = {"service": set[str](), "worker": {"av"}}


@pytest.fixture(scope="module")
def graph() -> grimp.ImportGraph:
    return grimp.build_graph(*OURS, include_external_packages=True, cache_dir=None)


@pytest.mark.parametrize(("image", "runs"), [("service", ["service"]), ("worker", ["worker", "renderer"])])
def test_slim_image_installs_its_imports(image: str, runs: list[str], graph: grimp.ImportGraph) -> None:
    lines = (ROOT / image / "requirements.txt").read_text().splitlines()
    wanted = [Requirement(line) for line in lines if line and not line.startswith("#")]
    names = ("postgres", "s3", "otel", "oidc", "ktx2", "ocio", "openjd")
    extras = [each for name in names for each in PROJECT["optional-dependencies"][name]]
    known = {normal(Requirement(line).name) for line in PROJECT["dependencies"] + extras}
    assert {normal(each.name) for each in wanted} <= known, "the image wants what a whole farm does not have"

    installed = with_dependencies(wanted)
    imported = {name.partition(".")[0] for each in runs for name in graph.find_upstream_modules(each, as_package=True)}
    foreign = imported - set(OURS) - sys.stdlib_module_names - BLENDERS_OWN - NOT_USED[image]
    owners = importlib.metadata.packages_distributions()
    missing = {name for name in foreign if not installed & {normal(owner) for owner in owners.get(name, [name])}}
    assert not missing, f"{image}/requirements.txt lacks what its sources import"
    assert foreign, "the graph sees what is imported"


def with_dependencies(wanted: list[Requirement]) -> set[str]:
    """Returns the names of the required distributions and of all that they depend on, directly or indirectly."""
    found: set[str] = set()
    seen: set[tuple[str, str]] = set()
    todo = [(each.name, extra) for each in wanted for extra in {"", *each.extras}]
    while todo:
        name, extra = todo.pop()
        if (normal(name), extra) in seen:
            continue
        seen.add((normal(name), extra))
        found.add(normal(name))
        try:
            needs = importlib.metadata.requires(name) or []
        except importlib.metadata.PackageNotFoundError:  # needed only on another platform or with another database
            continue
        for each in map(Requirement, needs):
            if each.marker is None or each.marker.evaluate({"extra": extra}):
                todo += [(each.name, more) for more in {"", *each.extras}]
    return found
