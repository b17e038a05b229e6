"""NVIDIA graphics cards: builds their kernels, compares their films with the CPU's bit by bit, and measures both against Mitsuba.

    python3 farm.py bench gpu [--stages build,bits] [--minutes 8] [--quick] [--scenes "Cornell box,glass"] [--library PATH]

Runs in steps of at most two minutes, begins none after --minutes, and ends with exit code 3: run the same command again to
continue. The results are in a file of --state; to continue elsewhere, copy that folder and that of $RAYFARM_CACHE. Stages:

    build     the kernels of all variants, for cards and for the CPU, on all cores; needs no card
    load      the driver translates the kernels, on all cores, and keeps them in its cache
    bits      each kernel's self-test, and each scene's film at 256x256x16: equal to the CPU's?
    speed     the card's samples per second, after compilation, with splitting 1, so that all trace equally many paths
    features  the same by wavelength, with a path guide, by light group and by light path
    cores     the CPU's, on all cores
    mitsuba   those of Mitsuba's cuda_ad_rgb on the same card, if it is installed
    error     the noise of 512x512x64 of both, with the default splitting and with multijitter, Mitsuba's best sampler
    paths     the card's with 1, 2 and 4 million paths under way
    live      pictures per second of a live view at 1920x1080 with 4 samples, rendered and packed
    denoise   Open Image Denoise at 1920x1080, on the CPU and on the card
    profile   milliseconds of each stage of a path; and hardware counters, if Nsight Compute (ncu) is installed

The end is a table of all results so far, with the ratios. Exit code 1: a film differs, or a step failed. A step during which the
process ended is not tried again without --again; one whose library is missing is. Without a card nothing runs but --stages build.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from renderer import jit
from renderer.arrays.scene_features import KERNEL_VARIANTS
from renderer.confine.limits import available_memory
from renderer.cuda.artefacts import kernel_name as card_kernel_name
from renderer.cuda.artefacts import ptx_of
from renderer.cuda.cards import NOT_YET_TRIED, described, find_cards
from renderer.cuda.driver import LIBRARY, Card
from renderer.cuda.render import CardRenderer
from renderer.cuda.verdicts import run_self_test
from renderer.film import COLOR, SAMPLES, Sums, digest, mean
from renderer.render import kernel_name, render_batch, render_frame, variant_for, warm_up
from renderer.scene.compile import compile_scene
from renderer.scene.compiled import CompiledScene
from renderer.settings import RenderSettings, Tile
from renderer.threads import cores
from renderer.variant_names import base_variant, example_of
from tests.benchmarks.peers.measure import relative_error
from tests.benchmarks.peers.scenes import CASES, Case
from tests.benchmarks.peers.sizes import FULL, QUICK, Sizes

ROOT = Path(__file__).resolve().parents[2]
STAGES = ("build", "load", "bits", "speed", "features", "cores", "mitsuba", "error", "paths", "live", "denoise", "profile")
# Kernels with what settings add: for the self-test, and for the stage `features`.
WITH_SETTINGS = (
    *("full-spectral", "media-spectral", "full-guided", "full-paths-groups", "full-caustics", "media-caustics"),
    *("plain-guided", "plain-groups", "plain-paths"),
)
TRIES = 3
COMPARED, COMPARED_SPP = 256, 16  # width in pixels and samples of the films that are compared
TIMED = ((512, 512, 64), (512, 512, 256), (1920, 1080, 64))
CPU_SIZE = (512, 512, 16)
QUICK_TIMED = ((64, 64, 4),)
SEEDS = 4  # pictures from which the noise is estimated
MOST_PATHS = (1 << 20, 1 << 21, 1 << 22)
LIVE, QUICK_LIVE, LIVE_SPP, LIVE_SIDE = (1920, 1080), (96, 54), 4, 256
UNFINISHED = 3  # exit code
MISSING = 4  # exit code of a process that lacks a library
ITEM_LIMIT_S = 110.0  # of a step in a process of its own, so that a command of 8 minutes ends before ten
JOB_MEMORY = 1 << 30  # bytes that a process needs to build a kernel; loading one takes about as many of a card
DRIVER_CACHE = 4 << 30  # bytes for the kernels that the driver has translated
FEATURES: dict[str, dict[str, Any]] = {
    "by wavelength": {"spectral": "on"},
    "guided": {"guiding": "on"},
    "by light group": {"light_groups": "lamp"},
    "by light path": {"light_paths": "on"},
}


@dataclass(frozen=True)
class Step:
    """A step of a stage. run: returns its result as JSON data; raises an exception if it fails."""

    stage: str
    name: str
    run: Callable[[], Any]


class MissingError(Exception):
    """Raised by a step whose library is missing here; the next run tries it again."""


class Results:
    """The results of steps, in a file of JSON lines to which each step is appended at its begin and at its end."""

    def __init__(self, folder: Path, again: bool) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._path = folder / "results.jsonl"
        self.values: dict[str, Any] = {}  # by "stage: name"
        self.failures: dict[str, str] = {}
        for line in self._path.read_text().splitlines() if self._path.exists() else ():
            with suppress(ValueError):  # a line that was cut off
                entry = json.loads(line)
                self.failures.pop(entry["step"], None)
                if "failure" in entry:
                    self.failures[entry["step"]] = entry["failure"]
                elif "value" in entry:
                    self.values[entry["step"]] = entry["value"]
                elif "missing" not in entry:
                    self.failures[entry["step"]] = "the process ended"
        if again:
            self.failures.clear()

    def run(self, step: Step) -> None:
        """Runs a step unless it was run before, and prints its result."""
        key = f"{step.stage}: {step.name}"
        if key in self.values or key in self.failures:
            return
        self._append({"step": key})
        begun = time.perf_counter()
        try:
            self.values[key] = step.run()
        except MissingError as error:
            self._append({"step": key, "missing": str(error)})
            print(f"{key}: left out: {error}", flush=True)
            return
        except Exception as error:
            self.failures[key] = f"{type(error).__name__}: {error}"
            self._append({"step": key, "failure": self.failures[key]})
        else:
            self._append({"step": key, "value": self.values[key]})
        result = self.failures.get(key) or json.dumps(self.values[key])
        print(f"{key}: {result} ({time.perf_counter() - begun:.0f} s)", flush=True)

    def keep(self, key: str, value: Any) -> None:
        """Keeps a value that was measured outside a step. key: "stage: name"."""
        self.values[key] = value
        self._append({"step": key, "value": value})

    def of(self, stage: str) -> dict[str, Any]:
        """Returns the values of a stage by the steps' names."""
        return {key.removeprefix(f"{stage}: "): value for key, value in self.values.items() if key.startswith(f"{stage}: ")}

    def _append(self, entry: dict[str, Any]) -> None:
        with self._path.open("a") as file:
            file.write(f"{json.dumps(entry)}\n")


