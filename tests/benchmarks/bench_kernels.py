"""Kernels for graphics cards: builds and assembles each, without a card, and holds registers, stack and spills to the budget.

    python3 farm.py bench kernels [--state build/kernels.jsonl] [--minutes 60] [KERNEL ...]

Needs ptxas (pip install nvidia-cuda-nvcc), and a core for some minutes a kernel. Each result is appended to the file of --state.
Kernels whose sources have not changed since are not built again, so that the same command continues; those whose PTX has not
changed are not assembled again. Exit code 1: a kernel exceeds its budget. 3: kernels are left.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from renderer import jit
from renderer.cuda.artefacts import ptx_of
from renderer.variant_names import kernel_names
from tests.renderer.cuda.budget import Used, architectures, assembled, find_assembler, over_budget

UNFINISHED = 3  # exit code


def main() -> None:
    """Measures the kernels that are missing in the file, and prints a table of all."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("kernels", nargs="*", metavar="KERNEL", help="named as by python -m renderer.cuda; by default all")
    parser.add_argument("--state", type=Path, default=Path("build/kernels.jsonl"), help="the file of results")
    parser.add_argument("--minutes", type=float, default=60, help="no kernel is begun after this time")
    parser.add_argument("--once", action="store_true", help=argparse.SUPPRESS)  # measure one kernel in this process
    options = parser.parse_args()
    if unknown := [name for name in options.kernels if name not in kernel_names()]:
        parser.error(f"there is no kernel {', '.join(unknown)}")
    assembler = find_assembler() or sys.exit("There is no ptxas (pip install nvidia-cuda-nvcc).")
    wanted = options.kernels or kernel_names()
    if options.once:
        measure(wanted[0], assembler, options.state)
        return
    options.state.parent.mkdir(parents=True, exist_ok=True)
    end, failed = time.monotonic() + 60 * options.minutes, []
    for name in wanted:
        if time.monotonic() < end and not is_current(entries(options.state).get(name)):
            # A process for each, as the compiler does not return its memory
            command = [sys.executable, "-m", "tests.benchmarks.bench_kernels", "--once", "--state", str(options.state), name]
            if subprocess.run(command, check=False).returncode:
                failed.append(name)
    found = {name: entry for name, entry in entries(options.state).items() if name in wanted and is_current(entry)}
    report(found)
    left = [name for name in wanted if name not in found]
    if left:
        print(f"{len(left)} of {len(wanted)} kernels are left{', failed: ' + ', '.join(failed) if failed else ''}")
    sys.exit(
        1 if failed or any(over for entry in found.values() for over in exceeding(entry).values()) else UNFINISHED * bool(left)
    )


def entries(state: Path) -> dict[str, dict[str, Any]]:
    """Returns the last entry of each kernel in the file, by name."""
    found = {}
    for line in state.read_text().splitlines() if state.exists() else ():
        with suppress(ValueError):  # a line that was cut off
            entry = json.loads(line)
            found[entry["kernel"]] = entry
    return found


def is_current(entry: dict[str, Any] | None) -> bool:
    """Returns whether a kernel was measured with the present sources."""
    return entry is not None and entry["sources"] == jit.cache_folder().name


def measure(name: str, assembler: str, state: Path) -> None:
    """Builds and assembles a kernel and appends the result to the file."""
    begun = time.process_time()
    ptx = ptx_of(name)
    built = time.process_time() - begun
    digest = hashlib.sha256(ptx.encode()).hexdigest()[:16]
    before = entries(state).get(name)
    if before is not None and before["ptx"] == digest:
        entry = before | {"sources": jit.cache_folder().name}
    else:
        used, spent = {}, _children()
        with tempfile.TemporaryDirectory(prefix="rayfarm-bench-") as folder:
            path = Path(folder) / "kernel.ptx"
            path.write_text(ptx)
            for architecture in architectures(assembler):
                used[architecture] = assembled(assembler, path, architecture)
        entry = {
            "kernel": name,
            "sources": jit.cache_folder().name,
            "ptx": digest,
            "ptx_bytes": len(ptx),
            "build_s": round(built, 1),
            "assemble_s": round(_children() - spent, 1),
            "used": used,
        }
    with state.open("a") as out:
        out.write(f"{json.dumps(entry)}\n")
    over = [f"{kernel} {', '.join(map(str, used))}" for each in exceeding(entry).values() for kernel, used in each.items()]
    print(
        f"{name}: {len(ptx) / 1e6:.1f} MB, built in {entry['build_s']} s, assembled in {entry['assemble_s']} s of processor time"
        f"{': over its budget: ' + '; '.join(over) if over else ''}",
        flush=True,
    )


def exceeding(entry: dict[str, Any]) -> dict[str, dict[str, Used]]:
    """Returns the kernels of an entry over their budget, by architecture."""
    return {name: over_budget(entry["kernel"], used) for name, used in _used(entry)}


def report(found: dict[str, dict[str, Any]]) -> None:
    """Prints the largest stack, spills and registers of each kernel, of all variants that were measured, and its variants."""
    if not found:
        return
    print(f"{len(found)} kernels: PTX {_range(entry['ptx_bytes'] / 1e6 for entry in found.values())} MB, processor time to build")
    print(
        f"{_range(entry['build_s'] for entry in found.values())} s, to assemble twice "
        f"{_range(entry['assemble_s'] for entry in found.values())} s"
    )
    stages = sorted({kernel for entry in found.values() for _, used in _used(entry) for kernel in used})
    print(f"{'kernel':20} {'stack':>6} {'of':40} {'spills':>6} {'of':40} {'registers':>9}")
    for stage in stages:
        all_used = [(used[stage], name) for name, entry in found.items() for _, used in _used(entry) if stage in used]
        (stack, of_stack), (spills, of_spills) = (max((used[k], name) for used, name in all_used) for k in (0, 1))
        registers = max(used.registers for used, _ in all_used)
        print(f"{stage:20} {stack:6} {of_stack:40} {spills:6} {of_spills:40} {registers:9}")
    for name, entry in found.items():
        for architecture, over in exceeding(entry).items():
            for kernel, used in over.items():
                print(f"over its budget: {name} for {architecture}: {kernel}: {used}")


def _used(entry: dict[str, Any]) -> Iterator[tuple[str, dict[str, Used]]]:
    for architecture, kernels in entry["used"].items():
        yield architecture, {kernel: Used(*used) for kernel, used in kernels.items()}


def _children() -> float:
    """Returns the processor time of ended child processes, in seconds."""
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime


def _range(values: Iterator[float]) -> str:
    found = sorted(values)
    return f"{found[0]:.1f} to {found[-1]:.1f} (median {found[len(found) // 2]:.1f})"


if __name__ == "__main__":
    main()
