"""Cost of a shot with very many frames: each request in turn, and how long it blocks the service's other work.

    python3 farm.py bench long_shot [--frames 100000] [--database postgresql] [--finished]

For each request: wall seconds, and processor seconds of the whole service; the longest time for which a transaction held the
database, in wall and thread time; the longest delay of the event loop and the longest round of the engine. Only a few frames are
rendered; with `--finished` all are marked as rendered, which makes their rows large.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sqlalchemy import update
from sqlalchemy.orm import Session

from service.events import RowWritten
from service.scheduling.engine import Engine
from service.store.database import Sessions
from service.store.models import Frame, Job
from tests.helpers import running_redis
from tests.service.conftest import Service, until
from tests.service.store.postgres import PostgresServer, find_postgres

ASK_EVERY_S = 0.02
SIZE = {"width": 64, "height": 48, "spp": 4}


class Watched:
    """Watches the service, and stores maxima since `reset`: of transaction time, event loop delay, and time of an engine step."""

    def __init__(self) -> None:
        self.held = self.held_processor = self.late = self.round = 0.0
        self.stop = threading.Event()

    def reset(self) -> None:
        self.held = self.held_processor = self.late = self.round = 0.0

    def watch_transactions(self) -> None:
        begin = Sessions.begin

        @contextmanager
        def timed(sessions: Sessions) -> Iterator[Session]:
            with begin(sessions) as session:
                session.connection()  # takes the database lock
                began, processor = time.monotonic(), time.thread_time()
                yield session
            self.held = max(self.held, time.monotonic() - began)
            self.held_processor = max(self.held_processor, time.thread_time() - processor)

        Sessions.begin = timed  # type: ignore[method-assign]

    def watch_engine(self) -> None:
        step = Engine._step

        def timed(engine: Engine) -> None:
            processor = time.thread_time()
            try:
                step(engine)
            finally:
                self.round = max(self.round, time.thread_time() - processor)

        Engine._step = timed  # type: ignore[method-assign]

    def watch_loop(self, loop: Any) -> None:
        def ask() -> None:
            while not self.stop.wait(ASK_EVERY_S):
                asked = time.monotonic()
                with contextlib.suppress(RuntimeError):
                    loop.call_soon_threadsafe(lambda asked=asked: self.answer(asked))

        threading.Thread(target=ask, daemon=True).start()

    def answer(self, asked: float) -> None:
        self.late = max(self.late, time.monotonic() - asked)


class Measured:
    """Prints a table of measurements: each call of the object measures one request, and prints the row for it."""

    def __init__(self, watched: Watched) -> None:
        self.watched = watched
        print("|  | s | processor s | database held, s | of a processor | loop late, s | engine's round, processor s |")
        print("|---|---|---|---|---|---|---|", flush=True)

    def __call__(self, what: str, action: Callable[[], Any]) -> Any:
        self.watched.reset()
        began, processor = time.monotonic(), time.process_time()
        found = action()
        took, used = time.monotonic() - began, time.process_time() - processor
        w = self.watched
        numbers = (took, used, w.held, w.held_processor, w.late, w.round)
        print(f"| {what} | " + " | ".join(f"{number:.2f}" for number in numbers) + " |", flush=True)
        return found


def main() -> int:
    options = _options()
    watched = Watched()
    watched.watch_transactions()
    watched.watch_engine()
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="rayfarm-long-shot-")))
        redis_server = running_redis(folder)
        redis_server.start()
        stack.callback(redis_server.stop)
        settings: dict[str, Any] = {}
        if options.database == "postgresql":
            binaries = find_postgres()
            assert binaries is not None, "there is no PostgreSQL on this machine"
            server = PostgresServer(binaries)
            stack.callback(server.stop)
            settings["database_url"] = server.new()
        service = Service(folder / "data", redis_server, **settings)
        watched.watch_loop(service.farm.broadcast._loop)
        run(service, Measured(watched), options)
        watched.stop.set()
        service.stop()
    return 0


def run(service: Service, measured: Measured, options: argparse.Namespace) -> None:
    http, last = service.http, options.frames - 1
    http.timeout = 600
    with service.worker():
        scene = service.ready_scene()
    body = {"scene": scene, "frames": f"0-{last}", **SIZE}
    job = measured("POST", lambda: http.post("/api/jobs", json=body).raise_for_status().json())["id"]
    patch = lambda **change: http.patch(f"/api/jobs/{job}", json=change).raise_for_status().json()  # noqa: E731
    get = lambda path: http.get(f"/api/jobs{path}").raise_for_status()  # noqa: E731
    measured("the engine takes it up", lambda: until(lambda: job in service.farm.engine.snapshot.jobs, "it is taken up", 300))
    measured("GET, as it waits", lambda: get(f"/{job}"))
    measured("PATCH priority", lambda: patch(priority=3))
    if options.finished:
        finish(service, job)
    measured("the list of jobs", lambda: get(""))
    measured("GET", lambda: get(f"/{job}"))
    measured("GET again", lambda: get(f"/{job}"))
    measured("its frames", lambda: get(f"/{job}/frames"))
    measured("a page of them", lambda: get(f"/{job}/frames?limit=1000&offset=50000"))
    measured("PATCH spp of all", lambda: patch(spp=8))
    measured("PATCH more of 100", lambda: patch(more=1, frames="100-199"))
    measured("PATCH all again", lambda: patch(again=f"0-{last}"))
    measured("PATCH order", lambda: patch(order="breadth-first"))
    patch(order="in-turn")
    measured("PATCH one first", lambda: patch(first=last))
    with service.worker():
        measured(
            "200 frames are rendered",
            lambda: until(lambda: service.job(job)["shot"]["states"].get("finished", 0) >= 200, "they are", 300),
        )
    measured("cancel", lambda: patch(state="cancelled"))
    measured("go on", lambda: patch(state="running"))
    until(lambda: job in service.farm.engine.snapshot.jobs, "it is taken up", 300)
    measured("restart of the service", service.restart)
    http = service.http  # a restart ends the previous client
    http.timeout = 600
    measured("it is taken up", lambda: until(lambda: job in service.farm.engine.snapshot.jobs, "it is taken up", 300))
    measured("HEAD of all in a zip", lambda: http.head(f"/api/jobs/{job}/frames.zip?which=all"))
    measured("200 frames in a zip", lambda: get(f"/{job}/frames.zip?which=finished&format=png"))
    measured("DELETE", lambda: http.delete(f"/api/jobs/{job}").raise_for_status())


def finish(service: Service, job: str) -> None:
    """Marks all frames of the job as rendered in the database."""
    settings = service.job(job)["settings"]
    with service.farm.sessions.begin() as session:
        done = {"state": "finished", "samples": 4 * 64 * 48, "target": 4 * 64 * 48, "progress": 1.0, "settings": settings}
        session.execute(update(Frame).where(Frame.job == job).values(noise=0.1, **done))
        session.execute(update(Job).where(Job.id == job).values(state="finished", finished=time.time(), shot=_anew(session, job)))
    service.farm.events.publish(RowWritten("job", job))
    until(lambda: job not in service.farm.engine.snapshot.jobs, "it is let go", 60)


def _anew(session: Session, job: str) -> Any:
    row = session.get(Job, job)
    assert row is not None and row.shot is not None
    return {**row.shot, "revision": row.shot["revision"] + 1}  # invalidates the engine's own copy


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=100_000)
    parser.add_argument("--database", choices=["sqlite", "postgresql"], default="sqlite")
    parser.add_argument("--finished", action="store_true")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
