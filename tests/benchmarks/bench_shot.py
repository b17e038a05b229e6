"""A shot through the farm: time to the first frame, and total time compared with that of its samples alone.

    python3 farm.py bench shot [--frames 250] [--shot camera|bodies|figure] [--slots 2,1] [--rounds 1] [--spp 1]

First the frames are rendered in one process from prepared parts, which gives the time of the samples. Then a farm with that many
slots renders them, from the request until the job is finished, while a client watches as the page does; both alternate, so that
other work on the machine affects both. The digests of some frames must agree. Targets: a first frame within 1 s, and all frames
within 1.1 times the samples' time.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import psutil
from websockets.sync.client import connect

from rayfarm.stage import OpenScene
from renderer.film import digest
from renderer.render import render_batch, variant_for, warm_up
from renderer.scene.animation import Moment
from renderer.scene.compiled import CompiledScene, load
from renderer.scene.compiled_parts import Saver
from renderer.scene.load import Shot
from renderer.settings import RenderSettings, Tile, View
from tests.benchmarks.bench_frames import SHOTS, still_set
from tests.helpers import ROOT, Farm, start_farm, stop_farm

TRIANGLES = 20_000  # of static geometry
SIZE = {"width": 480, "height": 270}
LOOKED_AT = 3  # number of frames whose digests are compared


class Taken(NamedTuple):
    """Times of one rendered shot.

    These are the seconds from the request to the first frame and to the last, and the processor seconds of each part of the farm.
    """

    first: float
    all: float
    processor: dict[str, float]

    @property
    def sum(self) -> float:
        """Processor seconds of all parts of the farm together."""
        return sum(self.processor.values())


def main() -> None:
    """Measures and prints the results."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--frames", type=int, default=250)
    parser.add_argument("--shot", choices=[name for name in SHOTS if name != "morph"], default="camera")
    parser.add_argument("--slots", default="2,1")
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--spp", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="rayfarm-bench-") as name:
        folder = Path(name)
        (folder / "scene").mkdir()
        (folder / "scene" / "shot.glb").write_bytes(SHOTS[options.shot][0](still_set(TRIANGLES)).glb())
        frames = compile_frames(folder, options.frames)
        warm_up(frames[0][1], variant_for(frames[0][1], frames[0][0]))
        walls: dict[int, list[float]] = {}
        print(f"{SHOTS[options.shot][2]}: {options.frames} frames at {SIZE['width']}x{SIZE['height']}, {options.spp} spp")
        for slots in map(int, options.slots.split(",")):
            with running(folder / f"{slots}-slots", slots) as farm:
                scene = ready_scene(farm, folder / "scene" / "shot.glb")
                for _ in range(options.rounds):
                    alone = samples_alone(frames, slots, options.spp)
                    taken, digests = render_on_farm(farm, scene, options.frames, options.spp)
                    walls.setdefault(slots, []).append(taken.all)
                    check(frames, digests, options.spp)
                    print(report(slots, alone, taken, options.frames), flush=True)
        if len(walls) > 1:
            (most, fewest) = max(walls), min(walls)
            print(f"{most} slots against {fewest}: {min(walls[fewest]) / min(walls[most]):.2f} times as fast")


def report(slots: int, alone: tuple[float, float], taken: Taken, frames: int) -> str:
    """Returns the comparison of the farm with rendering in one process, as lines of text.

    alone: (wall, processor) seconds of the samples without a farm. taken: times of the shot on the farm.
    """
    wall, processor = alone
    by = ", ".join(f"{name} {seconds:.1f}" for name, seconds in taken.processor.items())
    beside = 1000 * (taken.sum - processor) / frames
    return "\n".join(
        [
            f"with {slots} slot{'s' * (slots > 1)}",
            f"  first frame                   {taken.first:6.2f} s   (target < 1)",
            f"  all frames                    {taken.all:6.2f} s",
            f"  their samples alone           {wall:6.2f} s   with as many threads",
            f"  ratio                         {taken.all / wall:6.2f}     (target <= 1.1)",
            f"  the same by processor time    {taken.sum / processor:6.2f}     {taken.sum:.1f} s against {processor:.1f}: "
            f"{beside:.1f} ms a frame beside the samples",
            f"  of the processor, s           {by}",
        ]
    )


