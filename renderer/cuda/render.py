"""Renders batches on one graphics card."""

from __future__ import annotations

import contextlib
import re
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.arrays.scene import CompiledScene
from renderer.bvh.compress import compressed
from renderer.bvh.layout import Bvh
from renderer.cuda.artefacts import ptx_of
from renderer.cuda.driver import LIBRARY, Card, Device, Driver, DriverError, Kernel
from renderer.cuda.job import bytes_per_path, wave_for
from renderer.cuda.turns import paths_for, take_turns
from renderer.errors import MachineError, SceneError
from renderer.film import Sums
from renderer.kernel.accumulate import Batch
from renderer.kernel.backends.cuda.ptx import THREADS
from renderer.kernel.backends.cuda.wavefront import ACTIVE, BAD, RAYS, Wave
from renderer.kernel.camera import Camera
from renderer.kernel.draft import SMOOTHING_PASSES
from renderer.kernel.options import Options
from renderer.reference import packed
from renderer.sentences import Sentence
from renderer.threads import Team

__all__ = ["CardError", "CardMemoryError", "CardRenderer", "Rendered"]

_KEPT = "film", "draft", "draft_light", "draft_guides", "pool", "lists", "branches"  # fields of a Wave whose GPU memory is kept
_OUT_OF_MEMORY = "CUDA_ERROR_OUT_OF_MEMORY"
_ENTRY = re.compile(r"\.entry (\w+)\(")
_PARAMETER = re.compile(r"\b\w+_param_0\[(\d+)\]")


class CardError(MachineError):
    """Raised if a graphics card cannot render a scene, or fails while rendering it."""


class CardMemoryError(CardError):
    """Raised if a scene does not fit into a graphics card's memory."""


class Rendered(NamedTuple):
    """The sums of a batch that a graphics card rendered, and the numbers of rays and of samples that were not finite."""

    sums: Sums
    bad_count: int
    rays: int
    records: npt.NDArray[np.uint32]  # of Wave


