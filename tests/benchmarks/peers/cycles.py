"""Row `cycles`: a GLB file of textured objects in a white world, rendered by Cycles and by Rayfarm.

Cycles' preparation is not counted: it caches its scene between pictures, and the time of one sample is subtracted.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from renderer.image.read import read as read_image
from renderer.scene.load import read
from tests.benchmarks.peers.asking import Peer
from tests.benchmarks.peers.contestants import Rayfarm
from tests.benchmarks.peers.files import textured_objects
from tests.benchmarks.peers.measure import Line, Taken, error_line, race, ratio_line, relative_error, taken
from tests.benchmarks.peers.references import OURS, References
from tests.benchmarks.peers.scenes import DEPTH, Case
from tests.benchmarks.peers.sizes import Sizes
from tests.benchmarks.peers.surroundings import python_with_bpy

__all__ = ["cycles_lines"]

_NAME = "textured objects"
_SAMPLES, _ERROR = "samples a second", "error in the same time"
_WHITE = (1.0, 1.0, 1.0)
_ONES = 5  # pictures of one sample; the fastest is subtracted


def cycles_lines(sizes: Sizes, folder: Path, kept: Path | None = None) -> Iterator[Line]:
    """Compares Rayfarm with Cycles; yields a line for samples per second and one for the error at equal time.

    kept: folder of converged pictures, reused between runs.
    """
    if not (sizes.wants(_SAMPLES) or sizes.wants(_ERROR)):
        return
    glb = textured_objects(folder / "objects.glb", sizes.small_mesh // 8, sizes.texture)
    description = read(folder, glb.name)
    case = Case(_NAME, description, description.cameras[0].view)
    ours, references = Rayfarm(case, sizes.picture, environment=_WHITE), References(sizes, kept)
    spp = sizes.spp
    with Peer(python_with_bpy(), "cycles_peer") as cycles:
        told = {"glb": str(glb), "max_depth": DEPTH, "sky": _WHITE}
        version = cycles.ask("load", size=sizes.picture, **told)["version"]

        def picture(count: int, seed: int) -> np.ndarray:
            path = folder / "cycles.exr"
            cycles.ask("render", samples=count, seed=seed, exr=str(path))
            return read_image(path.read_bytes(), path.name)[..., :3]

        def they(seed: int) -> Taken:
            """Returns Cycles' time for `spp` samples: the time of a render of 1 + spp samples, minus that of one sample."""
            took = cycles.ask("render", samples=1 + spp, seed=seed)
            return Taken(took["wall"] - one["wall"], took["cpu"] - one["cpu"])

        plain = Rayfarm(case, sizes.picture, environment=_WHITE, splitting=1)  # splitting 1 does the same work as Cycles
        plain.picture(1, 0)
        ours.picture(1, 0)
        picture(1, 0)
        ones = [cycles.ask("render", samples=1, seed=seed) for seed in range(_ONES)]
        one = {clock: min(took[clock] for took in ones) for clock in ("wall", "cpu")}
        run = race(lambda number: taken(lambda: plain.picture(spp, 1 + number)), they, sizes.rounds)
        own = race(lambda number: taken(lambda: ours.picture(spp, 1 + number)), they, sizes.rounds)
        total = sizes.picture**2 * spp / 1e6
        rates = [[total / seconds for seconds in side] for side in run.seconds]
        notes = {"cpu_ratio": run.cpu_ratio, "version": version}
        yield ratio_line("cycles", _SAMPLES, run.ratios, "M samples/s", *rates, **notes)

        in_time = max(1, round(spp * statistics.median(own.ratios)))
        seeds = range(1, 1 + sizes.rounds)
        cycles.ask("load", size=sizes.error_picture, **told)
        truth = references.of(_NAME, f"cycles {version}", picture)
        peers = [relative_error(picture(spp, seed), truth) for seed in seeds]
    ours = Rayfarm(case, sizes.error_picture, environment=_WHITE)
    truth = references.of(_NAME, OURS, ours.picture)
    errors = [relative_error(ours.picture(in_time, seed), truth) for seed in seeds]
    yield error_line("cycles", _ERROR, errors, peers, our_samples=in_time, peer_samples=spp)