def compile_frames(folder: Path, count: int) -> list[tuple[CompiledScene, RenderSettings]]:
    """Compiles the scene of each of the first `count` frames in parts, as a farm does; returns each with its render settings."""
    stage, out = OpenScene(Shot(folder / "scene", "shot.glb")), folder / "parts"
    out.mkdir()
    saver = Saver(out)
    found: list[tuple[CompiledScene, RenderSettings]] = []
    shown: CompiledScene | None = None
    for frame in range(count):
        compiled, summary = stage.scene_at(Moment(frame))
        if compiled is not shown:
            assert stage._kept is not None
            assert stage._kept.cuts is not None
            mapped = load(saver.save(compiled, stage._kept.cuts), lambda sha256, size: out / sha256)
        shown = compiled
        view = {name: value for name, value in summary["cameras"][0]["view"].items() if value is not None}
        found.append((mapped, RenderSettings(**SIZE, view=View.from_json(view))))
    return found


def samples_alone(frames: list[tuple[CompiledScene, RenderSettings]], threads: int, spp: int) -> tuple[float, float]:
    """Renders the frames in this process, one frame per thread; returns (wall seconds, processor seconds)."""
    whole = Tile(0, 0, SIZE["width"], SIZE["height"])
    begun = time.perf_counter(), time.process_time()
    with ThreadPoolExecutor(threads) as pool:
        for _ in pool.map(lambda each: render_batch(*each, whole, 0, spp).bad_count, frames):
            pass
    return time.perf_counter() - begun[0], time.process_time() - begun[1]


def render_on_farm(farm: Farm, scene: str, frames: int, spp: int) -> tuple[Taken, list[str]]:
    """Renders the frames as a job on the farm while a client watches; returns (times, digests of the first frames)."""
    before = processor(farm)
    with farm.client() as client:
        begun = time.perf_counter()
        job = client.submit(scene, frames=f"0-{frames - 1}", spp=spp, name="bench", **SIZE).id
        first = None
        with connect(f"ws{farm.url[4:]}/api/jobs/{job}/live", proxy=None, max_size=None) as socket:
            while True:
                message = socket.recv()
                if isinstance(message, bytes):
                    socket.send(json.dumps({"ack": int.from_bytes(message[4:8], "little")}))
                    first = first or time.perf_counter()
                    continue
                said = json.loads(message)
                if said["type"] == "state" and said["job"]["state"] in ("finished", "failed"):
                    assert said["job"]["state"] == "finished", said["job"]["error"]
                    break
        ended = time.perf_counter()
        after = processor(farm)
        taken = Taken((first or ended) - begun, ended - begun, {name: after[name] - before[name] for name in after})
        digests = [client.digest(job, frame) for frame in range(min(LOOKED_AT, frames))]
    return taken, digests


def check(frames: list[tuple[CompiledScene, RenderSettings]], digests: list[str], spp: int) -> None:
    """Asserts that the farm's digests of these frames equal those of renders in this process."""
    whole = Tile(0, 0, SIZE["width"], SIZE["height"])
    for (compiled, settings), found in zip(frames, digests, strict=False):
        assert digest(render_batch(compiled, settings, whole, 0, spp).sums) == found


def processor(farm: Farm) -> Counter[str]:
    """Returns processor seconds by part of the farm, including ended children."""
    found: Counter[str] = Counter()
    for name, pid in farm.pids().items():
        with_children = [psutil.Process(pid), *psutil.Process(pid).children(recursive=True)]
        for process in with_children:
            found[name] += sum(process.cpu_times()[:4])
    return found


def ready_scene(farm: Farm, path: Path) -> str:
    """Uploads a scene, waits until it is ready, and returns its id."""
    with farm.client() as client:
        return client.wait_for_scene(client.upload([path]).id).id


@contextmanager
def running(data: Path, slots: int) -> Iterator[Farm]:
    """Runs a farm in the `with` block."""
    farm = start_farm(data, slots)
    try:
        yield farm
    finally:
        stop_farm(farm)


if __name__ == "__main__":
    os.chdir(ROOT)
    main()
