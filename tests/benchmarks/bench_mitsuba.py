"""Side by side with Mitsuba 3: the Cornell box at 512x512, depth 8, box filter, on all cores, rounds interleaved.

    python -m tests.benchmarks.bench_mitsuba [--spp 64] [--rounds 5] [--json FILE] [--markdown FILE]

Both render once before the clock starts, so neither's compilation counts. What is compared is the best round of each and
the median of the rounds' ratios: a ratio within one run holds on other machines, the absolute values do not. The ratio of
CPU times is what remains comparable where other work shares the machine.
Needs the extra `test` (Mitsuba is in it) and LLVM 16 or newer for Mitsuba's LLVM variant.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import statistics
import time
from pathlib import Path
from typing import Any

from renderer.film import mean
from renderer.render import RenderStats, render_frame, warm_up
from renderer.scene.compile import compile_scene
from renderer.scene.load import read
from renderer.settings import RenderSettings, View

SIZE = 512
DEPTH = 8
SCENES = Path(__file__).parents[2] / "scenes"


def _find_llvm() -> None:
    """Points Dr.Jit at the newest LLVM library of the system, unless the caller has."""
    found = {
        int(number.group(1)): path for path in Path("/usr/lib").glob("*/libLLVM*") if (number := re.search(r"(\d+)", path.name))
    }
    if found:
        os.environ.setdefault("DRJIT_LIBLLVM_PATH", str(found[max(found)]))


def _mitsuba(variant: str, spp: int) -> tuple[Any, Any]:
    """Mitsuba and its Cornell box at the benchmark's settings."""
    import mitsuba as mi

    mi.set_variant(variant)
    scene = mi.cornell_box()
    scene["sensor"]["film"] = {
        "type": "hdrfilm",
        "width": SIZE,
        "height": SIZE,
        "rfilter": {"type": "box"},
        "pixel_format": "rgb",
    }
    scene["sensor"]["sampler"] = {"type": "independent", "sample_count": spp}
    scene["integrator"] = {"type": "path", "max_depth": DEPTH}
    return mi, mi.load_dict(scene)


def run(spp: int, rounds: int, variant: str) -> dict[str, Any]:
    """Interleaved rounds; samples per second of each, and their ratios."""
    import numpy as np

    _find_llvm()
    mi, theirs = _mitsuba(variant, spp)
    compile_s = warm_up()
    ours = compile_scene(read(SCENES, "cornell-box.yaml"))
    settings = RenderSettings(SIZE, SIZE, View((0, 0, 3.9), (0, 0, 0), (0, 1, 0), 39.3077), max_depth=DEPTH, filter="box")
    samples = SIZE * SIZE * spp

    def render_theirs(seed: int) -> Any:
        return np.array(mi.render(theirs, spp=spp, seed=seed))

    render_theirs(0)
    render_frame(ours, settings, 1)
    their_rates, our_rates, cpu_ratios = [], [], []
    stats = RenderStats()
    for k in range(rounds):
        wall, cpu = time.perf_counter(), time.process_time()
        their_image = render_theirs(k + 1)
        their_rates.append(samples / (time.perf_counter() - wall))
        their_cpu = time.process_time() - cpu
        wall, cpu = time.perf_counter(), time.process_time()
        sums = render_frame(ours, settings, spp, stats=stats)
        our_rates.append(samples / (time.perf_counter() - wall))
        cpu_ratios.append(their_cpu / (time.process_time() - cpu))
        print(
            f"round {k}: {variant} {their_rates[-1] / 1e6:.2f}, ours {our_rates[-1] / 1e6:.2f} M samples/s,"
            f" ratio {our_rates[-1] / their_rates[-1]:.2f}, by CPU time {cpu_ratios[-1]:.2f}",
            flush=True,
        )
    return {
        "scene": f"Cornell box {SIZE}x{SIZE}, {spp} spp, depth {DEPTH}",
        "peer": f"mitsuba {mi.__version__} {variant}",
        "cpus": len(os.sched_getaffinity(0)),
        "peer_samples_per_s": max(their_rates),
        "our_samples_per_s": max(our_rates),
        "our_rays_per_s": stats.rays / stats.samples * max(our_rates),
        "ratio_of_best": max(our_rates) / max(their_rates),
        "ratio_median": statistics.median(a / b for a, b in zip(our_rates, their_rates, strict=True)),
        "ratio_of_cpu_time": statistics.median(cpu_ratios),
        "peer_mean": float(their_image.mean()),
        "our_mean": float(mean(sums, settings.film_exponent).mean()),
        "kernel_ready_s": compile_s,
    }


def markdown(result: dict[str, Any]) -> str:
    """The result as a small table."""
    rows = [
        ("", result["peer"], "Rayfarm"),
        ("M samples/s (best round)", f"{result['peer_samples_per_s'] / 1e6:.2f}", f"{result['our_samples_per_s'] / 1e6:.2f}"),
        ("image mean", f"{result['peer_mean']:.4f}", f"{result['our_mean']:.4f}"),
    ]
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    lines.insert(1, "|---|---|---|")
    ratios = [f"{result[key]:.2f} {what}" for key, what in (("ratio_of_best", "of the best rounds"), ("ratio_median", "median"))]
    ratios.append(f"{result['ratio_of_cpu_time']:.2f} by CPU time")
    return f"{result['scene']}, {result['cpus']} CPUs\n\n" + "\n".join(lines) + f"\n\nRatio: {', '.join(ratios)}\n"


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--variant", default="llvm_ad_rgb", choices=("llvm_ad_rgb", "scalar_rgb"))
    parser.add_argument("--json", type=Path)
    parser.add_argument("--markdown", type=Path)
    options = parser.parse_args()
    result = run(options.spp, options.rounds, options.variant)
    text = markdown(result)
    print(text)
    if options.json:
        options.json.write_text(json.dumps(result, indent=2) + "\n")
    if options.markdown:
        options.markdown.write_text(text)


if __name__ == "__main__":
    main()
