"""Everything that the HTTP side works with, made once and handed to the routes."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from typing import Annotated

import redis
from anyio import CapacityLimiter
from fastapi import Depends
from starlette.requests import HTTPConnection

from renderer.errors import SettingsError
from renderer.settings import RenderSettings
from renderer.variables import VariableError
from service.access.access import Access
from service.access.quotas import Limits, Quotas
from service.access.redis_users import RedisUsers
from service.errors import CannotStart, Conflict, FarmError
from service.hooks.outbox import Outbox
from service.intake.lighting import Lighting
from service.keeping.deleting import Deleting
from service.keeping.doubts import Doubts
from service.keeping.patrol import Patrol
from service.keeping.retention import Retention, Rules
from service.keeping.reuse import Reuse
from service.owning.candidate import own
from service.owning.ownership import Ownership
from service.scheduling.engine import Engine
from service.scheduling.fleet.workers import Roster
from service.scheduling.records import Records
from service.settings import Settings
from service.store.blobs import BlobFolder, BlobStore
from service.store.film_snapshots import FilmSnapshots
from service.store.film_store import FilmFolder
from service.store.films import Film
from service.store.garbage import Garbage
from service.store.kernels import KernelStore
from service.store.models import FINAL, Job, Scene
from service.store.reserve import Reserve
from service.viewing.explaining import Explaining
from service.viewing.view_scheduler import ViewScheduler
from service.watching.broadcast import Broadcast
from service.watching.pool import Pool
from service.watching.shared import Shared

__all__ = ["Farm", "FarmDependency", "get_farm"]

log = logging.getLogger(__name__)

ENGINE_PATIENCE_S = 0.25  # with a locked database: meanwhile all jobs stand still
OWN_PATIENCE_S = 10.0  # an earlier service may still be ending


class Farm:
    """The parts of the service."""

    def __init__(self, settings: Settings, owning: Ownership | None = None) -> None:
        """owning: that this service works as the farm; None: it does from now on, or CannotStart."""
        self.settings = settings
        self.owning = owning or own(settings, OWN_PATIENCE_S)
        self.database, self.sessions = self.owning.engine, self.owning.sessions
        self.instance = settings.instance()
        try:
            self.access = Access(self.sessions, settings, self.instance)
        except BaseException:
            self.owning.stop()
            raise
        queue = redis.Redis.from_url(settings.redis_url, socket_timeout=5, socket_connect_timeout=2)
        self.redis_users = RedisUsers(queue, self.access.keys, settings.token, self.instance)
        self.blobs = open_blobs(settings)
        self.garbage = Garbage(self.sessions, self.blobs, settings.prepare_deadline, self.owning.guard)
        self.reserve = Reserve(settings.data / "reserve")
        self.snapshots = FilmSnapshots(settings.data / "snapshots", settings.snapshot_bytes, settings.min_free_bytes)
        self.films = FilmFolder(
            settings.data / "films", settings.film_cache_bytes, self.snapshots, self.owning.epoch, self.owning.guard
        )
        self.kernels = KernelStore(settings.data / "kernels", settings.token)
        self.deleting = Deleting(self.sessions, self.garbage, self.reserve, self.changed)
        self.frame_changes = self.deleting.frames
        self.broadcast = Broadcast()
        self.shared = Shared(self.broadcast, settings.live_bytes)
        self.pictures = Pool(settings.picture_bytes)
        self.tiles = CapacityLimiter(2)  # threads that read a tile for one of its pixels
        self.reading = CapacityLimiter(2)  # threads that wait while an uploaded picture is read, which takes much memory
        self.readiness = CapacityLimiter(2)  # threads that ask the database whether it answers
        self.logins = CapacityLimiter(2)  # threads that look at passwords, which takes long on purpose
        self.records = Records(self.sessions.with_patience(ENGINE_PATIENCE_S), settings.max_pixels)
        self.lighting = Lighting(self.sessions, self.garbage, self.changed, lambda id, kind: self.engine.prepare(id, kind))
        self.outbox = Outbox(settings, self.sessions)
        usual = Limits(settings.quota_bytes, settings.quota_jobs, settings.quota_samples_day)
        self.quotas = Quotas(self.sessions, usual, self.films.size)
        self._collector = ThreadPoolExecutor(1, "collector")
        self._inherited = threading.Timer(settings.prepare_deadline + 1.0, self._let_go, [Counter[str]()])
        self._inherited.daemon = True
        self.engine = Engine(
            *(settings, self.records, self.films, self.snapshots, self.blobs),
            *(self.broadcast.tell, self.broadcast.tell_tiles, self._let_go),
            suspect=lambda job: self.patrol.suspect(job),
            guard=self.owning.guard,
            is_watched=lambda: self.views.is_watched,
        )
        self.engine.trust.report = lambda worker, told: self._in_background(lambda: self.outbox.set_aside(worker, told))
        self.doubts = Doubts(self.sessions, self.films, self.changed)
        self.engine.trust.doubt = self.doubts.look
        self.patrol = Patrol(self.sessions, self.films, self.lit_again, self.changed, settings.film_check_days)
        kept = settings.model_dump(include={f"keep_{each.name}" for each in fields(Rules)})
        self.rules = Rules(**{name.removeprefix("keep_"): value for name, value in kept.items()})
        self.retention = Retention(self.sessions, self.films, self.garbage, self.reserve, self.changed, self.rules)

        def roster() -> Roster:
            return self.engine.snapshot.roster

        self.reuse = Reuse(self.sessions, self.films, roster, settings.data, settings.min_free_bytes)
        self.views = ViewScheduler(settings, roster, self.engine.prepare, self._let_go)
        self.explaining = Explaining(settings, roster)

    def start(self, loop: asyncio.AbstractEventLoop, on_lost: Callable[[], None] = lambda: None) -> None:
        """Clean up after an earlier life and begin. on_lost: told, in some thread, where another service has taken over."""
        self.owning.start(on_lost, lambda: self.engine.moves)
        self.broadcast.open(loop)
        self.reserve.fill()
        try:
            self.garbage.inherit(self.blobs.sweep(self.records.blobs()))
        except FarmError as error:
            log.warning("what nobody needs stays for now: %s", error)
        self.engine.start()
        self.redis_users.start()
        self.views.start()
        self.outbox.start()
        self.frame_changes.start()
        self.patrol.start()
        self.doubts.start()
        self.retention.start()
        self._inherited.start()

    def stop(self) -> None:
        """End in order."""
        self.broadcast.close()
        self.redis_users.stop()
        self.outbox.stop()
        self.frame_changes.stop()
        self.patrol.stop()
        self.doubts.stop()
        self.retention.stop()
        self.views.stop()
        self.explaining.stop()
        self.engine.stop()
        self._inherited.cancel()
        self._collector.shutdown()
        self.films.close()
        self.owning.stop()

    def changed(self, what: str, id: str) -> None:
        """A job's or a scene's row was written: the engine looks at it, and watchers are told."""
        self.engine.changed(what, id)
        self.broadcast.tell(what, id)

    def lit_again(self, id: str) -> None:
        """What a job that is over was rendered of may be gone; where it is to go on, that is made again."""
        with self.sessions() as session:
            job = session.get(Job, id)
            if job is None or job.lit is None or session.get(Scene, job.lit) is not None or session.get(Scene, job.scene) is None:
                return
        self.lighting.row(job.scene, job.request.get("environment"), job.request.get("variant"))

    def film(self, job: Job, frame: int = 0) -> Film | None:
        """A job's film; None where the job has none yet. Raises FilmLost where it has less of a frame than its row says."""
        if job.settings is None or job.tile_size is None:
            return None
        try:
            settings = RenderSettings.from_json(job.settings)
        except SettingsError as error:
            raise Conflict(f"The picture cannot be shown: {error}. Render it anew.") from None
        recorded = self.records.samples(job.id, frame) if job.state in FINAL else 0
        return self.films.open(job.id, settings, job.tile_size, recorded=recorded, frame=frame)

    def _let_go(self, hashes: Counter[str]) -> None:
        """Blobs are referred to no longer: remove those that nobody else refers to, without holding up who says so."""
        self._in_background(lambda: self.garbage.let_go(hashes))

    def _in_background(self, action: Callable[[], object]) -> None:
        self._collector.submit(self._guarded, action)

    def _guarded(self, action: Callable[[], object]) -> None:
        try:
            action()
        except FarmError as error:
            log.warning("what was to be written down is not: %s", error)


def open_blobs(settings: Settings) -> BlobStore:
    """The blob store that is set."""
    temporary = settings.data / "tmp"
    if not settings.blobs:
        return BlobFolder(settings.data / "blobs", temporary)
    try:
        from service.store.s3 import S3Blobs
    except ImportError as error:
        raise CannotStart("RAYFARM_BLOBS needs obstore. Install it: pip install 'rayfarm[s3]'.") from error
    try:
        return S3Blobs(settings.blobs, temporary)
    except VariableError as error:
        raise CannotStart(str(error)) from error


async def get_farm(connection: HTTPConnection) -> Farm:
    """The farm of the application that answers."""
    farm: Farm = connection.app.state.farm
    return farm


FarmDependency = Annotated[Farm, Depends(get_farm)]
