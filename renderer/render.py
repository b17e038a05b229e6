"""Renders a batch or a frame in one process, and compiles or loads the kernels for that."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer import cryptomatte, deep, jit
from renderer.arrays.guide import Guide
from renderer.arrays.kernel_variant import strip_absent_features, variant_of
from renderer.arrays.rows import CATCHES
from renderer.arrays.scene import example
from renderer.arrays.scene_features import KERNEL_VARIANTS
from renderer.cryptomatte import NOT_FINITE, Hits, count_samples
from renderer.cuda.render import CardRenderer
from renderer.deep import Deep
from renderer.deep_samples import RECORD, Sight, sum_samples
from renderer.errors import SettingsError
from renderer.film import COLOR, SAMPLES, BadSample, BatchSums, Sums, plane_count
from renderer.guiding.caustic_photons import warm_up_photons, with_photons
from renderer.guiding.train import is_guide_kept, kept_guide, load_pilot_kernel, train_guide
from renderer.kernel import path_trace as record
from renderer.kernel.accumulate import (
    MAX_BAD,
    Batch,
    Output,
    has_variants,
    new_scratch,
    path_scratch,
    renderer_of,
    samples_caustics,
    samples_guide,
)
from renderer.kernel.camera import PANORAMA, Camera, camera_frame
from renderer.kernel.options import Options, group_rows, kernel_options
from renderer.kernel.steps.continue_or_end import MAX_UNCOUNTED
from renderer.parallel_compile import Helpers
from renderer.preparation_kernels import is_prepared, prepare, prepare_first
from renderer.reference import Packed
from renderer.replay import Replay, read_log
from renderer.scene.caustics import with_caustics
from renderer.scene.compiled import CompiledScene
from renderer.scene.environment import environment_sampled_fully, with_environment_changed, without_environment_sampling
from renderer.scene.light_groups import with_group_planes
from renderer.scene.lights import with_light_choice
from renderer.scene.origin import fixed_point_origin, settings_relative_to_origin
from renderer.scene.spectrum import with_spectrum
from renderer.sentences import Sentence
from renderer.settings import MAX_SPP, RenderSettings, Tile, View, tiles_of
from renderer.shipped_kernels import copy_shipped_kernels
from renderer.threads import cores
from renderer.variant_names import example_of, variant_suffix

__all__ = [
    "PLAIN",
    "RenderStats",
    "check_for_cards",
    "guide_of",
    "helpers_for",
    "is_for_cards",
    "is_pilot_warm",
    "is_warm",
    "kernel_name",
    "load_preparing",
    "pilot_kernel_name",
    "pixel_range_sums",
    "pixel_samples",
    "render_batch",
    "render_draft",
    "render_frame",
    "replay",
    "settings_as_rendered",
    "settings_of_prepared",
    "variant_for",
    "warm_up",
    "warm_up_caustics",
    "warm_up_pilot",
]

_PLAIN_ROOTS = 2  # root nodes of a tree without visibility by kind of ray: for camera rays and shadow rays
PLAIN, FULL, MOVING, MEDIA, MOVING_MEDIA, *_ = KERNEL_VARIANTS
_TILE = 32
_SAMPLES_AT_ONCE = 64
_MOST_PARTS = 256  # of Cryptomatte's counts, before they are added up
_CARD_RECORDS = 1 << 26  # numbers in the records of one batch on a graphics card
_DEEP_AT_ONCE = 1 << 18  # samples whose records are in memory, for deep pixels
_LAST_TILES = 2  # per thread: the last tiles' samples are divided into
_CUTS = 4  # parts, so that the threads end together
_PICTURE = RenderSettings(2, 2, View((0.2, 0.2, 1.0), (0.2, 0.2, 0.0)))
_MOST_PASSED = 56 << 10  # alpha-transparent surfaces that a replay records
_NO_LOG = np.empty((0, record.COLUMNS))


@dataclass
class RenderStats:
    """Statistics of a render: the numbers of samples, of rays (shadow rays included), and of samples that were not finite."""

    samples: int = 0
    rays: int = 0
    bad: list[BadSample] = field(default_factory=list)  # dropped samples, at most MAX_BAD of them
    bad_count: int = 0
    hits: Hits | None = None  # of the whole frame, if Cryptomatte was requested
    deep: Deep | None = None  # likewise deep pixels


def _prepared(scene: CompiledScene, settings: RenderSettings, variant: str | None = None) -> CompiledScene:
    """Returns the scene in the form that the kernel expects for these settings.

    The settings' environment and choice among lights are applied, and arrays of absent features are None. variant: of the
    kernel, with at least the scene's features; None: the scene's.
    """
    stored = scene
    scene = with_environment_changed(scene, settings.environment, settings.environment_strength, settings.environment_rotation)
    scene = with_light_choice(scene, settings.light_choice)
    if samples_caustics(settings):
        scene = with_caustics(scene)
    catches = settings.is_transparent and bool((scene.material_flags & CATCHES).any())  # whose light only samples of it find
    if settings.sampling == "light" or settings.integrator == "whitted" or catches:
        scene = environment_sampled_fully(scene)
    else:
        scene = without_environment_sampling(scene)
    if settings.is_spectral:
        scene = with_spectrum(scene)
    variant = variant or variant_for(settings, scene)
    grouped = with_group_planes(scene, settings.group_names)
    prepared = strip_absent_features(grouped, variant, bool(settings.light_groups), settings.has_light_paths)
    if samples_caustics(settings):
        prepared = with_photons(stored, prepared)
    if samples_guide(settings):
        prepared = prepared._replace(path_guide=_guide(stored, scene, settings, variant))
    return prepared


def _guide(stored: CompiledScene, scene: CompiledScene, settings: RenderSettings, variant: str) -> Guide | None:
    """Returns the guide of an image; None if its paths follow none, so that the kernel without guides renders them.

    stored: the scene from which `scene` was made, with the settings' environment and choice among lights. variant: of the kernel
    that renders the image.
    """

    def train() -> Guide | None:
        if not is_pilot_warm(variant):
            warm_up_pilot(settings, variant)
        return train_guide(strip_absent_features(scene, _pilot_variant(variant)), settings)

    return kept_guide(stored, settings, train)


def guide_of(
    settings: RenderSettings, scene: CompiledScene, prepare_pilot: Callable[[RenderSettings, str], None] | None = None
) -> Guide | None:
    """Returns the guide of an image, for settings with `guiding`; None if its paths follow none. Trains it unless it is kept.

    prepare_pilot: called with the settings and the kernel variant before the kernel of pilot paths is needed for that and not
    loaded yet; None: `warm_up_pilot`.
    """
    variant = variant_for(settings, scene)
    if not is_guide_kept(scene, settings) and not is_pilot_warm(variant):
        (prepare_pilot or warm_up_pilot)(settings, variant)
    guide: Guide | None = _prepared(scene, settings).path_guide
    return guide


def settings_as_rendered(
    settings: RenderSettings, scene: CompiledScene, prepare_pilot: Callable[[RenderSettings, str], None] | None = None
) -> RenderSettings:
    """Returns the settings for whose kernel a scene is rendered.

    They are without `guiding` if its paths follow no guide, and without `caustics` if it has none. Trains the guide if the
    settings ask for one. prepare_pilot: as for `guide_of`.
    """
    if samples_caustics(settings) and with_caustics(scene).caustics is None:
        return replace(settings, caustics="off")
    if not samples_guide(settings) or guide_of(settings, scene, prepare_pilot) is not None:
        return settings
    return replace(settings, guiding="off")


def settings_of_prepared(settings: RenderSettings, prepared: CompiledScene) -> RenderSettings:
    """Returns the settings for whose kernel a scene from `_prepared` is rendered, as `settings_as_rendered` does."""
    guiding = "off" if prepared.path_guide is None else settings.guiding
    return replace(settings, guiding=guiding, caustics="off" if prepared.caustics is None else settings.caustics)


def _pilot_variant(variant: str) -> str:
    """Returns the variant of the kernel that follows pilot paths, which has no plain one."""
    return FULL if variant == PLAIN else variant


def _render(
    scene: CompiledScene,
    settings: RenderSettings,
    tile: Tile,
    first: int,
    count: int,
    log: npt.NDArray[np.float64] = _NO_LOG,
    begins: Callable[[], None] = lambda: None,
) -> tuple[BatchSums, int]:
    """Renders a batch; returns (its sums, number of rays). scene: from `_prepared`.

    log: rows in which the kernel records the path of the last sample. begins: called right before the first kernel.
    """
    step = max(1, _DEEP_AT_ONCE // max(1, tile.w * tile.h))
    if settings.deep and count > step:
        ranges = ((begin, min(step, first + count - begin)) for begin in range(first, first + count, step))
        begins()
        return _added([_render(scene, settings, tile, *each, log) for each in ranges])
    planes, rows = len(settings.light_planes), group_rows(settings)
    sums = np.zeros((plane_count(planes, settings.is_transparent), tile.h, tile.w), np.int64)
    bad = np.empty((MAX_BAD, 3), np.int64)
    columns = _record_columns(settings)
    records = np.full((tile.w * tile.h * count if columns else 0, columns or 2), NOT_FINITE, np.uint32)
    camera = camera_frame(settings_relative_to_origin(settings, scene.origin))
    kernel = renderer_of(settings)
    scratch, options = new_scratch(kernel, tile.w, tile.h, planes, rows), kernel_options(settings, scene)
    batch = Batch(tile.x, tile.y, first, count, fixed_point_origin(scene.origin, settings.film_exponent))
    output = Output(sums, bad, log, sums.reshape(-1), records, path_scratch(rows))
    packed = Packed(scene)
    begins()
    bad_count, rays = kernel(packed, scratch, camera, options, batch, output)
    listed = [BadSample(*map(int, row)) for row in bad[: min(bad_count, MAX_BAD)]]
    hits, found = _counted(records, settings, tile, camera)
    return BatchSums(sums, listed, int(bad_count), hits, found), int(rays)


def _record_columns(settings: RenderSettings) -> int:
    """Returns the number of columns of the records of samples (Output in renderer/kernel/accumulate.py); 0 without records."""
    return 2 + RECORD if settings.deep else 2 if settings.cryptomatte else 0


def _counted(
    records: npt.NDArray[np.uint32], settings: RenderSettings, tile: Tile, camera: Camera
) -> tuple[Hits | None, Deep | None]:
    """Returns Cryptomatte's counts and the deep pixels of a batch, as far as the settings ask for them.

    records: of its samples, pixel by pixel.
    """
    pixels = tile.w * tile.h
    by_pixel = records.reshape(pixels, len(records) // max(pixels, 1), records.shape[1])
    hits = count_samples(by_pixel[..., :2]) if settings.cryptomatte else None
    if not settings.deep:
        return hits, None
    sight = Sight(_floats(camera.eye), None if camera.kind == PANORAMA else _floats(camera.forward))
    return hits, sum_samples(by_pixel[..., 0], by_pixel[..., 2:].view(np.float32), sight, settings.film_exponent, settings.deep)


def _floats(vector: tuple[np.float32, np.float32, np.float32]) -> tuple[float, float, float]:
    x, y, z = map(float, vector)
    return x, y, z


def _added(parts: Sequence[tuple[BatchSums, int]]) -> tuple[BatchSums, int]:
    """Returns the sum of batches of one tile with deep pixels, as `_render` does."""
    batches = [batch for batch, _ in parts]
    hits = [batch.hits for batch in batches if batch.hits is not None]
    found = BatchSums(
        np.sum([batch.sums for batch in batches], axis=0),
        [bad for batch in batches for bad in batch.bad][:MAX_BAD],
        sum(batch.bad_count for batch in batches),
        cryptomatte.merged(hits) if hits else None,
        deep.merged(batch.deep for batch in batches if batch.deep is not None),
    )
    return found, sum(rays for _, rays in parts)


def _render_on(
    card: CardRenderer, scene: CompiledScene, settings: RenderSettings, tile: Tile, first: int, count: int
) -> tuple[BatchSums, int]:
    """Renders a batch on a graphics card; returns (its sums, number of rays). Raises CardError if the card fails."""
    recorded = _record_columns(settings)
    step = max(1, _CARD_RECORDS // max(1, tile.w * tile.h * recorded))
    if recorded and count > step:
        ranges = ((begin, min(step, first + count - begin)) for begin in range(first, first + count, step))
        return _added([_render_on(card, scene, settings, tile, *each) for each in ranges])
    arguments = _card_arguments(scene, settings, tile, first, count)
    found = card.render(*arguments, recorded)
    bad: list[BadSample] = []
    if found.bad_count:  # a card counts them: the CPU lists those of the pixels that lack samples
        for y, x in np.argwhere(found.sums[SAMPLES] < count)[:MAX_BAD]:
            bad += _render(scene, settings, Tile(tile.x + int(x), tile.y + int(y), 1, 1), first, count)[0].bad
    counted = _counted(found.records, settings, tile, arguments.camera)
    return BatchSums(found.sums, bad[:MAX_BAD], found.bad_count, *counted), found.rays


class _CardArguments(NamedTuple):
    """The first arguments of CardRenderer.render."""

    scene: CompiledScene
    variant: str
    camera: Camera
    options: Options
    batch: Batch
    width: int
    height: int


def _card_arguments(scene: CompiledScene, settings: RenderSettings, tile: Tile, first: int, count: int) -> _CardArguments:
    """scene: from `_prepared`."""
    camera, options = camera_frame(settings_relative_to_origin(settings, scene.origin)), kernel_options(settings, scene)
    batch = Batch(tile.x, tile.y, first, count, fixed_point_origin(scene.origin, settings.film_exponent))
    plain = scene.has._replace(groups=None, light_paths=None, by_light=None)
    suffix = variant_suffix(settings_of_prepared(settings, scene))
    variant = next(name for name, has in KERNEL_VARIANTS.items() if has == plain) + suffix
    return _CardArguments(scene, variant, camera, options, batch, tile.w, tile.h)


def is_for_cards(settings: RenderSettings) -> bool:
    """Returns True if a graphics card can render these settings: the default strategy to find light."""
    return has_variants(settings)


def check_for_cards(settings: RenderSettings) -> None:
    """Raises SettingsError unless a graphics card can render with these settings."""
    if not is_for_cards(settings):
        raise SettingsError(
            Sentence(
                "card-settings-unsupported",
                "a graphics card renders only with the integrators path and direct, sampling mis, heuristic power, one light "
                "sample and no mistake; leave out the card",
            )
        )


def render_batch(
    scene: CompiledScene,
    settings: RenderSettings,
    tile: Tile,
    first: int,
    count: int,
    card: CardRenderer | None = None,
    begins: Callable[[], None] = lambda: None,
    variant: str | None = None,
) -> BatchSums:
    """Renders samples first ... first + count - 1 of every pixel of the tile. Runs without the GIL; thread-safe without a `card`.

    The sums do not depend on the card or on how a frame is divided into batches: its batches always add up to the same bits.
    card: a graphics card, which renders the batch if `is_for_cards(settings)`. begins: called when everything is ready for the
    kernel, which needs no interpreter. variant: of the kernel, with at least the scene's features; None: the scene's. Raises
    CardError if the card fails.
    """
    prepared = _prepared(scene, settings, variant)
    if card is not None and is_for_cards(settings):
        begins()
        return _render_on(card, prepared, settings, tile, first, count)[0]
    return _render(prepared, settings, tile, first, count, begins=begins)[0]


def render_draft(
    scene: CompiledScene,
    settings: RenderSettings,
    tile: Tile,
    first: int,
    count: int,
    card: CardRenderer,
    exposure: float = 0.0,
    *,
    is_smooth: bool = False,
    variant: str | None = None,
) -> npt.NDArray[np.uint32]:
    """Renders samples of a tile with a graphics card, as `render_batch` does; returns their draft (renderer/kernel/draft.py).

    Shape (h, w). exposure: of the draft, in stops. is_smooth: whether it is smoothed. variant: of the kernel to use, if not
    `variant_for`. settings: those of `is_for_cards`, without Cryptomatte and deep pixels. Samples that are not finite are left
    out. Raises CardError if the card fails.
    """
    arguments = _card_arguments(_prepared(scene, settings, variant), settings, tile, first, count)
    return card.render_draft(*arguments, exposure, is_smooth)


def render_frame(
    scene: CompiledScene,
    settings: RenderSettings,
    spp: int,
    threads: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    stats: RenderStats | None = None,
    stop: Callable[[Sums], bool] | None = None,
    time_limit: float | None = None,
    card: CardRenderer | None = None,
) -> Sums:
    """Renders samples 0 ... spp - 1 of every pixel; returns the film's sums, (planes, height, width) int64.

    threads: None: one per CPU available to this process. The sums do not depend on the number.
    progress: called from this thread with (samples finished, total samples), over all pixels.
    stats: receives the statistics, if given.
    stop: called with the sums after every pass over the frame; ends the render if it returns True.
    time_limit: seconds after which no further pass begins; at least one pass is rendered.
    If `stop` or `time_limit` is given, passes have 1, 1, 2, 4 ... and at most 64 samples per pixel; else all have 64.
    card: a graphics card, which renders everything instead of the CPU, to the same bits. Raises SettingsError unless
    `is_for_cards(settings)`, and CardError if the card fails.
    """
    stats = stats if stats is not None else RenderStats()
    if card is not None:
        check_for_cards(settings)
    threads = 1 if card is not None else threads or cores()
    prepared = _prepared(scene, settings)
    sums = np.zeros((plane_count(len(settings.light_planes), settings.is_transparent), settings.height, settings.width), np.int64)
    tiles = tiles_of(settings.width, settings.height, _TILE if card is None else max(settings.width, settings.height))
    total = spp * settings.width * settings.height
    begin = time.perf_counter()
    lock = threading.Lock()
    hits: list[Hits] = []
    deep_tiles: dict[Tile, Deep] = {}
    done = 0

    def render(tile: Tile, first: int, count: int) -> int:
        if card is not None:
            batch, rays = _render_on(card, prepared, settings, tile, first, count)
        else:
            batch, rays = _render(prepared, settings, tile, first, count)
        with lock:
            sums[:, tile.y : tile.y + tile.h, tile.x : tile.x + tile.w] += batch.sums
            stats.rays += rays
            stats.samples += count * tile.w * tile.h
            stats.bad_count += batch.bad_count
            stats.bad.extend(batch.bad[: MAX_BAD - len(stats.bad)])
            if batch.hits is not None:
                hits.append(cryptomatte.moved(batch.hits, tile.x, tile.y, tile.w, settings.width))
                if len(hits) > _MOST_PARTS:
                    hits[:] = [cryptomatte.merged(hits)]
            if batch.deep is not None:
                deep_tiles[tile] = deep.merged([deep_tiles[tile], batch.deep]) if tile in deep_tiles else batch.deep
        return count * tile.w * tile.h

    with ThreadPoolExecutor(threads, thread_name_prefix="render") as pool:
        first = 0
        while first < spp:
            count = min(_SAMPLES_AT_ONCE, spp - first)
            if stop is not None or time_limit is not None:
                count = min(max(first, 1), count)
            waiting = [pool.submit(render, *batch) for batch in _batches(tiles, first, count, threads)]
            try:
                for future in waiting:
                    done += future.result()
                    if progress is not None:
                        progress(done, total)
            except BaseException:  # including Ctrl-C: cancel pending batches
                pool.shutdown(wait=False, cancel_futures=True)
                raise
            first += count
            if (stop is not None and stop(sums)) or (time_limit is not None and time.perf_counter() - begin >= time_limit):
                break
    stats.hits = cryptomatte.merged(hits) if settings.cryptomatte else None
    if settings.deep:
        stats.deep = deep.merged(deep.moved(each, tile.x, tile.y, tile.w, settings.width) for tile, each in deep_tiles.items())
    return sums


def _batches(tiles: list[Tile], first: int, count: int, threads: int) -> Iterator[tuple[Tile, int, int]]:
    """Yields batches (tile, first, count) that cover these samples of all tiles; smaller ones towards the end."""
    whole = max(0, len(tiles) - _LAST_TILES * threads)
    for tile in tiles[:whole]:
        yield tile, first, count
    part = -(-count // _CUTS)
    for begin in range(first, first + count, part):
        for tile in tiles[whole:]:
            yield tile, begin, min(part, first + count - begin)


def replay(scene: CompiledScene, settings: RenderSettings, x: int, y: int, sample: int) -> Replay:
    """Renders one sample of a pixel again with the kernel that renders frames; returns its path with all vertices.

    Raises SettingsError if the pixel is not in the image or the sample number is out of range.
    """
    _check_pixel(settings, x, y)
    settings = replace(settings, light_groups="", light_paths="off", cryptomatte=0, deep=0)
    if not 0 <= sample < MAX_SPP:
        raise SettingsError(
            Sentence(
                "setting-out-of-range",
                "{setting} is {value}; it lies between {low} and {high}",
                setting="sample",
                value=sample,
                low=0,
                high=MAX_SPP - 1,
            ),
            field="sample",
        )
    options = kernel_options(settings, scene)
    most = options.max_depth + options.transmission_depth + MAX_UNCOUNTED + _MOST_PASSED
    log = np.zeros((most, record.COLUMNS))
    batch, _ = _render(_prepared(scene, settings), settings, Tile(x, y, 1, 1), sample, 1, log)
    return read_log(batch, settings, log, scene.origin)


def pixel_samples(
    scene: CompiledScene, settings: RenderSettings, x: int, y: int, count: int
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
    """Renders samples 0 ... count - 1 of a pixel; returns (their colours, whether each is finite and so in the film).

    Colours: (count, 3) integers in the film's fixed point; finite: (count,) bool. Raises SettingsError if the pixel is not in the
    image.
    """
    values, finite = pixel_range_sums(scene, settings, x, y, [(sample, 1) for sample in range(count)])
    return values, finite == 1


def pixel_range_sums(
    scene: CompiledScene, settings: RenderSettings, x: int, y: int, ranges: Sequence[tuple[int, int]]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Renders ranges of a pixel's samples; returns (the sum of each range's colours, its number of finite samples).

    ranges: n times (first sample, count). Sums: (n, 3) integers in the film's fixed point, without samples that are not finite.
    Finite: (n,). Raises SettingsError if the pixel is not in the image.
    """
    _check_pixel(settings, x, y)
    settings = replace(settings, light_groups="", light_paths="off", cryptomatte=0, deep=0)
    prepared = _prepared(scene, settings)
    values, finite = np.zeros((len(ranges), 3), np.int64), np.zeros(len(ranges), np.int64)
    for i, (first, count) in enumerate(ranges):
        sums = _render(prepared, settings, Tile(x, y, 1, 1), first, count)[0].sums
        values[i], finite[i] = sums[COLOR, 0, 0], sums[SAMPLES, 0, 0]
    return values, finite