def main() -> int:
    options = _options()
    sizes = QUICK if options.quick else FULL
    os.environ.setdefault("CUDA_CACHE_MAXSIZE", str(DRIVER_CACHE))
    if options.job:
        return _run_job(options.job, options.library)
    if options.mitsuba:
        return _mitsuba(options, sizes)
    if options.once:
        return _once(options, sizes)
    deadline = time.monotonic() + 60 * options.minutes
    if [*options.stages] == ["build"]:
        return 0 if _build(options.kernels, deadline) else UNFINISHED
    found = find_cards(options.library)
    for reason in found.refused:
        print(reason)
    if not found.usable:
        print("Nothing is built or rendered. `rayfarm doctor` checks the driver; --stages build needs no card.")
        return 0
    card = found.usable[0]
    print(f"card {described(card)} ({NOT_YET_TRIED}), driver {card.driver}, beside {cores()} cores", flush=True)
    if "build" in options.stages and not _build(options.kernels, deadline):
        return UNFINISHED
    results = Results(options.state, options.again)
    if "load" in options.stages:
        jobs = [f"load:{name}" for name in options.kernels if name not in results.of("load")]
        if not _run_jobs(jobs, deadline, options.library, results, card.memory):
            return UNFINISHED
    for step in _steps(options, sizes, card):
        if time.monotonic() > deadline:
            _print_table(results)
            print("The time is over: run the same command again to continue.")
            return UNFINISHED
        results.run(step)
    _print_table(results)
    wrong = [key for key, value in results.values.items() if key.startswith("bits: ") and value != "equal"]
    for key, failure in results.failures.items():
        print(f"{key}: {failure}")
    print(f"{len(wrong)} films differ from the CPU's" if wrong else "all compared films have the CPU's bits")
    return int(bool(wrong or results.failures))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="farm.py bench gpu", description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--stages", type=_stages, default=STAGES, help="those to run, with commas; by default all")
    parser.add_argument("--minutes", type=float, default=8.0, help="minutes after which no further step begins; by default 8")
    parser.add_argument("--state", type=Path, default=ROOT / "build" / "bench-gpu", help="the folder of the results")
    parser.add_argument("--again", action="store_true", help="try failed steps once more")
    parser.add_argument("--quick", action="store_true", help="small scenes and pictures, to see that every step works")
    parser.add_argument("--scenes", help="the beginnings of their names, with commas; by default all")
    parser.add_argument(
        "--kernels", type=_kernels, default=[*KERNEL_VARIANTS, *WITH_SETTINGS], help="by default all, with commas"
    )
    parser.add_argument("--library", default=LIBRARY, help="the driver's library")
    parser.add_argument("--once", metavar="SCENE", help="one small render, for a profiler")
    parser.add_argument("--job", help=argparse.SUPPRESS)
    parser.add_argument("--mitsuba", metavar="WxHxSPP", help=argparse.SUPPRESS)
    parser.add_argument("--error", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    options.scenes = options.once or options.scenes
    options.state = options.state / ("quick" if options.quick else "full")
    return options


def _stages(text: str) -> list[str]:
    names = text.split(",")
    if unknown := [name for name in names if name not in STAGES]:
        raise argparse.ArgumentTypeError(f"there is no stage {', '.join(unknown)}; known are {', '.join(STAGES)}")
    return names


def _kernels(text: str) -> list[str]:
    names = text.split(",")
    if unknown := [name for name in names if base_variant(name) not in KERNEL_VARIANTS]:
        raise argparse.ArgumentTypeError(f"there is no kernel {', '.join(unknown)}")
    return names


def _names(options: argparse.Namespace) -> list[str]:
    """Returns the names of the requested scenes."""
    wanted = options.scenes.split(",") if options.scenes else [""]
    return [name for name in CASES if any(name.startswith(each) for each in wanted)]


# --- building -----------------------------------------------------------------------------------------------------------------


def _build(kernels: Sequence[str], deadline: float) -> bool:
    """Builds the kernels that are missing, for cards and for the CPU; returns False if the time is over before all are built."""
    jobs = [f"{where}:{name}" for where in ("card", "cores") for name in kernels if not _is_built(where, name)]
    return _run_jobs(jobs, deadline)


def _run_jobs(
    jobs: Sequence[str], deadline: float, library: str = LIBRARY, results: Results | None = None, card_memory: int = sys.maxsize
) -> bool:
    """Runs jobs of `_run_job` in parallel processes; returns False if the time is over before all have ended.

    results: where the seconds of each are kept. card_memory: bytes of the card on which the jobs load kernels. A job that fails
    is reported; the steps that need its kernel fail then.
    """
    if not jobs:
        return True
    command = [sys.executable, "-m", "tests.benchmarks.bench_gpu", f"--library={library}", "--job"]
    count = max(1, min(cores(), available_memory() // JOB_MEMORY, card_memory // JOB_MEMORY))
    print(f"{len(jobs)} kernels to build or load, {count} at a time", flush=True)

    def run(job: str) -> bool:
        """Returns False if the time is over."""
        left = deadline - time.monotonic()
        if left <= 0:
            return False
        begun = time.perf_counter()
        try:
            done = subprocess.run([*command, job], cwd=ROOT, timeout=left, capture_output=True, text=True, check=False)
        except subprocess.TimeoutExpired:
            return False
        seconds, failure = round(time.perf_counter() - begun, 1), ""
        if done.returncode:
            failure = f": failed: {(done.stderr.strip().splitlines() or [f'exit code {done.returncode}'])[-1]}"
        elif results is not None:
            results.keep(job.replace(":", ": "), seconds)
        print(f"{job}: {seconds:.0f} s{failure}", flush=True)
        return True

    with ThreadPoolExecutor(count) as pool:
        is_done = all([*pool.map(run, jobs)])
    if not is_done:
        print("The time is over before all kernels are there: run the same command again to continue.")
    return is_done


def _is_built(where: str, kernel: str) -> bool:
    name = card_kernel_name(kernel) if where == "card" else kernel_name(example_of(kernel)[1], base_variant(kernel))
    return jit.is_cached(name)


def _run_job(job: str, library: str) -> int:
    """Builds the kernel of a job, card:NAME or cores:NAME, or loads it on the first card, load:NAME."""
    where, _, kernel = job.partition(":")
    if where == "card":
        ptx_of(kernel)
    elif where == "load":
        renderer = CardRenderer(find_cards(library).usable[0], library)
        renderer.load(kernel)
        renderer.close()
    else:
        warm_up(example_of(kernel)[1], base_variant(kernel))
    return 0


# --- steps --------------------------------------------------------------------------------------------------------------------


def _steps(options: argparse.Namespace, sizes: Sizes, card: Card) -> Iterator[Step]:
    """Yields the steps of the requested stages, most important first."""
    names, timed = _names(options), QUICK_TIMED if options.quick else TIMED

    @cache
    def renderer() -> CardRenderer:
        return CardRenderer(card, options.library)

    @cache
    def made(name: str) -> tuple[Case, CompiledScene]:
        case = CASES[name](sizes)
        return case, compile_scene(case.description)

    def steps_of(stage: str) -> Iterator[tuple[str, Callable[[], Any]]]:
        if stage == "bits":
            for kernel in options.kernels:
                yield f"kernel {kernel}", partial(_self_test, card, kernel)
            for name in names:
                yield name, partial(_compare, made, renderer, name, options.quick)
        elif stage in ("speed", "cores"):
            for size in timed if stage == "speed" else [QUICK_TIMED[0] if options.quick else CPU_SIZE]:
                for name in names:
                    yield _label(name, size), partial(_speed, made, renderer if stage == "speed" else None, name, size)
        elif stage == "features":
            for feature, more in FEATURES.items():
                for who, use in (("card", renderer), ("cores", None)):
                    size = timed[0] if use else (QUICK_TIMED[0] if options.quick else CPU_SIZE)
                    yield (
                        f"{_label(f'{names[0]} {feature}', size)}, {who}",
                        partial(_feature_speed, sizes, use, names[0], size, more),
                    )
        elif stage == "mitsuba":
            for size in timed:
                for name in names:
                    yield _label(name, size), partial(_mitsuba_process, name, size, options.quick)
        elif stage == "error":
            for name in names:
                yield f"{name}, card", partial(_error_of_card, made, renderer, name, timed[0])
                yield f"{name}, Mitsuba", partial(_mitsuba_process, name, timed[0], options.quick, "--error")
        elif stage == "paths":
            for name, most in itertools.product(names, MOST_PATHS):
                yield f"{name}, {most >> 20} M", partial(_speed_with, made, card, options.library, name, timed[-1], most)
        elif stage == "live":
            yield names[0], partial(_live_rate, made, renderer, names[0], QUICK_LIVE if options.quick else LIVE)
        elif stage == "denoise":
            for device in ("cpu", "cuda"):
                yield device, partial(_denoise_ms, device, QUICK_LIVE if options.quick else LIVE)
        elif stage == "profile":
            for name in names[:3]:
                yield name, partial(_profile, made, card, options.library, name, timed[0])
            if (program := shutil.which("ncu")) is not None:
                yield f"ncu {names[0]}", partial(_counters, program, names[0], options)

    for stage in STAGES:
        if stage in options.stages:
            for name, run in steps_of(stage):
                yield Step(stage, name, run)


Made = Callable[[str], tuple[Case, CompiledScene]]


def _label(name: str, size: tuple[int, int, int]) -> str:
    return f"{name}, {'x'.join(map(str, size))}"


def _settings(case: Case, width: int, height: int, **more: Any) -> RenderSettings:
    return replace(case.settings(width, splitting=1, **more), height=height)


def _self_test(card: Card, kernel: str) -> str:
    return str(run_self_test(card, kernel, limit_s=ITEM_LIMIT_S).reason) or "equal"


def _compare(made: Made, renderer: Callable[[], CardRenderer], name: str, quick: bool) -> str:
    """Returns whether the graphics card's film equals the CPU's to the bit."""
    pixels, spp = (32, 4) if quick else (COMPARED, COMPARED_SPP)
    case, scene = made(name)
    settings = case.settings(pixels)
    films = [render_frame(scene, settings, spp, card=each) for each in (renderer(), None)]
    differ = int((films[0] != films[1]).any(0).sum())
    if not differ:
        return "equal"
    found = f"card {digest(films[0])[:12]}, CPU {digest(films[1])[:12]}, {variant_for(settings, scene)}"
    return f"{differ} of {pixels * pixels} pixels differ ({found})"


def _speed(made: Made, renderer: Callable[[], CardRenderer] | None, name: str, size: tuple[int, int, int]) -> dict[str, float]:
    case, scene = made(name)
    return _timed(scene, _settings(case, *size[:2]), size, renderer)


def _speed_with(made: Made, card: Card, library: str, name: str, size: tuple[int, int, int], most: int) -> dict[str, float]:
    """Returns the speed with at most `most` paths under way."""
    case, scene = made(name)
    renderer = CardRenderer(card, library, most_paths=most)
    found = _timed(scene, _settings(case, *size[:2]), size, lambda: renderer)
    renderer.close()
    return found


def _error_of_card(made: Made, renderer: Callable[[], CardRenderer], name: str, size: tuple[int, int, int]) -> dict[str, float]:
    case, scene = made(name)
    settings = replace(case.settings(size[0]), height=size[1])

    def render(seed: int) -> Sums:
        return render_frame(scene, replace(settings, seed=seed), size[2], card=renderer())

    return _error(render, lambda sums: mean(sums, settings.film_exponent))


def _error(render: Callable[[int], Any], picture: Callable[[Any], np.ndarray]) -> dict[str, float]:
    """Returns the relative squared error of a picture without its bias, from pictures with other seeds, and its seconds."""
    pictures, seconds = [], []
    for seed in range(SEEDS + 1):
        begin = time.perf_counter()
        made = render(seed)
        seconds.append(time.perf_counter() - begin)
        pictures.append(picture(made))
    truth = np.mean(pictures[1:], 0)
    errors = [relative_error(each, truth) * SEEDS / (SEEDS - 1) for each in pictures[1:]]
    return {"error": float(np.mean(errors)), "seconds": min(seconds[1:])}


def _feature_speed(
    sizes: Sizes, renderer: Callable[[], CardRenderer] | None, name: str, size: tuple[int, int, int], more: dict[str, Any]
) -> dict[str, float]:
    case = CASES[name](sizes)
    materials = [replace(each, light_group="lamp") if max(each.emission) > 0 else each for each in case.description.materials]
    scene = compile_scene(replace(case.description, materials=materials))
    return _timed(scene, _settings(case, *size[:2], **more), size, renderer)


def _timed(
    scene: CompiledScene, settings: RenderSettings, size: tuple[int, int, int], renderer: Callable[[], CardRenderer] | None
) -> dict[str, float]:
    """Returns the millions of samples per second of the fastest run after a warm-up, and the seconds of the warm-up."""
    card = None if renderer is None else renderer()
    return _best(lambda _: render_frame(scene, settings, size[2], card=card), math.prod(size))


def _best(picture: Callable[[int], Any], samples: int) -> dict[str, float]:
    """picture: renders with a given seed."""
    seconds = []
    for seed in range(TRIES + 1):
        begin = time.perf_counter()
        picture(seed)
        seconds.append(time.perf_counter() - begin)
    return {"rate": round(samples / min(seconds[1:]) / 1e6, 2), "first": round(seconds[0], 2)}


def _live_rate(made: Made, renderer: Callable[[], CardRenderer], name: str, size: tuple[int, int]) -> dict[str, float]:
    """Returns the pictures per second of a view, and the milliseconds of a picture in the card's worker: rendered, and packed."""
    from protocol.sums import pack_sums

    (case, scene), (width, height) = made(name), size
    settings, whole = _settings(case, width, height), Tile(0, 0, width, height)
    places = [(y, x) for y in range(0, height, LIVE_SIDE) for x in range(0, width, LIVE_SIDE)]
    rendered, packed = [], []
    used = {*range(*COLOR.indices(SAMPLES)), SAMPLES}
    for number in range(TRIES + 2):
        begin = time.perf_counter()
        sums = render_batch(scene, settings, whole, number * LIVE_SPP, LIVE_SPP, renderer()).sums
        between = time.perf_counter()
        for y, x in places:
            pack_sums(sums[:, y : y + LIVE_SIDE, x : x + LIVE_SIDE], planes=used)
        rendered.append(between - begin)
        packed.append(time.perf_counter() - between)
    render, pack = min(rendered[1:]), min(packed[1:])
    return {"pictures": round(1 / max(render, pack), 1), "render_ms": round(1e3 * render, 1), "pack_ms": round(1e3 * pack, 1)}


def _denoise_ms(device: str, size: tuple[int, int]) -> dict[str, float]:
    """Returns the milliseconds of Open Image Denoise, in a separate process. Raises MissingError if the device cannot be used."""
    program = f"""
import sys, time
import numpy as np
from renderer import denoise
if not denoise.is_available():
    sys.exit({MISSING})
images = [np.random.default_rng(0).random(({size[1]}, {size[0]}, 3)).astype(np.float32) for _ in range(3)]
denoise._warn_once = lambda sentence: (print(sentence, file=sys.stderr), sys.exit({MISSING}))
seconds = []
for _ in range({TRIES + 1}):
    begin = time.perf_counter()
    denoise.denoise(*images)
    seconds.append(time.perf_counter() - begin)
print(1e3 * min(seconds[1:]))
"""
    done = _in_process([sys.executable, "-c", program], RAYFARM_DENOISER=device)
    return {"ms": round(float(done.splitlines()[-1]), 1)}


def _profile(made: Made, card: Card, library: str, name: str, size: tuple[int, int, int]) -> dict[str, float]:
    """Returns the milliseconds of each kernel in one film. The card is waited for after each launch, which takes time, too."""
    case, scene = made(name)
    seconds: dict[str, float] = {}
    renderer = CardRenderer(card, library, seconds)
    settings = _settings(case, *size[:2])
    render_frame(scene, settings, 1, card=renderer)
    seconds.clear()
    render_frame(scene, settings, size[2], card=renderer)
    renderer.close()
    return {kernel: round(1e3 * taken, 2) for kernel, taken in sorted(seconds.items(), key=lambda item: -item[1])}


def _counters(program: str, name: str, options: argparse.Namespace) -> str:
    """Writes Nsight Compute's report on the first turns of a small render; returns the path of its text."""
    command = [program, "--set", "full", "--launch-count", "60", sys.executable, "-m", "tests.benchmarks.bench_gpu"]
    report = options.state / "ncu.txt"
    report.write_text(_in_process([*command, "--once", name, f"--library={options.library}"]))
    return str(report)


def _once(options: argparse.Namespace, sizes: Sizes) -> int:
    found = find_cards(options.library)
    if not found.usable:
        print(" ".join(found.refused))
        return 1
    renderer = CardRenderer(found.usable[0], options.library)
    for name in _names(options):
        case = CASES[name](sizes)
        render_frame(compile_scene(case.description), _settings(case, 512, 512), 4, card=renderer)
    renderer.close()
    return 0


def _in_process(command: list[str], **variables: str) -> str:
    """Returns the output of a process; raises RuntimeError with its last line if it fails or takes too long."""
    done = subprocess.run(
        command, cwd=ROOT, env={**os.environ, **variables}, capture_output=True, text=True, check=False, timeout=ITEM_LIMIT_S
    )
    if done.returncode:
        reason = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        raise (MissingError if done.returncode == MISSING else RuntimeError)(reason)
    return done.stdout


# --- Mitsuba ------------------------------------------------------------------------------------------------------------------


def _mitsuba_process(name: str, size: tuple[int, int, int], quick: bool, *more: str) -> dict[str, float]:
    """Returns the speed of Mitsuba's cuda_ad_rgb, or with --error its error, in a process of its own."""
    command = [sys.executable, "-m", "tests.benchmarks.bench_gpu", "--mitsuba", "x".join(map(str, size)), "--scenes", name, *more]
    out = _in_process([*command, *(["--quick"] if quick else [])])
    return dict(json.loads(out.splitlines()[-1]))


def _mitsuba(options: argparse.Namespace, sizes: Sizes) -> int:
    """Prints Mitsuba's speed or error as JSON."""
    try:
        import mitsuba as mi

        mi.set_variant("cuda_ad_rgb")
        import drjit
    except ImportError as error:
        print(f"Mitsuba's cuda_ad_rgb cannot be used: {error}", file=sys.stderr)
        return MISSING
    width, height, spp = map(int, options.mitsuba.split("x"))
    (name,) = _names(options)
    scene = mitsuba_scene(mi, CASES[name](sizes), width, height, "multijitter" if options.error else "independent")

    def picture(seed: int) -> Any:
        made = mi.render(scene, spp=spp, seed=seed)
        drjit.eval(made)
        drjit.sync_thread()
        return made

    print(json.dumps(_error(picture, np.array) if options.error else _best(picture, width * height * spp)))
    return 0


def mitsuba_scene(mi: Any, case: Case, width: int, height: int, sampler: str = "independent") -> Any:
    """Returns a case's scene in Mitsuba, for pictures of width x height pixels. mi: the module, with a variant set."""
    from tests.peers.mitsuba_scene import mitsuba_dict

    with tempfile.TemporaryDirectory() as folder:
        made = mitsuba_dict(mi, case.twin or case.description, _settings(case, width, height), Path(folder))
        if case.theirs is not None:
            case.theirs(mi, made)
        made["sensor"]["sampler"] = {"type": sampler}
        return mi.load_dict(made)


# --- the table ----------------------------------------------------------------------------------------------------------------


def _print_table(results: Results) -> None:
    """Prints the results so far: speeds in millions of samples per second, and ratios."""
    speed, peer = results.of("speed"), results.of("mitsuba")
    own = {name.rpartition(", ")[0]: value["rate"] for name, value in results.of("cores").items()}
    print(f"\n{'M samples/s':<44}{'card':>9}{'Mitsuba':>9}{'ratio':>7}{'cores':>8}{'ratio':>7}{'first, s':>10}")
    to_mitsuba, to_cores = [], []
    for label, found in speed.items():
        theirs, cpu = peer.get(label, {}).get("rate"), own.get(label.rpartition(", ")[0])
        a, b = (found["rate"] / each if each else None for each in (theirs, cpu))
        to_mitsuba += [a] if a else []
        to_cores += [b] if b else []
        row = [found["rate"], theirs, a, cpu, b, found["first"]]
        print(f"{label:<44}" + "".join(_cell(value, width) for value, width in zip(row, (9, 9, 7, 8, 7, 10), strict=True)))
    means = [float(np.exp(np.mean(np.log(each)))) if each else None for each in (to_mitsuba, to_cores)]
    print(f"{'geometric mean':<62}{_cell(means[0], 7)}{_cell(means[1], 15)}")
    _print_errors(results.of("error"))
    for stage in ("features", "paths", "live", "denoise", "profile"):
        for name, value in results.of(stage).items():
            print(f"{stage}: {name}: {value if isinstance(value, str) else ', '.join(f'{k} {v}' for k, v in value.items())}")
    print()


def _print_errors(found: dict[str, Any]) -> None:
    """Prints how many times Mitsuba's squared error is ours: with as many samples, and in the same time."""
    ratios = []
    for name in CASES:
        ours, theirs = found.get(f"{name}, card"), found.get(f"{name}, Mitsuba")
        if ours and theirs:
            samples = theirs["error"] / ours["error"]
            ratios.append((samples, samples * theirs["seconds"] / ours["seconds"]))
            print(f"{f'error: {name}':<44}{ratios[-1][0]:>9.2f} for as many samples,{ratios[-1][1]:>7.2f} in the same time")
    if ratios:
        of_samples, in_time = np.exp(np.log(ratios).mean(0))
        print(f"{'error: geometric mean':<44}{of_samples:>9.2f} for as many samples,{in_time:>7.2f} in the same time")


def _cell(value: float | None, width: int) -> str:
    return f"{'-' if value is None else f'{value:.2f}':>{width}}"


if __name__ == "__main__":
    sys.exit(main())
