"""Retention rules: deletes films, compiled scenes and uploads by age and by total size, except those of pinned jobs.

Without rules, which is the default, nothing is deleted. What can be deleted, and how to get it back:

film      of a finished job: the job and its request stay, and setting it to running renders the same bits again
compiled  of a scene unused for long: compiled again at its next use
upload    a scene that no job needs, unused for long: it has to be uploaded again

A pinned job keeps its film, and the upload that it was rendered from.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Literal

from sqlalchemy import func, or_, select
from sqlalchemy.orm import Session

from renderer.sentences import Sentence
from service.errors import Conflict, FarmError
from service.events import Events, RowWritten
from service.store.database import Sessions
from service.store.film_faults import FILM
from service.store.film_store import FilmStore
from service.store.garbage import Garbage
from service.store.models import ACTIVE_STATES, FINAL_STATES, Job, Scene
from service.store.reserve import Reserve

__all__ = ["Item", "Retention", "Rules", "Run", "WallClock"]

DAY_S = 86400.0
EVERY_S = 3600.0
FIRST_RUN_AFTER_S = 600.0  # seconds after the start, since the clock of a machine may be wrong after power-on
MAX_CLOCK_JUMP_S = 600.0

log = logging.getLogger(__name__)


class WallClock:
    """Detects that the wall clock was set, by comparing it with the time since boot."""

    def __init__(self) -> None:
        self._apart = time.time() - _since_boot()

    def jumped_s(self) -> float:
        """Returns the seconds by which the wall clock was set since the last call: positive if forward, negative if back."""
        before, self._apart = self._apart, time.time() - _since_boot()
        return self._apart - before


def _since_boot() -> float:
    """Returns the seconds since boot, including time in standby on systems that measure it."""
    return time.clock_gettime(time.CLOCK_BOOTTIME) if hasattr(time, "CLOCK_BOOTTIME") else time.monotonic()


@dataclass(frozen=True)
class Rules:
    """Retention rules: maximum ages in days since the last use, and maximum sizes in bytes. None: no limit."""

    films_days: float | None = None
    films_bytes: int | None = None
    compiled_days: float | None = None
    uploads_days: float | None = None

    @property
    def is_empty(self) -> bool:
        """Returns True if there are no limits."""
        return self == Rules()


@dataclass(frozen=True)
class Item:
    """An item that the rules allow to delete: a film, the compiled form of a scene, or an upload.

    bytes: size on disk. Data that several scenes share counts in the size of each.
    """

    what: Literal["film", "compiled", "upload"]
    id: str
    name: str
    bytes: int
    age_s: float
    why: str


@dataclass
class Run:
    """Progress of a deletion that `Retention.begin` has started. Only its thread changes it."""

    state: Literal["running", "finished", "failed", "stopped"] = "running"
    planned: int | None = None  # number of items; None during the search
    done: int = 0  # deleted items
    gone: list[Item] = field(default_factory=list)
    error: str | None = None


class Retention:
    """Applies the retention rules once an hour. `deletable_items` and `carry_out` are thread-safe.

    After the clock was set forward, it deletes nothing that hour, since deletion is final.
    """

    def __init__(
        self,
        sessions: Sessions,
        films: FilmStore,
        garbage: Garbage,
        reserve: Reserve,
        events: Events,
        rules: Rules,
    ) -> None:
        self._sessions = sessions
        self._films = films
        self._garbage = garbage
        self._reserve = reserve
        self._events = events
        self._rules = rules
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="retention", daemon=True)
        self._asked_lock = threading.Lock()
        self._asked_thread: threading.Thread | None = None
        self.latest: Run | None = None  # latest request since the service started

    def start(self) -> None:
        """Starts the thread if there are rules."""
        if not self._rules.is_empty:
            self._thread.start()

    def stop(self) -> None:
        """Stops the thread after the item that it is deleting."""
        self._stopping.set()
        for thread in (self._thread, self._asked_thread):
            if thread is not None and thread.is_alive():
                thread.join(5)

    def _run(self) -> None:
        pause_s, clock = FIRST_RUN_AFTER_S, WallClock()
        while not self._stopping.wait(pause_s):
            pause_s = EVERY_S
            if (ahead_s := clock.jumped_s()) > MAX_CLOCK_JUMP_S:
                log.warning(
                    "the clock was set forward by %.0f s: nothing is deleted by age for an hour. Check the clock.", ahead_s
                )
                continue
            try:
                self.carry_out(self.deletable_items(self._rules))
            except FarmError as error:
                log.warning("retention is postponed: %s", error)
            except Exception:
                log.exception("unexpected error while retention rules were evaluated")

    def begin(self, rules: Rules) -> Run:
        """Starts a thread that deletes by these rules, and returns its progress. Raises Conflict if a deletion is in progress."""
        with self._asked_lock:
            if self.latest is not None and self.latest.state == "running":
                raise Conflict(
                    Sentence("retention-already-running", "A cleanup is already running. GET /api/retention shows its progress.")
                )
            run = self.latest = Run()
            self._asked_thread = threading.Thread(target=self._carry_out, args=(run, rules), name="retention run", daemon=True)
            self._asked_thread.start()
        return run

    def _carry_out(self, run: Run, rules: Rules) -> None:
        try:
            items = self.deletable_items(rules)
            run.planned = len(items)
            for item in items:
                run.gone += self.carry_out([item])
                if self._stopping.is_set():
                    run.state = "stopped"
                    return
                run.done += 1
            run.state = "finished"
        except FarmError as error:
            run.state, run.error = "failed", str(error)
        except Exception as error:
            log.exception("unexpected error while old films and scenes were deleted")
            run.state = "failed"
            run.error = Sentence(
                "retention-failed", "The cleanup failed ({kind}). See the service's log.", kind=type(error).__name__
            )

    def deletable_items(self, rules: Rules) -> list[Item]:
        """Returns the items that these rules allow to delete, oldest first. Deletes nothing."""
        now = time.time()
        with self._sessions() as session:
            return [*self._old_films(session, rules, now), *self._unused(session, rules, now)]

    def carry_out(self, items: Iterable[Item]) -> list[Item]:
        """Deletes those of the items that may still be deleted; returns them."""
        act = {"film": self._drop_film, "compiled": self._drop_compiled, "upload": self._drop_upload}
        gone = []
        for item in items:
            if self._stopping.is_set():
                break
            try:
                if act[item.what](item):
                    gone.append(item)
                    log.info("%s %s (%s) was deleted: %s", item.what, item.id, item.name, item.why)
            except FarmError as error:
                log.warning("%s %s is not deleted yet: %s", item.what, item.id, error)
        return gone

    def _old_films(self, session: Session, rules: Rules, now: float) -> list[Item]:
        if rules.films_days is None and rules.films_bytes is None:
            return []
        over = func.coalesce(Job.finished, Job.created)
        rows = session.execute(select(Job.id, Job.name, over, Job.pinned, Job.state).order_by(over))
        sizes = [(*row, self._films.size(row[0])) for row in rows]
        too_much = sum(size for *_, size in sizes) - rules.films_bytes if rules.films_bytes is not None else 0
        found = []
        for id, name, since, pinned, state, size in sizes:
            if pinned or state not in FINAL_STATES or not size:
                continue
            age = now - since
            if rules.films_days is not None and age > rules.films_days * DAY_S:
                why = Sentence("retention-older", "older than {days} days", days=f"{rules.films_days:g}")
            elif too_much > 0:
                why = Sentence("retention-films-too-large", "films take more than {most} bytes", most=rules.films_bytes)
            else:
                continue
            found.append(Item("film", id, name, size, age, why))
            too_much -= size
        return found

    def _unused(self, session: Session, rules: Rules, now: float) -> list[Item]:
        if rules.compiled_days is None and rules.uploads_days is None:
            return []
        needed = _needed_scenes(session)
        last = func.max(func.coalesce(Job.finished, Job.created))
        used: dict[str, float] = {scene: at for scene, at in session.execute(select(Job.scene, last).group_by(Job.scene))}  # noqa: C416 - typed
        found = []
        for scene in session.scalars(select(Scene).order_by(Scene.created)):
            if scene.status == "preparing" or scene.id in needed:
                continue
            age = now - max(scene.created, used.get(scene.of or scene.id, 0.0))
            if rules.uploads_days is not None and scene.of is None and age > rules.uploads_days * DAY_S:
                why = _unused_for(rules.uploads_days)
                found.append(Item("upload", scene.id, scene.name, scene.bytes + _compiled_bytes(scene), age, why))
            elif rules.compiled_days is not None and scene.compiled and age > rules.compiled_days * DAY_S:
                why = _unused_for(rules.compiled_days)
                found.append(Item("compiled", scene.id, scene.name, _compiled_bytes(scene), age, why))
        return found

    def _drop_film(self, item: Item) -> bool:
        def mark_samples_dropped() -> bool:
            with self._sessions.begin() as session:
                job = session.get(Job, item.id, with_for_update=True)
                if job is None or job.state not in FINAL_STATES or job.pinned:
                    return False
                if job.state == "finished":
                    job.state = "cancelled"
                    job.error = Sentence(
                        "film-released",
                        "{film} was deleted ({reason}). Set the job to running to render it again.",
                        film=FILM,
                        reason=item.why,
                    )
                self._films.delete(item.id)  # within the transaction, which blocks a concurrent change to running
            return True

        done = self._reserve.run_deletion(mark_samples_dropped)
        self._events.publish(RowWritten("job", item.id))
        return done

    def _drop_compiled(self, item: Item) -> bool:
        done: list[Item] = []

        def clear_compiled(session: Session) -> set[str]:
            scene = session.get(Scene, item.id, with_for_update=True)
            if scene is None or scene.status != "ready" or scene.id in _needed_scenes(session):
                return set()
            before = scene.blobs
            scene.compiled = {}
            done.append(item)
            return before - scene.blobs

        self._reserve.run_deletion(lambda: self._garbage.collect(clear_compiled))
        self._events.publish(RowWritten("scene", item.id))
        return bool(done)

    def _drop_upload(self, item: Item) -> bool:
        gone: list[str] = []

        def delete_rows(session: Session) -> set[str]:
            gone.clear()
            if item.id in _needed_scenes(session):
                return set()
            blobs: set[str] = set()
            for scene in session.scalars(select(Scene).where(or_(Scene.id == item.id, Scene.of == item.id))):
                blobs |= scene.blobs
                gone.append(scene.id)
                session.delete(scene)
            return blobs

        self._reserve.run_deletion(lambda: self._garbage.collect(delete_rows))
        for scene in gone:
            self._events.publish(RowWritten("scene", scene))
        return bool(gone)


def _needed_scenes(session: Session) -> set[str]:
    """Returns the ids of the scenes that unfinished or pinned jobs need."""
    rows = session.execute(select(Job.scene, Job.lit).where(or_(Job.state.in_(ACTIVE_STATES), Job.pinned)))
    return {id for row in rows for id in row if id is not None}


def _compiled_bytes(scene: Scene) -> int:
    """Returns the total size of a scene's compiled forms for all kinds of workers, in bytes. Shared parts are counted once."""
    sizes: dict[str, int] = {}
    for ref in (scene.compiled if isinstance(scene.compiled, dict) else {}).values():
        sizes |= _sizes(ref)
    return sum(sizes.values())


def _sizes(ref: Any) -> dict[str, int]:
    try:
        return {str(ref["sha256"]): int(ref["size"]), **{str(part): int(size) for part, size in ref.get("parts") or ()}}
    except (KeyError, TypeError, ValueError, AttributeError):
        return {}


def _unused_for(days: float) -> str:
    return Sentence("retention-unused", "not used for {days} days", days=f"{days:g}")