def _check_pixel(settings: RenderSettings, x: int, y: int) -> None:
    if not (0 <= x < settings.width and 0 <= y < settings.height):
        raise SettingsError(
            Sentence(
                "pixel-outside-picture",
                "pixel {x},{y} lies outside the picture of {width}x{height}",
                x=x,
                y=y,
                width=settings.width,
                height=settings.height,
            )
        )


def variant_for(settings: RenderSettings, scene: CompiledScene) -> str:
    """Returns the name of the kernel variant that renders the scene with these settings."""
    if settings.integrator in ("whitted", "ao") or settings.sampling != "mis":  # which do not aim
        scene = scene._replace(target=scene.target[:0])
    if settings.integrator in ("whitted", "ao"):
        scene = scene._replace(pivot=scene.pivot[:0], volume=scene.volume[:0])
    if settings.integrator == "ao":  # which has no lights
        scene = scene._replace(object_links=scene.object_links[:0], bvh=scene.bvh._replace(ray_roots=scene.bvh.ray_roots[:2]))
    variant = variant_of(scene, len(settings.views) > 0 or settings.view.distortion is not None)
    if len(scene.object_links) > 0 and settings.integrator == "whitted":
        raise SettingsError(
            Sentence(
                "light-links-integrator",
                "integrator whitted does not support the light links that the scene has; choose path or direct",
            ),
            field="integrator",
        )
    if len(scene.bvh.ray_roots) > _PLAIN_ROOTS and settings.integrator == "whitted":
        raise SettingsError(
            Sentence(
                "visibility-integrator",
                "integrator whitted does not support the visibility by kind of ray and the shadow links that the scene has; "
                "choose path or direct",
            ),
            field="integrator",
        )
    if settings.integrator in ("whitted", "ao"):  # which have no media
        variant = {MEDIA: FULL, MOVING_MEDIA: MOVING}.get(variant, variant)
    has_plain = has_variants(settings) and not (settings.is_spectral or samples_caustics(settings))
    return FULL if variant == PLAIN and not has_plain else variant


