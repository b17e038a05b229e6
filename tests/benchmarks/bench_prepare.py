"""Time and peak memory from a GLB file to a scene that is ready to render.

    python -m tests.benchmarks.bench_prepare [TRIANGLES] [ROUNDS]

The file is a generated displaced sphere with normals and UVs. Time is processor time, which depends less on other work of the
machine than wall time; memory is the process' peak minus its initial use.
"""

from __future__ import annotations

import argparse
import json
import struct
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from renderer.arrays.scene import flat
from renderer.preparation_kernels import prepare
from renderer.render import warm_up
from renderer.scene.compile import compile_scene, summarise
from renderer.scene.load import read


def _write(path: Path, triangles: int) -> None:
    rows = int((triangles / 4) ** 0.5)
    columns = 2 * rows
    v, u = np.mgrid[0 : rows + 1, 0 : columns + 1]
    theta, phi = np.pi * v / rows, 2 * np.pi * u / columns
    radius = 1 + 0.05 * np.sin(9 * phi) * np.sin(7 * theta) + 0.01 * np.sin(60 * phi) * np.sin(50 * theta)
    normal = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)], -1)
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    upper = np.stack([corner, corner + 1, corner + columns + 1], -1)
    lower = np.stack([corner + 1, corner + columns + 2, corner + columns + 1], -1)
    arrays: list[tuple[Any, str, int]] = [
        ((radius[..., None] * normal).reshape(-1, 3).astype("<f4"), "VEC3", 5126),
        (normal.reshape(-1, 3).astype("<f4"), "VEC3", 5126),
        (np.stack([u / columns, v / rows], -1).reshape(-1, 2).astype("<f4"), "VEC2", 5126),
        (np.stack([upper, lower], 1).reshape(-1, 1).astype("<u4"), "SCALAR", 5125),
    ]
    offsets = np.cumsum([0] + [a.nbytes for a, _, _ in arrays]).tolist()
    attributes = {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2}
    described = {
        "asset": {"version": "2.0"},
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 3}]}],
        "accessors": [
            {"bufferView": i, "componentType": component, "count": len(a), "type": kind}
            for i, (a, kind, component) in enumerate(arrays)
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": at, "byteLength": a.nbytes} for at, (a, _, _) in zip(offsets, arrays, strict=False)
        ],
        "buffers": [{"byteLength": offsets[-1]}],
    }
    text = json.dumps(described).encode()
    text += b" " * (-len(text) % 4)
    with path.open("wb") as file:
        file.write(struct.pack("<III", 0x46546C67, 2, 28 + len(text) + offsets[-1]))
        file.write(struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", offsets[-1], 0x004E4942))
        for array, _, _ in arrays:
            file.write(array.tobytes())


def _memory(what: str) -> int:
    """Returns a memory figure of this process in bytes: current (VmRSS) or peak (VmHWM)."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) << 10 for line in lines if line.startswith(what))


def main() -> None:
    """Prints a line for each round."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("triangles", nargs="?", type=int, default=1_000_000, help="about so many; a million unless told")
    parser.add_argument("rounds", nargs="?", type=int, default=5, help="five unless told")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        _write(Path(folder) / "sphere.glb", given.triangles)
        warm_up()
        prepare()
        for _ in range(given.rounds):
            Path("/proc/self/clear_refs").write_text("5")  # resets VmHWM
            before, wall, processor = _memory("VmRSS"), time.perf_counter(), time.process_time()
            description = read(Path(folder), "sphere.glb")
            compiled = compile_scene(description)
            summarise(description, compiled)
            wall, processor = time.perf_counter() - wall, time.process_time() - processor
            count = len(compiled.triangle)
            kept = sum(array.nbytes for array in flat(compiled).values()) / count
            most = (_memory("VmHWM") - before) / count
            print(
                f"{count} triangles: {wall:.2f} s, {processor:.2f} s of the processor; "
                f"{most:.0f} bytes a triangle at most, {kept:.0f} kept"
            )
            del description, compiled


if __name__ == "__main__":
    main()
