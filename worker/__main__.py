"""`python -m worker --service URL --token T --slots N`: runs one worker, with a process for every slot.

The plain kernel is loaded before Celery forks, so that all slots share it. If it has to be compiled, another process does that:
meanwhile the slots read scenes and store their previews, and whatever needs a kernel waits for it.
"""

# ruff: noqa: E402 - the environment must be set before numpy is imported

from __future__ import annotations

import atexit
import gc
import os

gc.disable()  # during imports, where repeated collections take a fifteenth of the time

# Slots are processes; thread pools inside them would compete for the same cores.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")


import argparse
import logging
import signal
import socket
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from protocol import blends
from protocol.contract import WorkerReport
from protocol.redis_tls import with_password
from protocol.site import SITE, SITE_NAME
from protocol.terms import TAG, Terms
from renderer import denoise, jit
from renderer.blender import program
from renderer.blender.program import Blender
from renderer.confine.running import confinement
from renderer.cuda.cards import (
    CHOICES,
    NOT_YET_TRIED,
    CardsError,
    chosen_cards,
    described,
    find_cards_before_fork,
    has_driver,
    has_nvidia_hardware,
    reasons_unused,
)
from renderer.cuda.driver import Card
from renderer.printable import printable
from renderer.render import FULL, PLAIN
from renderer.sentences import Sentence
from renderer.shipped_kernels import copy_shipped_kernels
from renderer.variables import VariableError, value_of
from telemetry.log_lines import FORMAT_VARIABLE, FORMATS, uses_json
from worker import app
from worker.exchange.cache import BlobCache, default_cache_dir
from worker.exchange.errors import RefusedError, WorkerError
from worker.exchange.kernel_precompile import precompile_kernels
from worker.exchange.link import Link, check_redis_url
from worker.exchange.ready import load_or_fetch_kernel
from worker.joining import TRANSPORTS, FarmJoin
from worker.machine import health_file
from worker.machine.cards_worker import EXIT_NO_CARDS, EXIT_REFUSED, CardsWorker
from worker.machine.health_file import WorkerState
from worker.machine.joint_pieces import Pieces
from worker.machine.status import SlotBoard
from worker.process import context
from worker.process.apply_terms import TermsKeeper
from worker.process.context import WorkerContext, cpu_name
from worker.telemetry import logs
from worker.work.card_self_test import check_cards
from worker.work.files import memory_budget
from worker.work.reader import begin_launcher

gc.freeze()  # excludes the imported modules from collections, which saves a tenth of a second each
atexit.register(gc.unfreeze)  # otherwise OpenImageIO lists its objects on standard error, as if they had leaked
gc.enable()


def main(arguments: Sequence[str] | None = None) -> int:
    """Joins the farm, loads or compiles the kernels, and processes tasks. Returns the exit code.

    Exit code 3: the address is not that of a farm, or the farm rejects this worker, so a restart does not help.
    """
    options = _options(arguments)
    if options.log_format:
        os.environ[FORMAT_VARIABLE] = options.log_format  # inherited by child processes
    try:
        options.token = options.token or value_of("RAYFARM_TOKEN")
        options.redis = with_password(options.redis or value_of("RAYFARM_REDIS_URL"), value_of("RAYFARM_REDIS_PASSWORD")) or None
        return _run_worker(options, arguments)
    except (WorkerError, VariableError) as error:
        if uses_json():
            logging.getLogger("worker").error("%s", error)
        else:
            print(printable(f"rayfarm worker: {error}"), file=sys.stderr)
        return EXIT_REFUSED