def kernel_name(settings: RenderSettings | None = None, variant: str = PLAIN) -> str:
    """Returns the cache name of the kernel for these settings and this variant."""
    settings = settings or _PICTURE
    return f"{renderer_of(settings).__name__.strip('_')}-{variant}{variant_suffix(settings)}"


def pilot_kernel_name(variant: str) -> str:
    """Returns the cache name of the kernel of pilot paths. variant: of the kernel for images."""
    return f"pilot-{_pilot_variant(variant)}"


def is_warm(settings: RenderSettings, variant: str) -> bool:
    """Returns True if `warm_up` has loaded this kernel.

    Otherwise the first batch compiles the kernel, which takes up to a minute.
    """
    return jit.is_ready(kernel_name(settings, variant))


def warm_up(
    settings: RenderSettings | None = None,
    variant: str = PLAIN,
    fetch: Callable[[str], None] | None = None,
    helpers: Helpers | None = None,
    prepares: bool = True,
) -> float:
    """Compiles or loads the kernel for these settings and a variant (renderer.arrays.kernel_variant); returns the seconds taken.

    settings: None: those of images. A kernel in the cache or in the installation is loaded instead of compiled.

    prepares: also loads the kernels that prepare scenes. With the plain kernel, which a starting worker needs first, only those
    that every scene needs, unless all are cached; with every other kernel, all of them.

    fetch: called with the kernel's name before a kernel that is not cached is compiled; may fetch it from another host. helpers:
    from `helpers_for`, if created earlier. A parent that calls this before it forks shares the machine code with its children.
    """
    begin = time.perf_counter()
    name = kernel_name(settings, variant)
    if not jit.is_cached(name):
        copy_shipped_kernels(jit.cache_folder())
    settings = replace(settings or _PICTURE, view=_PICTURE.view)
    nothing, _ = example_of(f"{variant}{variant_suffix(settings)}")
    with (
        jit.compiling(name, None if fetch is None else lambda: fetch(name)) as is_cold,
        helpers or helpers_for(settings, variant) as helping,  # none in a process that has waited for another one's kernel
    ):
        if is_cold:
            helping.share()
        _render(nothing, settings, Tile(0, 0, 0, 0), 0, 0)
        warm_up_caustics(settings, variant)
        helping.finish()
        if prepares:
            prepare_first() if name == kernel_name() else prepare()
    if prepares:
        load_preparing()
    return time.perf_counter() - begin