class CardRenderer:
    """Renders batches on a graphics card; keeps the loaded kernels, and the arrays of the last scene, in its memory.

    Used by one thread at a time; must be closed. seconds: for measurements: each launch is waited for, and its time is added
    to its kernel's. most_paths: for measurements: largest number of paths of a batch that are under way at once.
    """

    def __init__(
        self, card: Card, library: str = LIBRARY, seconds: dict[str, float] | None = None, most_paths: int | None = None
    ) -> None:
        self.card = card
        self._most_paths = most_paths
        self._seconds = seconds
        self._device = Device(Driver(library), card.number)
        self._kernels: dict[str, tuple[dict[str, Kernel], int]] = {}  # of a variant: its kernels by name, and their wave's size
        # The arrays in the card's memory by their place in the CPU's. They are kept, so that no other array takes their place.
        self._arrays: dict[tuple[int, int], tuple[npt.NDArray[Any], int]] = {}
        self._kept: dict[str, tuple[int, int]] = {}  # of a Wave's field: the bytes of its array, and the address
        self._tree: tuple[Bvh, Bvh] | None = None  # of the last scene: the CPU's, and the compressed one

    def has_kernel(self, variant: str) -> bool:
        """Returns True if the kernels of a variant are loaded."""
        return variant in self._kernels

    def load(self, variant: str, fetch: Callable[[str], None] | None = None) -> None:
        """Loads a variant's kernels on the graphics card, after building them if necessary.

        fetch: as for `ptx_of`. Raises CardError if that fails.
        """
        try:
            self._loaded(variant, fetch)
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
        self,
        scene: CompiledScene,
        variant: str,
        camera: Camera,
        options: Options,
        batch: Batch,
        width: int,
        height: int,
        recorded: int = 0,
    ) -> Rendered:
        """Renders a batch of a tile of width x height pixels. Raises CardError if that fails.

        scene: in the form that the variant's kernels expect (`strip_absent_features`). recorded: as for `wave_for`.
        """
        with self._card_errors():
            return self._render(scene, variant, camera, options, batch, width, height, recorded)

    def render_draft(
        self,
        scene: CompiledScene,
        variant: str,
        camera: Camera,
        options: Options,
        batch: Batch,
        width: int,
        height: int,
        exposure: float,
        is_smooth: bool,
    ) -> npt.NDArray[np.uint32]:
        """Renders a batch as `render` does; returns its draft (renderer/kernel/draft.py), (height, width) uint32.

        Only the draft is copied from the card. exposure: of the draft, in stops. is_smooth: whether it is smoothed. Raises
        CardError.
        """
        with self._card_errors():
            paths, wave = self._wave(scene, options, batch, width, height, camera=camera, draft_exposure=exposure)
            with self._launched(wave, variant, paths) as own:
                kernels = ["prepare_draft", *["smooth_draft"] * (SMOOTHING_PASSES if is_smooth else 0), "encode_draft"]
                for number, kernel in enumerate(kernels, -1):
                    data = packed(wave._replace(draft_pass=np.int64(number)), self._addresses(own))
                    self._launch(variant, kernel, data, width * height)
                self._device.download(own[id(wave.draft)], wave.draft)
        return wave.draft

    @contextlib.contextmanager
    def _card_errors(self) -> Iterator[None]:
        """Context manager that raises the driver's errors as CardError."""
        try:
            yield
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
        self._kept.clear()
        self._tree = None
        self._device.close()

    def _render(
        self,
        scene: CompiledScene,
        variant: str,
        camera: Camera,
        options: Options,
        batch: Batch,
        width: int,
        height: int,
        recorded: int,
    ) -> Rendered:
        paths, wave = self._wave(scene, options, batch, width, height, camera=camera, recorded=recorded)
        with self._launched(wave, variant, paths) as own:
            return self._rendered(own, wave)

    def _wave(
        self, scene: CompiledScene, options: Options, batch: Batch, width: int, height: int, **more: Any
    ) -> tuple[int, Wave]:
        """Returns the rows for first branches of a batch's paths, and its Wave. more: as for `wave_for`."""
        paths = paths_for(width * height * batch.count, self.card.memory, bytes_per_path(scene, options), self._most_paths)
        scene = scene._replace(bvh=self._compressed(scene.bvh))
        return paths, wave_for(scene, options=options, batch=batch, width=width, height=height, paths=paths, **more)

    @contextlib.contextmanager
    def _launched(self, wave: Wave, variant: str, paths: int) -> Iterator[dict[int, int]]:
        """Context manager in which the kernels that render a Wave have been launched. Yields the GPU memory: id -> address."""
        self._free_others(wave)
        with self._results(wave.counters, wave.lengths, wave.records) as own:
            own.update(self._kept_memory(wave))
            self._device.clear(own[id(wave.film)], wave.film.nbytes)
            address = self._addresses(own)
            data = [packed(wave._replace(second=np.bool_(second)), address) for second in (False, True)]

            def count_active() -> int:
                self._device.download(own[id(wave.lengths)], wave.lengths)
                return int(wave.lengths[ACTIVE])

            def launch(kernel: str, threads: int, second: bool) -> None:
                self._launch(variant, kernel, data[second], threads)

            take_turns(launch, count_active, wave.scene, wave.options, paths)
            yield own

    @contextlib.contextmanager
    def _results(self, *arrays: npt.NDArray[Any]) -> Iterator[dict[int, int]]:
        """Context manager of the GPU memory of small arrays that a batch changes: id -> address, freed at the end."""
        own: dict[int, int] = {}
        try:
            for array in arrays:
                own[id(array)] = self._device.upload(array)
            yield dict(own)
        finally:
            for address in own.values():
                self._device.free(address)

    def _kept_memory(self, wave: Wave) -> dict[int, int]:
        """Returns the GPU memory of a Wave's film, draft and rows: id -> address. It is kept for arrays of the same sizes."""
        own: dict[int, int] = {}
        for name in _KEPT:
            array = getattr(wave, name)
            size, address = self._kept.get(name, (-1, 0))
            if size != array.nbytes:
                if self._kept.pop(name, None):
                    self._device.free(address)
                self._kept[name] = array.nbytes, self._device.allocate(array.nbytes)
            own[id(array)] = self._kept[name][1]
        return own

    def _addresses(self, own: dict[int, int]) -> Callable[[npt.NDArray[Any]], int]:
        """Returns a function that returns an array's address in GPU memory, after uploading it if it is not there.

        own: id -> address of the arrays that are not kept for other batches.
        """

        def device_address(array: npt.NDArray[Any]) -> int:
            if id(array) in own:
                return own[id(array)]
            key = array.ctypes.data, array.nbytes
            if key not in self._arrays:
                self._arrays[key] = array, self._device.upload(array)
            return self._arrays[key][1]

        return device_address

    def _launch(self, variant: str, kernel: str, data: bytes, threads: int) -> None:
        """Launches a kernel of a variant with a wave's bytes."""
        kernels, size = self._loaded(variant)
        if len(data) != size:
            raise AssertionError(f"a wave has {len(data)} bytes, and its kernels take {size}")
        begun = time.perf_counter()
        self._device.launch(kernels[kernel], -(-threads // THREADS), THREADS, [data, threads.to_bytes(8, "little")])
        if self._seconds is not None:
            self._device.synchronize()
            self._seconds[kernel] = self._seconds.get(kernel, 0.0) + time.perf_counter() - begun

    def _rendered(self, own: dict[int, int], wave: Wave) -> Rendered:
        """Returns the results of the launched kernels, once they have ended. own: id -> address."""
        self._device.synchronize()
        for array in (wave.film, wave.counters, wave.records):
            if array.size:
                self._device.download(own[id(array)], array)
        return Rendered(wave.film, int(wave.counters[BAD]), int(wave.counters[RAYS]), wave.records)

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

    def _free_others(self, wave: Wave) -> None:
        """Frees the arrays in GPU memory that the wave does not use."""
        used: set[tuple[int, int]] = set()

        def record_use(array: npt.NDArray[Any]) -> int:
            used.add((array.ctypes.data, array.nbytes))
            return 0

        packed(wave, record_use)
        for key in self._arrays.keys() - used:
            self._device.free(self._arrays.pop(key)[1])

    def _loaded(self, variant: str, fetch: Callable[[str], None] | None = None) -> tuple[dict[str, Kernel], int]:
        if variant not in self._kernels:
            ptx = ptx_of(variant, fetch)
            size = _PARAMETER.search(ptx)
            assert size is not None
            self._kernels[variant] = self._device.load(ptx, _ENTRY.findall(ptx)), int(size[1])
        return self._kernels[variant]


def _is_same(a: Any, b: Any) -> bool:
    """Returns True if two fields of trees are the same object, or arrays at the same memory address."""
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return bool(a.ctypes.data == b.ctypes.data and a.shape == b.shape)
    return a is b