def _run_worker(options: argparse.Namespace, arguments: Sequence[str] | None) -> int:
    tail, lines = logs.set_up()
    health_file.write_state(WorkerState.STARTING)
    blender = _check_settings(options)
    link = Link(options.service, options.token)
    cards, cards_unused = _choose_cards(options, link)
    if options.paired and options.gpu == "auto" and not cards:
        return EXIT_NO_CARDS
    log = logging.getLogger("worker")
    stopping: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: stopping.append(number))
    signal.signal(signal.SIGINT, lambda number, _: stopping.append(number))

    host = socket.gethostname()
    kind = jit.kind()
    started = time.time()

    def starting(name: str) -> WorkerReport:
        return WorkerReport(
            name, host, os.getpid(), options.slots, cpu_name(), kind, "starting", started, denoises=denoise.is_available()
        )

    copy_shipped_kernels(jit.cache_folder())
    joining = FarmJoin(link, options.redis, options.name or host, host, starting, log.info, _transport(options))
    joining.begin()
    begin_launcher()  # loads its modules while this process loads the kernel
    keeping = TermsKeeper(options.slots, _tags(options, host, kind), _command_line_terms(options))
    has_plain = load_or_fetch_kernel(link)
    ahead = [PLAIN, FULL] if keeping.may_precompile() else [PLAIN]
    if not has_plain:
        precompile_kernels(link, ahead)
    joined = joining.finish(lambda: bool(stopping))
    if joined is None or stopping:
        return 0
    cache = BlobCache(link, joined.farm, options.cache, options.cache_bytes)
    cache.check()
    confined, is_whole = confinement()
    log.log(logging.INFO if is_whole else logging.WARNING, confined)
    cards_worker = _cards_worker(options, arguments, joined.name)
    worker = WorkerContext(
        name=joined.name,
        slots=options.slots,
        kind=kind,
        redis_url=joined.redis_url,
        link=link,
        cache=cache,
        board=SlotBoard(options.slots),
        started=started,
        tail=tail,
        blender=blender,
        cards=cards,
        cards_unused=cards_unused,
        is_beside_cpu=options.paired,
        cards_worker=cards_worker,
        keeping=keeping,
        pieces=_create_pieces(log),
        is_over_https=joined.relay is not None,
    )
    for number, card in enumerate(cards):
        log.info("slot %d renders with card %s (%s)", number, described(card), NOT_YET_TRIED)
    if lines is not None:
        lines.always["worker"] = joined.name
    way = " over HTTPS" if joined.relay is not None else ""
    log.info("%s: %d slots for %s%s", joined.name, options.slots, options.service, way)
    if has_plain:
        precompile_kernels(link, ahead)
    try:
        code = app.run(worker)
        return EXIT_REFUSED if worker.is_refused else code
    finally:
        if cards_worker is not None:
            cards_worker.stop()
            cards_worker.wait()
        if joined.relay is not None:
            joined.relay.stop()


def _cards_worker(options: argparse.Namespace, arguments: Sequence[str] | None, name: str) -> CardsWorker | None:
    """Returns the second worker, which renders with graphics cards; None if there is none beside this one.

    name: of this worker.
    """
    if options.paired or options.gpu in ("none", "only") or (options.gpu == "auto" and not has_driver()):
        return None

    def fail() -> None:
        context.current().is_refused = True
        os.kill(os.getpid(), signal.SIGTERM)

    given = sys.argv[1:] if arguments is None else arguments
    return CardsWorker(options.gpu, given, f"{name}-gpu", options.token, fail)


def _create_pieces(log: logging.Logger) -> Pieces | None:
    try:
        return Pieces()
    except OSError as error:
        log.warning("slots send their sums separately, since the folder for adding them up cannot be created: %s", error)
        return None