def warm_up_caustics(settings: RenderSettings, variant: str) -> None:
    """Compiles or loads the kernels of photons through casters, if the settings ask for them. variant: of that for images."""
    if samples_caustics(settings):
        warm_up_photons(example_of(f"{variant}{variant_suffix(settings)}")[0])


def is_pilot_warm(variant: str) -> bool:
    """Returns True if `warm_up_pilot` has loaded the kernel of pilot paths. variant: of the kernel for images."""
    return jit.is_ready(pilot_kernel_name(variant))


def warm_up_pilot(settings: RenderSettings, variant: str, fetch: Callable[[str], None] | None = None) -> float:
    """Compiles or loads the kernel of pilot paths, which train a path guide; returns the seconds taken.

    variant: of the kernel for images. fetch: as for `warm_up`.
    """
    begin, name = time.perf_counter(), pilot_kernel_name(variant)
    with jit.compiling(name, None if fetch is None else lambda: fetch(name)):
        nothing = strip_absent_features(example(), _pilot_variant(variant))
        load_pilot_kernel(nothing, replace(settings, view=_PICTURE.view))
    return time.perf_counter() - begin


def load_preparing() -> None:
    """Loads all kernels that prepare scenes, if they are in this machine's cache."""
    if jit.is_cached(kernel_name(variant=FULL)):
        prepare()


def helpers_for(settings: RenderSettings | None = None, variant: str = PLAIN) -> Helpers:
    """Returns the helper processes for `warm_up`; no processes are started if the kernel is in the cache already."""
    settings = settings or _PICTURE
    parts = f"{variant}{variant_suffix(settings)}" if has_variants(settings) else ""
    is_of_use = not jit.is_cached(kernel_name(settings, variant)) and (parts != "" or not is_prepared())
    return Helpers(parts, is_of_use)
