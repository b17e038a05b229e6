"""Assembles, starts and stops the parts of the service that routes use."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections import Counter
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import redis
from anyio import CapacityLimiter

from renderer.errors import SettingsError
from renderer.sentences import Sentence
from renderer.settings import RenderSettings
from renderer.variables import VariableError
from service.access.access import Access
from service.access.quotas import Limits, Quotas
from service.access.redis_users import RedisUsers
from service.access.worker_channels import WorkerChannels
from service.errors import Conflict, FarmError, StartupError
from service.events import ArtifactStored, BlobsReleased, Events
from service.hooks.outbox import Outbox
from service.intake.lighting import Lighting
from service.maintenance.deleting import JobDeleter
from service.maintenance.retention import Retention, Rules
from service.maintenance.reuse import SampleReuse
from service.maintenance.scrub import Scrubber
from service.maintenance.taint import TaintMarker
from service.ownership.candidate import take_farm
from service.ownership.ownership import Ownership
from service.scheduling.dispatching.celery_dispatcher import CeleryDispatcher
from service.scheduling.engine import Engine
from service.scheduling.records import Records
from service.scheduling.snapshot import SnapshotHolder
from service.settings import Settings
from service.store.blobs import BlobFolder, BlobStore
from service.store.film_snapshots import FilmSnapshots
from service.store.film_store import FilmFolder
from service.store.films import Film
from service.store.garbage import Garbage
from service.store.kernels import KernelStore
from service.store.models import FINAL_STATES, Job
from service.store.reserve import Reserve
from service.viewing.explaining import PixelExplainer
from service.viewing.idle_posters import IdlePosters
from service.viewing.poster_store import PosterStore
from service.viewing.posters import Posters
from service.viewing.presence import SceneVisitors
from service.viewing.view_scheduler import ViewScheduler
from service.watching.broadcast import Broadcast
from service.watching.curves import Curves
from service.watching.pool import Pool
from service.watching.shared_results import SharedResults

__all__ = ["Farm"]

log = logging.getLogger(__name__)

ENGINE_LOCK_TIMEOUT_S = 0.25  # with a locked database: meanwhile all jobs stand still
RESULTS_READ_BYTES = 1 << 20  # bytes that the engine reads at a time; a result may have megabytes
OWNERSHIP_TIMEOUT_S = 10.0  # an earlier service may still be ending


class Farm:
    """The parts of a service that owns the farm: database, engine, stores, live views, hooks and maintenance."""

    def __init__(self, settings: Settings, owning: Ownership | None = None) -> None:
        """Creates the parts without starting them.

        owning: the ownership of the farm; None: acquires it. Raises StartupError if that fails.
        """
        self.settings = settings
        self.curves = Curves(settings.ocio)
        self.owning = owning or take_farm(settings, OWNERSHIP_TIMEOUT_S)
        self.database, self.sessions = self.owning.engine, self.owning.sessions
        self.instance = settings.instance_id()
        try:
            self.access = Access(self.sessions, settings, self.instance)
        except BaseException:
            self.owning.stop()
            raise
        self.redis_users = RedisUsers(_redis(settings), self.access.keys, settings.token, self.instance)
        self.channels = WorkerChannels(settings.redis_url, self.redis_users.address_for)
        self.events = Events()
        self._assemble_store(settings)
        self._assemble_scheduling(settings)
        self._assemble_maintenance(settings)
        self._assemble_delivery(settings)
        self._parts = (
            *(self.engine, self.views, self.posters, self.retention, self.taint, self.scrubber),
            *(self.frame_changes, self.outbox, self.redis_users),
        )
        self._inherited = threading.Timer(settings.prepare_deadline + 1.0, self.events.publish, [BlobsReleased(Counter())])
        self._inherited.daemon = True

    def _assemble_store(self, settings: Settings) -> None:
        """Creates the stores of blobs, films and kernels."""
        self.blobs = open_blobs(settings)
        self.garbage = Garbage(self.sessions, self.blobs, settings.prepare_deadline, self.owning.guard)
        self.events.subscribe(ArtifactStored, self.garbage.handle_artifact)
        self.events.subscribe(BlobsReleased, self.garbage.handle_release, in_background=True)
        self.reserve = Reserve(settings.data / "reserve")
        self.snapshots = FilmSnapshots(settings.data / "snapshots", settings.snapshot_bytes, settings.min_free_bytes)
        self.films = FilmFolder(
            settings.data / "films", settings.film_cache_bytes, self.snapshots, self.owning.epoch, self.owning.guard
        )
        self.kernels = KernelStore(settings.data / "kernels", settings.token)

    def _assemble_scheduling(self, settings: Settings) -> None:
        """Creates the engine, live views, pixel explanations and quotas."""
        self.records = Records(self.sessions.with_lock_timeout(ENGINE_LOCK_TIMEOUT_S), settings.max_pixels)
        board = SnapshotHolder(self.events)
        self.views = ViewScheduler(*_broker(settings), board, self.events)
        self.explaining = PixelExplainer(*_broker(settings), board)
        connection = _redis(settings, health_check_interval=30, socket_read_size=RESULTS_READ_BYTES)
        dispatcher = CeleryDispatcher(settings.redis_url, connection, self.owning.guard)
        self.engine = Engine(
            *(settings, connection, dispatcher, self.records, self.films, self.snapshots, self.blobs, board, self.events),
            guard=self.owning.guard,
            viewing=(self.views, self.explaining),
        )
        self.lighting = Lighting(self.sessions, self.garbage, self.events)
        store, stopping = PosterStore(self.sessions, self.blobs, self.garbage, board, self.events), threading.Event()
        idle = IdlePosters(self.sessions, store, self.views, board, self.events, stopping) if settings.idle_posters else None
        self.posters = Posters(store, self.views, stopping, idle)
        self.reuse = SampleReuse(self.sessions, self.films, board, settings.data, settings.min_free_bytes)
        usual = Limits(settings.quota_bytes, settings.quota_jobs, settings.quota_samples_day)
        self.quotas = Quotas(self.sessions, usual, self.films.size)

    def _assemble_maintenance(self, settings: Settings) -> None:
        """Creates the deletion of jobs, the checks of films, and retention."""
        self.deleting = JobDeleter(self.sessions, self.garbage, self.reserve, self.events)
        self.frame_changes = self.deleting.frames
        self.taint = TaintMarker(self.sessions, self.films, self.events)
        self.scrubber = Scrubber(self.sessions, self.films, self.lighting.restore, self.events, settings.film_check_days)
        kept = settings.model_dump(include={f"keep_{each.name}" for each in fields(Rules)})
        self.rules = Rules(**{name.removeprefix("keep_"): value for name, value in kept.items()})
        self.retention = Retention(self.sessions, self.films, self.garbage, self.reserve, self.events, self.rules)

    def _assemble_delivery(self, settings: Settings) -> None:
        """Creates the notifications of pages and webhooks, and the limited thread pools that serve requests."""
        self.broadcast = Broadcast(self.events)
        self.visitors = SceneVisitors()
        self.shared = SharedResults(self.broadcast, settings.live_bytes)
        self.pictures = Pool(settings.picture_bytes)
        self.outbox = Outbox(settings, self.sessions, self.events)
        self.tiles = CapacityLimiter(2)  # reads of a tile for one pixel
        self.reading = CapacityLimiter(2)  # checks of uploaded pictures, which need much memory
        self.readiness = CapacityLimiter(2)  # queries of the database for /readyz
        self.logins = CapacityLimiter(2)  # password checks, which are slow by design

    def start(self, loop: asyncio.AbstractEventLoop, on_lost: Callable[[], None] = lambda: None) -> None:
        """Deletes remains of an earlier run and starts all parts.

        loop: the event loop of the server. on_lost: called from a thread if another service takes over the farm.
        """
        self.owning.start(on_lost, self.engine.makes_progress)
        self.broadcast.open(loop)
        self.reserve.refill()
        try:
            self.garbage.adopt_unreferenced(self.blobs.sweep(self.records.blobs() | self.engine.denoised_blobs()))
        except FarmError as error:
            log.warning("unreferenced blobs are not deleted yet: %s", error)
        for part in self._parts:
            part.start()
        self._inherited.start()

    def stop(self) -> None:
        """Stops all parts in the reverse order of their start."""
        self.broadcast.close()
        self.explaining.stop()
        for part in reversed(self._parts):
            part.stop()
        self._inherited.cancel()
        self.events.close()
        self.films.close()
        self.owning.stop()

    def film(self, job: Job, frame: int = 0) -> Film | None:
        """Returns a job's film; None if it has none yet.

        frame: key of the frame to check: 2 * frame number, since frame numbers are multiples of 0.5. If the job has ended and
        the film has fewer samples of this frame than the database records, raises FilmLost. Raises Conflict if this release
        cannot read the job's settings.
        """
        if job.settings is None or job.tile_size is None:
            return None
        try:
            settings = RenderSettings.from_json(job.settings)
        except SettingsError as error:
            raise Conflict(
                Sentence("picture-unavailable", "The picture cannot be shown: {error}. Render it again.", error=error)
            ) from None
        recorded = self.records.samples(job.id, frame) if job.state in FINAL_STATES else 0
        return self.films.open(job.id, settings, job.tile_size, recorded=recorded, frame=frame)


def _redis(settings: Settings, **options: Any) -> redis.Redis:
    """Returns a Redis client for the broker. It connects at its first command."""
    return redis.Redis.from_url(settings.redis_url, socket_timeout=5, socket_connect_timeout=2, **options)


def _broker(settings: Settings) -> tuple[redis.Redis, CeleryDispatcher]:
    """Returns a Redis client for the broker, and a dispatcher that uses it."""
    connection = _redis(settings)
    return connection, CeleryDispatcher(settings.redis_url, connection)


def open_blobs(settings: Settings) -> BlobStore:
    """Returns the blob store selected by the settings: an S3 bucket, or a folder. Raises StartupError."""
    temporary = settings.data / "tmp"
    if not settings.blobs:
        return BlobFolder(settings.data / "blobs", temporary)
    try:
        from service.store.s3 import S3Blobs
    except ImportError as error:
        raise StartupError("RAYFARM_BLOBS needs obstore. Install it: pip install 'rayfarm[s3]'.") from error
    try:
        return S3Blobs(settings.blobs, temporary)
    except VariableError as error:
        raise StartupError(str(error)) from error