def _options(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m worker", description="A worker of the farm; `rayfarm worker` starts one.")
    parser.add_argument("--service", required=True, help="the service's address, as http://host:8000")
    parser.add_argument("--token", default="", help="the farm's token; $RAYFARM_TOKEN, or the file $RAYFARM_TOKEN_FILE")
    parser.add_argument("--slots", type=_positive, default=os.cpu_count() or 1, help="batches rendered at a time")
    parser.add_argument(
        "--gpu",
        default="auto",
        help=f"NVIDIA cards that render, in a slot each of a second worker NAME-gpu: {CHOICES}; auto: those that pass the "
        f"self-test; only: all, in this process and without cores; {NOT_YET_TRIED}",
    )
    parser.add_argument(
        "--paired",
        action="store_true",
        help="another worker on this machine renders with the cores, and this one with the cards of --gpu",
    )
    parser.add_argument(
        "--transport",
        choices=TRANSPORTS,
        default="auto",
        help="how to reach the farm's queue: redis; https: through the service alone; auto: Redis if this machine reaches it",
    )
    parser.add_argument("--redis", help="URL of the broker (default: the one that the service names); $RAYFARM_REDIS_URL")
    parser.add_argument("--name", help="name of this worker on the farm (default: the host name)")
    parser.add_argument(
        "--log-format", choices=FORMATS, help=f"json: each line of the log an object, for programs; ${FORMAT_VARIABLE}"
    )
    parser.add_argument("--cache", type=Path, default=default_cache_dir(), help="folder for fetched scenes")
    parser.add_argument("--cache-bytes", type=int, default=32 << 30, help="maximum size of all cached scenes together, in bytes")
    parser.add_argument(
        "--blender",
        nargs="?",
        const="",
        help="open .blend files by this Blender, or by this Python with bpy (default: the one that is found)",
    )
    parser.add_argument("--tag", action="append", default=[], help="tag that jobs can require; repeatable")
    parser.add_argument("--site", default="", help="name of the site whose `rayfarm site` adds up this worker's sums")
    parser.add_argument("--hours", default="", help="working hours, such as Mon-Fri 19:00-07:00, Sat-Sun (default: always)")
    parser.add_argument("--idle", type=float, default=0.0, help="minutes without activity of a user before it renders")
    parser.add_argument("--nice", type=int, default=None, help="Unix niceness, 0 to 19: higher yields more to other programs")
    parser.add_argument("--memory", type=float, default=0.0, help="GB of memory to use (default: all)")
    options = parser.parse_args(arguments)
    if _renders_with_cards(options) and options.paired:
        options.blender = None  # the worker with the cores opens files
    return options


def _transport(options: argparse.Namespace) -> str:
    """Returns how to reach the queue, one of TRANSPORTS. A worker of a site uses Redis, where the reducer's address is."""
    return "redis" if options.site and options.transport == "auto" else str(options.transport)


def _tags(options: argparse.Namespace, host: str, kind: str) -> tuple[str, ...]:
    """Returns the worker's tags, which jobs can require: those from the command line, and automatic ones such as its host."""
    able = [*(["denoiser"] if denoise.is_available() else []), *([blends.TAG] if options.blender is not None else [])]
    where = [f"host:{host.lower()}", *([f"{SITE}{options.site}"] if options.site else [])]
    own = [*where, *able, f"kind:{kind.lower()}"]
    return tuple(dict.fromkeys([*options.tag, *own]))


def _command_line_terms(options: argparse.Namespace) -> Terms:
    """Returns the limits on the use of this machine that the command line sets. Raises ValueError if one is out of range."""
    memory = round(options.memory * 1e9)
    return Terms(options.hours, options.idle, options.nice, memory=memory).checked()


def _check_settings(options: argparse.Namespace) -> Blender | None:
    """Checks the settings that would otherwise make the first task fail. Returns the Blender to use, or None.

    Raises RefusedError if a setting is invalid.
    """
    try:
        if options.redis:
            check_redis_url(options.redis)
    except ValueError as error:
        raise RefusedError(f"--redis or RAYFARM_REDIS_URL: {error}") from None
    if options.transport == "https" and options.redis:
        raise RefusedError(
            Sentence("transport-redis-conflict", "--transport https uses no Redis; leave --redis and RAYFARM_REDIS_URL out.")
        )
    if options.transport == "https" and options.site:
        raise RefusedError(
            Sentence(
                "transport-site-conflict", "--transport https sends results to the service, and not to a --site; leave one out."
            )
        )
    try:
        _command_line_terms(options)
    except (ValueError, OverflowError) as error:
        raise RefusedError(str(error)) from None
    if options.site and not SITE_NAME.fullmatch(options.site):
        raise RefusedError(f"--site: {options.site!r} is not a site name; use lower-case letters, digits and . _ -")
    if wrong := [tag for tag in options.tag if not TAG.fullmatch(tag)]:
        raise RefusedError(f"--tag: {wrong[0]!r} is not a tag; use lower-case letters, digits and . _ : -")
    if blends.TAG in options.tag and options.blender is None:
        raise RefusedError(f"--tag {blends.TAG}: this tag marks workers that open .blend files; give --blender")
    try:
        memory_budget()
    except ValueError:
        raise RefusedError("RAYFARM_PREPARE_MEMORY_MB is a number of megabytes, as 4000") from None
    return _inspect_blender(options.blender) if options.blender is not None else None


def _choose_cards(options: argparse.Namespace, link: Link) -> tuple[tuple[Card, ...], tuple[str, ...]]:
    """Returns the graphics cards that this process's slots use, and for each other card a sentence on why it is not used.

    Tests the cards. Sets `options.slots` to the number of cards if there are any. Raises RefusedError if a requested card is
    missing, cannot be used, or fails the self-test.
    """
    if not _renders_with_cards(options):
        is_searched = options.gpu == "none" and not options.paired and has_nvidia_hardware()
        return (), tuple(reasons_unused(find_cards_before_fork(), ())) if is_searched else ()
    found = find_cards_before_fork()
    try:
        chosen, _ = chosen_cards(options.gpu, found)
    except CardsError as error:
        raise RefusedError(str(error)) from None
    passed, failures = check_cards(link, chosen)
    if failures and options.gpu != "auto":
        raise RefusedError(f"--gpu {options.gpu}: {' '.join(failures)}")
    options.slots = len(passed) or options.slots
    return tuple(passed), (*reasons_unused(found, chosen), *failures)


def _renders_with_cards(options: argparse.Namespace) -> bool:
    """Returns True if the slots of this process render with graphics cards."""
    return bool(options.gpu == "only" or (options.paired and options.gpu != "none"))


def _inspect_blender(named: str) -> Blender:
    """Returns the Blender at the path `named`, or any Blender found if it is empty. Raises RefusedError if none can be used."""
    try:
        found = program.inspect_blender(named) if named else program.find()
    except program.BlenderError as error:
        raise RefusedError(f"--blender: {error}") from None
    if found is None:
        raise RefusedError(
            "--blender: no Blender found. Install it so that `blender` is on the PATH, or give its path: --blender PROGRAM; "
            "`rayfarm worker --blender` can fetch one"
        )
    os.environ[program.NAMED] = found.program  # inherited by the slots
    return found


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise ValueError
    return number


if __name__ == "__main__":
    sys.exit(main())
