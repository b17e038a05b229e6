"""Tests that the kernel for graphics cards renders films that are bit-identical to the CPU kernel's.

The LLVM code that becomes PTX is run on the CPU.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from renderer.bvh.compress import compressed
from renderer.cuda.job import job_for, packed
from renderer.kernel.accumulate import Batch
from renderer.kernel.backends.cuda.megakernel import BAD, RAYS, Job
from renderer.kernel.camera import camera_frame
from renderer.kernel.options import kernel_options
from renderer.render import RenderStats, _prepared, render_frame, variant_for
from renderer.scene.origin import fixed_point_origin, settings_relative_to_origin
from renderer.threads import Team
from tests.grids import grid
from tests.renderer.cuda.on_host import launcher
from tests.renderer.kernel.backends.features import FEATURES, made

SPP = 4
ORDINARY = ("diffuse", "glass", "metal and plastic", "no triangles", "a sky's picture", "a lens")


def job_of(name: str, pieces: int, first: int = 0, count: int = SPP) -> Job:
    scene, settings = made(name)
    prepared = _prepared(scene, settings)
    camera, options = camera_frame(settings_relative_to_origin(settings, prepared.origin)), kernel_options(settings, prepared)
    batch = Batch(0, 0, first, count, fixed_point_origin(prepared.origin, settings.film_exponent))
    with Team(1) as team:
        on_card = prepared._replace(bvh=compressed(prepared.bvh, team))
    return job_for(on_card, camera, options, batch, settings.width, settings.height, pieces)


def run(name: str, job: Job) -> None:
    """Runs the kernel of the variant `name`, which adds the job's samples to the job's film."""
    scene, settings = made(name)
    data = np.frombuffer(packed(job, lambda array: array.ctypes.data), np.uint8).copy()
    launcher(variant_for(settings, scene))(data.ctypes.data, settings.width * settings.height * int(job.pieces))


def of_cpu(name: str) -> tuple[npt.NDArray[np.int64], RenderStats]:
    stats = RenderStats()
    return render_frame(*made(name), SPP, stats=stats), stats


@grid("name", FEATURES, ordinary=ORDINARY)
def test_gpu_kernel_film_equals_the_cpu_film(name: str) -> None:
    job = job_of(name, pieces=1)
    run(name, job)
    film, stats = of_cpu(name)
    assert (job.film != film).any(0).sum() == 0
    assert job.counters[RAYS] == stats.rays
    assert job.counters[BAD] == 0


@pytest.mark.parametrize("pieces", (2, 3, 9))
def test_samples_of_a_pixel_are_divided_among_threads(pieces: int) -> None:
    job = job_of("diffuse", pieces)
    run("diffuse", job)
    assert (job.film == of_cpu("diffuse")[0]).all()


def test_kernel_adds_to_an_existing_film() -> None:
    whole, job = job_of("diffuse", 1), job_of("diffuse", 1, count=1)
    run("diffuse", whole)
    run("diffuse", job)
    rest = job_of("diffuse", 2, first=1, count=SPP - 1)
    run("diffuse", rest._replace(film=job.film))
    assert (job.film == whole.film).all()
