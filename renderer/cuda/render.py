"""Renders batches on one graphics card."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.arrays.scene import CompiledScene
from renderer.bvh.compress import compressed
from renderer.bvh.layout import Bvh
from renderer.cuda.artefacts import ptx_of
from renderer.cuda.driver import LIBRARY, Card, Device, Driver, DriverError, Kernel
from renderer.cuda.job import job_for, packed
from renderer.errors import MachineError, SceneError
from renderer.film import Sums
from renderer.kernel.accumulate import Batch
from renderer.kernel.backends.cuda.megakernel import BAD, RAYS, Job
from renderer.kernel.backends.cuda.ptx import KERNEL, THREADS
from renderer.kernel.camera import Camera
from renderer.kernel.options import Options
from renderer.sentences import Sentence
from renderer.threads import Team

__all__ = ["CardError", "CardMemoryError", "CardRenderer", "Rendered"]

_LEAST_THREADS = 1 << 18  # fewer leave a card idle
_MOST_SAMPLES = 1 << 22  # of a launch, so that none runs for seconds: a card with a screen ends such launches
_OUT_OF_MEMORY = "CUDA_ERROR_OUT_OF_MEMORY"
_PARAMETER = re.compile(rf"\b{KERNEL}_param_0\[(\d+)\]")


class CardError(MachineError):
    """Raised if a graphics card cannot render a scene, or fails while rendering it."""


class CardMemoryError(CardError):
    """Raised if a scene does not fit into a graphics card's memory."""


class Rendered(NamedTuple):
    """The sums of a batch that a graphics card rendered, and the numbers of rays and of samples that were not finite."""

    sums: Sums
    bad_count: int
    rays: int


class CardRenderer:
    """Renders batches on a graphics card; keeps the loaded kernels, and the arrays of the last scene, in its memory.

    Used by one thread at a time; must be closed.
    """

    def __init__(self, card: Card, library: str = LIBRARY) -> None:
        self.card = card
        self._device = Device(Driver(library), card.number)
        self._kernels: dict[str, tuple[Kernel, int]] = {}  # of a variant: the kernel, and the size of its jobs
        # The arrays in the card's memory by their place in the CPU's. They are kept, so that no other array takes their place.
        self._arrays: dict[tuple[int, int], tuple[npt.NDArray[Any], int]] = {}
        self._tree: tuple[Bvh, Bvh] | None = None  # of the last scene: the CPU's, and the compressed one

    def has_kernel(self, variant: str) -> bool:
        """Returns True if the kernel of a variant is loaded."""
        return variant in self._kernels

    def load(self, variant: str, fetch: Callable[[str], None] | None = None) -> None:
        """Loads a variant's kernel on the graphics card, after building it if necessary.

        fetch: as for `ptx_of`. Raises CardError if that fails.
        """
        try:
            self._kernel(variant, fetch)
        except DriverError as error:
            raise CardError(
                Sentence(
                    "card-error",
                    "card {number} ({name}) failed: {error}",
                    number=self.card.number,
                    name=self.card.name,
                    error=error,
                )
            ) from error

    def render(
        self, scene: CompiledScene, variant: str, camera: Camera, options: Options, batch: Batch, width: int, height: int
    ) -> Rendered:
        """Renders a batch of a tile of width x height pixels. Raises CardError if that fails.

        scene: in the form that the variant's kernels expect (`strip_absent_features`).
        """
        try:
            return self._render(scene, variant, camera, options, batch, width, height)
        except DriverError as error:
            number, name = self.card.number, self.card.name
            if error.code == _OUT_OF_MEMORY:
                size = self.card.memory / 2**30
                raise CardMemoryError(
                    Sentence(
                        "card-out-of-memory",
                        "card {number} ({name}) has too little memory, {gib} GiB, for this scene",
                        number=number,
                        name=name,
                        gib=f"{size:.0f}",
                    )
                ) from error
            raise CardError(
                Sentence("card-error", "card {number} ({name}) failed: {error}", number=number, name=name, error=error)
            ) from error

    def close(self) -> None:
        """Frees the memory and kernels on the graphics card."""
        self._arrays.clear()
        self._tree = None
        self._device.close()

    def _render(
        self, scene: CompiledScene, variant: str, camera: Camera, options: Options, batch: Batch, width: int, height: int
    ) -> Rendered:
        kernel, size = self._kernel(variant)
        job = job_for(scene._replace(bvh=self._compressed(scene.bvh)), camera, options, batch, width, height)
        self._free_others(job)
        results: dict[int, int] = {}

        def device_address(array: npt.NDArray[Any]) -> int:
            if array is job.film or array is job.counters:
                if id(array) not in results:
                    results[id(array)] = self._device.upload(array)
                return results[id(array)]
            key = array.ctypes.data, array.nbytes
            if key not in self._arrays:
                self._arrays[key] = array, self._device.upload(array)
            return self._arrays[key][1]

        try:
            pixels = width * height
            step = max(1, _MOST_SAMPLES // max(pixels, 1))
            for first in range(batch.first, batch.first + batch.count, step):
                count = min(step, batch.first + batch.count - first)
                pieces = min(count, max(1, _LEAST_THREADS // max(pixels, 1)))
                part = job._replace(batch=batch._replace(first=first, count=count), pieces=np.int64(pieces))
                data = packed(part, device_address)
                if len(data) != size:
                    raise AssertionError(f"a job has {len(data)} bytes, and its kernel takes {size}")
                threads = pixels * pieces
                self._device.launch(kernel, -(-threads // THREADS), THREADS, [data, threads.to_bytes(8, "little")])
            self._device.synchronize()
            for array in (job.film, job.counters):
                self._device.download(results[id(array)], array)
        finally:
            for address in results.values():
                self._device.free(address)
        return Rendered(job.film, int(job.counters[BAD]), int(job.counters[RAYS]))

    def _compressed(self, bvh: Bvh) -> Bvh:
        """Returns the tree `bvh` in compressed form; the result is kept until another tree is passed."""
        if self._tree is None or not all(_is_same(a, b) for a, b in zip(self._tree[0], bvh, strict=True)):
            self._tree = None
            with Team() as team:
                try:
                    self._tree = bvh, compressed(bvh, team)
                except SceneError as error:
                    raise CardError(f"card {self.card.number} ({self.card.name}) cannot render this scene: {error}") from error
        return self._tree[1]

    def _free_others(self, job: Job) -> None:
        """Frees the arrays in GPU memory that the job does not use."""
        used: set[tuple[int, int]] = set()

        def record_use(array: npt.NDArray[Any]) -> int:
            used.add((array.ctypes.data, array.nbytes))
            return 0

        packed(job, record_use)
        for key in self._arrays.keys() - used:
            self._device.free(self._arrays.pop(key)[1])

    def _kernel(self, variant: str, fetch: Callable[[str], None] | None = None) -> tuple[Kernel, int]:
        if variant not in self._kernels:
            ptx = ptx_of(variant, fetch)
            size = _PARAMETER.search(ptx)
            assert size is not None
            self._kernels[variant] = self._device.load(ptx, KERNEL), int(size[1])
        return self._kernels[variant]


def _is_same(a: Any, b: Any) -> bool:
    """Returns True if two fields of trees are the same object, or arrays at the same memory address."""
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return bool(a.ctypes.data == b.ctypes.data and a.shape == b.shape)
    return a is b
