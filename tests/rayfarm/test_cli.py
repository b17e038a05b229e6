"""Tests of the command line: help texts, pictures, error messages, exit codes."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from PIL import Image

from rayfarm import cli, options
from renderer import __version__
from renderer.denoise import is_available
from renderer.errors import RayfarmError
from tests.grids import grid
from tests.helpers import ROOT, wait_until
from tests.rayfarm.program import rayfarm, run_program

CORNELL = ROOT / "scenes" / "cornell-box.yaml"


def read(path: Path) -> tuple[np.ndarray, list[str]]:
    file = oiio.ImageInput.open(str(path))
    try:
        return file.read_image(), list(file.spec().channelnames)
    finally:
        file.close()


def test_help_is_well_formatted() -> None:
    """Help texts are well formatted.

    Paragraphs fill the line, examples are indented, flags have no value, no placeholder is a Python type, and the panels of
    options are in order.
    """
    watch = rayfarm("watch", "--help").stdout
    assert "In a pipe it prints lines until the job ends." in " ".join(watch.split())
    assert not any(line.split() == ["ends."] for line in watch.splitlines())
    assert "\n   rayfarm info truck.glb" in rayfarm("info", "--help").stdout
    submit = rayfarm("submit", "--help").stdout
    assert "SCENE" in submit
    assert not [word for word in ("<bool>", "<int", "<float", "<path>") if word in submit]
    panels = [panel for panel in options.PANELS if panel not in (options.PART, options.MACHINE)]  # render alone has these
    assert re.findall(r"╭─ (.+?) ─", submit) == ["Arguments", "Options", *panels]


def test_version_is_printed() -> None:
    assert rayfarm("--version").stdout == f"rayfarm {__version__}\n"


@pytest.mark.parametrize(
    ("words", "imported"),
    [
        (["worker", "--join", "up"], ("worker",)),
        (["--debug", "restore", "x"], ("backup",)),
        (["wrker"], cli.COMMANDS),
        (["--help", "up"], cli.COMMANDS),
        ([], cli.COMMANDS),
    ],
)
def test_only_requested_command_is_imported(words: list[str], imported: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["rayfarm", *words])
    assert cli._commands_to_import() == imported


@pytest.mark.long
@grid("suffix", ["png", "jpg", "exr", "hdr"], ordinary=("exr",))
def test_render_writes_every_format(tmp_path: Path, suffix: str) -> None:
    picture = tmp_path / f"cornell.{suffix}"
    program = run_program if suffix == "png" else rayfarm
    done = program("render", CORNELL, "-o", picture, "--size", "24x16", "--spp", "4", "--max-depth", "3")
    assert done.returncode == 0, done.stderr
    if suffix in ("png", "jpg"):
        with Image.open(picture) as image:
            assert image.size == (24, 16)
            assert np.asarray(image).max() > 50
    else:
        pixels, _ = read(picture)
        assert pixels.shape[:2] == (16, 24)
        assert pixels.max() > 1.0  # the lamp is brighter than white, since the file is scene-linear


def test_render_is_equal_for_any_number_of_threads(tmp_path: Path) -> None:
    for threads in (1, 2):
        done = rayfarm(
            "render", CORNELL, "-o", tmp_path / f"{threads}.exr", "--size=32x32", "--spp=4", f"--threads={threads}",
            "--aov=all", "--stats", tmp_path / "stats.json",
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
    one, names = read(tmp_path / "1.exr")
    two, _ = read(tmp_path / "2.exr")
    assert np.array_equal(one, two)
    assert {"R", "Denoising Albedo.R", "Normal.X", "Depth.Z", "IndexOB.X", "Standard Error.X"} <= set(names)
    assert (one[..., names.index("Debug Sample Count.X")] == 4).all()
    ids = one[..., names.index("IndexMA.X")]
    assert np.array_equal(ids, np.rint(ids))
    assert len(np.unique(ids)) >= 3, "the box has a white, a red and a green material"
    stats = json.loads((tmp_path / "stats.json").read_text())
    assert stats["samples"] == 32 * 32 * 4
    assert {"load_s", "build_s", "compile_s", "render_s", "samples_per_s", "peak_memory_bytes"} <= set(stats)


@pytest.mark.long
@pytest.mark.skipif(not is_available(), reason="Open Image Denoise is not installed")
def test_denoised_picture_is_written_next_to_raw_one(tmp_path: Path) -> None:
    common = ["render", str(CORNELL), "--size=48x48", "--spp=4"]
    assert rayfarm(*common, "-o", tmp_path / "plain.exr").returncode == 0
    done = rayfarm(*common, "-o", tmp_path / "picture.exr", "--denoise", "--aov=depth")
    assert done.returncode == 0, done.stderr
    raw, names = read(tmp_path / "picture.exr")
    clean, clean_names = read(tmp_path / "picture-denoised.exr")
    assert np.array_equal(raw[..., :3], read(tmp_path / "plain.exr")[0]), "the raw picture is what it is without --denoise"
    assert names == clean_names
    assert np.abs(np.diff(clean[..., 0])).mean() < np.abs(np.diff(raw[..., 0])).mean()


@pytest.mark.long
def test_tile_and_sample_range_are_part_of_picture(tmp_path: Path) -> None:
    """A tile and a range of samples, as in the command of a failed batch, are parts whose sum equals the picture."""
    common = ["render", str(CORNELL), "--size=32x32"]
    assert rayfarm(*common, "-o", tmp_path / "whole.exr", "--spp=4").returncode == 0
    for first in (0, 2):
        done = rayfarm(*common, "-o", tmp_path / f"part{first}.exr", "--tile=8,8,16,16", f"--first={first}", "--spp=2")
        assert done.returncode == 0, done.stderr
    whole, _ = read(tmp_path / "whole.exr")
    parts = [read(tmp_path / f"part{first}.exr")[0] for first in (0, 2)]
    np.testing.assert_allclose((parts[0] + parts[1])[8:24, 8:24] / 2, whole[8:24, 8:24], rtol=1e-5, atol=1e-6)
    assert not parts[0][:8].any()


@pytest.mark.long
def test_picture_without_bvh_is_equal(tmp_path: Path) -> None:
    for name, more in (("tree", []), ("brute", ["--no-bvh"])):
        done = rayfarm("render", CORNELL, "-o", tmp_path / f"{name}.exr", "--size=32x32", "--spp=2", *more)
        assert done.returncode == 0, done.stderr
    assert np.array_equal(read(tmp_path / "tree.exr")[0], read(tmp_path / "brute.exr")[0])


@pytest.mark.long
def test_bvh_benchmark_times_four_runs_of_one_picture() -> None:
    done = rayfarm("bench", "bvh", "--json", "--size=16x9", "--scene", ROOT / "scenes" / "still-life.yaml")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert [row["bvh"] for row in found["rows"]] == [False, False, True, True]
    assert len({row["digest"] for row in found["rows"]}) == 1
    assert found["counts"]["triangles"] > 10_000
    # Tests that the tree is used at all, not its speed: each ray tests 1/1000 of the triangles.
    assert found["rows"][2]["seconds"] < found["rows"][0]["seconds"] / 10
    table = rayfarm("bench", "bvh", "--size=16x16", "--scene", CORNELL)
    assert "the same to the bit" in table.stdout
    assert "Take a smaller --size" in rayfarm("bench", "bvh", "--patience=0.0001", "--scene", CORNELL).stderr


@pytest.mark.long
def test_traced_path_equals_film_sample(tmp_path: Path) -> None:
    common = ["render", str(CORNELL), "--size=16x16"]
    done = rayfarm(*common, "-o", tmp_path / "one.exr", "--tile=5,9,1,1", "--first=3", "--spp=1")
    assert done.returncode == 0, done.stderr
    pixels, _ = read(tmp_path / "one.exr")
    found = json.loads(rayfarm(*common, "--pixel=5,9", "--sample=3", "--json").stdout)
    assert (found["pixel"], found["sample"]) == ([5, 9], 3)
    np.testing.assert_allclose(found["value"], pixels[9, 5, :3], rtol=1e-5, atol=2.0**-23)
    assert len(found["vertices"]) >= 2
    shown = rayfarm(*common, "--pixel=5,9", "--sample=3", COLUMNS="240")
    assert shown.returncode == 0, shown.stderr
    assert "Sample 3 of pixel 5,9:" in shown.stdout
    assert str(found["vertices"][0]["material"]) in shown.stdout
    assert "counted from 0" in rayfarm(*common, "--pixel=16,0").stderr
    assert "--pixel X,Y" in rayfarm(*common, "-o", "x.png", "--sample=3").stderr


def test_info_prints_text_and_json() -> None:
    done = rayfarm("info", CORNELL)
    counts = next(line for line in done.stdout.splitlines() if line.startswith("Holds")).removeprefix("Holds").split(",")
    assert all(part.strip().endswith("s") != part.strip().startswith("1 ") for part in counts), counts
    assert done.returncode == 0, done.stderr
    assert "front" in done.stdout
    summary = json.loads(rayfarm("info", CORNELL, "--json").stdout)
    assert summary["counts"]["triangles"] == 36
    assert summary["cameras"][0]["name"] == "front"


@grid(
    ("arguments", "code", "sentence"),
    [
        (["render", "missing.glb", "-o", "out.png"], 1, "There is no file missing.glb"),
        (["render", str(CORNELL), "-o", "out.gif"], 1, "written as .png"),
        (["render", str(CORNELL), "-o", "nowhere/out.png"], 1, "There is no folder nowhere"),
        (["render", str(CORNELL), "-o", "out.png", "--size", "big"], 1, "as --size 1920x1080"),
        (["render", str(CORNELL), "-o", "out.png", "--size", "0x10"], 1, "width is 0"),
        (["render", str(CORNELL), "-o", "out.png", "--camera", "side"], 1, "--camera is 'side'"),
        (["render", str(CORNELL), "-o", "out.png", "--integrator", "magic"], 1, "integrator is 'magic'"),
        (["render", str(CORNELL), "-o", "out.png", "--aov", "albedo"], 1, "--aov needs an .exr"),
        (["render", str(CORNELL), "-o", "out.exr", "--aov", "mood"], 1, "aov 'mood' is not known"),
        (["render", str(CORNELL), "-o", "out.png", "--size=8x8", "--tile=4,4,8,8"], 1, "--tile reaches out"),
        (["render", str(CORNELL), "-o", "out.png", "--env", "sky.exr"], 1, "no such file"),
        (["render", str(CORNELL), "-o", "out.png", "--spp", "0"], 2, "--spp"),
        (["render", str(CORNELL), "--width", "300"], 2, "No such option: --width. Use --size 1280x720."),
        (["render", str(CORNELL), "--sampels", "3"], 2, "No such option: --sampels. Use --spp."),
        (["gc", "--films-above", "inf"], 2, "inf is not a finite number"),
        (["watch", "--frame", "nan"], 2, "nan is not a finite number"),
        (["info", "README.docx"], 1, "There is no file"),
        (["jobs", "--server", "http://127.0.0.1:9"], 1, "No farm answers at http://127.0.0.1:9"),
        (["submit", str(CORNELL), "--server", "http://127.0.0.1:9"], 1, "Start one with `rayfarm up`"),
        (["submit", str(CORNELL), "--size", "big", "--server", "http://127.0.0.1:9"], 1, "as --size 1920x1080"),
        (
            ["worker", "--join", "http://127.0.0.1:9"],
            1,
            "A worker needs the farm's token. Set RAYFARM_TOKEN to it, or write it into a file and give --token-file",
        ),
        (["worker", "--join", "http://127.0.0.1:9", "--token-file", sys.executable], 1, "contains no token"),
        (["up", "--no-browser", "--host", "203.0.113.7"], 1, "is not an address of this machine"),
    ],
)
def test_errors_print_one_sentence_and_exit_code(tmp_path: Path, arguments: list[str], code: int, sentence: str) -> None:
    done = rayfarm(*arguments, RAYFARM_DATA=str(tmp_path / "data"), RAYFARM_TOKEN="")
    assert done.returncode == code, done.stderr
    assert sentence in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr


def test_debug_option_shows_traceback() -> None:
    with pytest.raises(RayfarmError, match=r"missing\.glb"):  # the exception that Python shows
        rayfarm("--debug", "render", "missing.glb", "-o", "out.png")


def test_damaged_file_prints_error_message(tmp_path: Path) -> None:
    (tmp_path / "noise.glb").write_bytes(b"glTF" + bytes(range(256)))
    done = rayfarm("info", tmp_path / "noise.glb")
    assert done.returncode == 1
    assert "noise.glb" in done.stderr
    assert "Traceback" not in done.stderr


def test_ctrl_c_ends_render_without_partial_file(tmp_path: Path) -> None:
    picture = tmp_path / "long.png"
    command = [sys.executable, "-m", "rayfarm", "render", str(CORNELL), "-o", str(picture), "--spp=100000", "--threads=1"]
    process = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True)
    import psutil

    wait_until(lambda: sum(psutil.Process(process.pid).cpu_times()[:2]) > 3, 60, "it renders")
    begun = time.monotonic()
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=20)
    assert process.returncode == 130
    assert time.monotonic() - begun < 10
    assert "Traceback" not in said
    assert list(tmp_path.iterdir()) == []
