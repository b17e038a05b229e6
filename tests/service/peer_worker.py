"""A worker with the real protocol over a real Redis, which computes samples by a formula instead of a path tracer.

It receives Celery's messages from the queues, answers on the result stream, and renews its key in Redis. A sample's value depends
only on pixel, sample number and seed, so that tests can compute the expected film of any job.
"""

from __future__ import annotations

import base64
import hashlib
import json
import threading
import time
from collections.abc import Callable
from dataclasses import asdict
from typing import Any, Literal

import httpx
import numpy as np
import redis

from protocol.contract import (
    HEARTBEAT_TTL_S,
    RESULTS,
    VERSION_SEPARATOR,
    BlobRef,
    DenoiseFrame,
    FrameInfo,
    FrameVectors,
    GuideScene,
    PrepareFrames,
    RenderBatch,
    Result,
    SceneInfo,
    ShowEnvironment,
    TrainPathGuide,
    WorkerReport,
    denoise_queue,
    own_prepare_queue,
    pause_key,
    prepare_queue,
    recall_key,
    render_queue,
    worker_key,
)
from protocol.explained import ExplainPixel, explained_key
from protocol.sums import pack_sums
from protocol.terms import Offer, Terms, offer_key, terms_key
from protocol.view_parts import (
    ANSWERS_TTL_S,
    VIEW_ANSWERS,
    Part,
    ViewAnswer,
    ViewDenoise,
    ViewFrame,
    ViewParts,
    card_view_queue,
    view_key,
    view_queue,
)
from renderer.film import CHANNELS, COLOR, COLOR_HALF, DEPTH, NORMAL, SAMPLES, SAMPLES_HALF, Sums, digest, in_half
from renderer.image import rgbe9995
from renderer.settings import Tile

__all__ = ["PeerWorker", "expected_digest", "expected_sums"]


def expected_sums(tile: Tile, first: int, count: int, seed: int) -> Sums:
    """Returns the sums of samples first ... first + count - 1: hashes of (x, y, sample, channel, seed), all finite."""
    y, x = np.mgrid[tile.y : tile.y + tile.h, tile.x : tile.x + tile.w].astype(np.uint64)
    sums = np.zeros((CHANNELS, tile.h, tile.w), np.int64)
    for sample in range(first, first + count):
        for channel in range(3):
            word = x * np.uint64(0x9E3779B1) ^ y * np.uint64(0x85EBCA77) ^ np.uint64(sample * 0xC2B2AE3D + channel * 977 + seed)
            word = (word ^ (word >> np.uint64(15))) * np.uint64(0x2C1B3C6D)
            value = (word >> np.uint64(4) & np.uint64(0xFFFFFF)).astype(np.int64)  # 0 ... 1 in the film's quantum
            sums[COLOR][channel] += value
            if in_half(sample):
                sums[COLOR_HALF][channel] += value
        sums[NORMAL][2] += 1 << 24
        sums[DEPTH] += 2 << 24
        sums[SAMPLES] += 1
        sums[SAMPLES_HALF] += in_half(sample)
    return sums


def expected_digest(width: int = 64, height: int = 48, spp: int = 8, seed: int = 0) -> str:
    """Returns the expected digest of a whole frame."""
    return digest(expected_sums(Tile(0, 0, width, height), 0, spp, seed))


def guide_of(job: str, frame: int) -> bytes:
    """Returns the content of the blob that a peer stores as the path guide of a frame, given by its key."""
    return f"guide of {job}, {frame}".encode()


class PeerWorker:
    """A fake worker in a thread, which handles one message at a time; functions such as `on_batch` may change its answers.

    `on_batch` may delay a batch, drop it (return False) or fail it (raise). The worker's capabilities are arguments of the
    constructor, since the service acts on the first report that it receives.
    """

    def __init__(
        self,
        redis_url: str,
        service: str,
        token: str,
        name: str = "peer",
        kind: str = "test-kind",
        slots: int = 2,
        denoises: bool = True,
        knows_frames: bool = True,
        blurs: bool = True,
        knows_vectors: bool = True,
        trains_guides: bool = True,
        several: bool = True,
        recalls: bool = False,
        views: bool = True,
        explains: bool = True,
        tags: tuple[str, ...] | None = None,
        memory: int = 8 << 30,
        transport: Literal["", "https"] = "",
        has_cards: bool = False,
    ) -> None:
        """Starts the worker. The bool arguments are capabilities that it reports.

        has_cards: whether its slots render with graphics cards; it then serves only the queue of their views.
        tags: None stands for an older release, which publishes no tags and applies no settings from the service.
        """
        self.redis = redis.Redis.from_url(redis_url)
        self.http = httpx.Client(base_url=service, headers={"Authorization": f"Bearer {token}"}, timeout=60, verify=False)
        self.name = name
        self.kind = kind
        self.slots = slots
        self.denoises = denoises
        self.knows_frames = knows_frames
        self.blurs = blurs
        self.knows_vectors = knows_vectors
        self.trains_guides = trains_guides
        self.several = several
        self.recalls = recalls
        self.sample_s = 0.001  # reported rendering time of a sample of a tile
        self.recalled: list[str] = []  # batches that were returned since their message was recalled
        self.views = views
        self.explains = explains
        self.tags = tags
        self.memory = memory
        self.transport: Literal["", "https"] = transport
        self.has_cards = has_cards
        self.drafts = False  # whether its cards make drafts of views; `draft_jpeg` is their picture
        self.draft_jpeg = b"a picture"
        self.on_view: Callable[[ViewParts], dict[str, Any] | None] = lambda work: None  # returns fields with which it is declined
        self.is_fetching = True
        self.terms = Terms()
        self.unfit: str | None = None  # what its machine lacks
        self.passing = False  # whether that is temporary
        self.rests: str | None = None  # reported reason why it takes no work
        self.on_explain: Callable[[ExplainPixel], list[dict[str, Any]]] = lambda work: []  # returns the response
        self.explained: list[ExplainPixel] = []  # requests received
        self.on_part: Callable[[ViewParts, Part], bool | None] = lambda work, part: None  # False: no response
        self.parts: list[tuple[ViewParts, Part]] = []  # parts rendered
        self.unwanted: list[ViewParts] = []  # of views that are no longer watched
        self.on_vectors: Callable[[str], bool | None] = lambda job: None  # True: no response
        self.vectors: list[FrameVectors] = []  # vectors made
        self.on_path_guide: Callable[[TrainPathGuide], bool | None] = lambda work: None  # True: no response
        self.path_guides: list[TrainPathGuide] = []  # guides trained
        self.messages: list[int] = []  # number of batches in each message
        self.on_batch: Callable[[RenderBatch], bool | None] = lambda batch: None
        self.on_prepare: Callable[[str], None] = lambda scene: None
        self.frame_warnings: list[str] = []
        self.on_frame: Callable[[float], bytes | None] = lambda frame: None  # returns the scene compiled for one frame
        self.frames: list[float] = []  # frames prepared
        self.shutters: list[dict[str, Any]] = []  # shutters of these frames
        self.shared: bytes | None = None  # part shared by the compiled scenes of all frames
        self.on_denoise: Callable[[str], None] = lambda job: None
        self.denoised: list[str] = []
        self.guides: list[GuideScene | None] = []  # of these
        self.denoised_in_shots: list[tuple[tuple[int, str], ...]] = []  # frames and motion vectors of these requests
        self.batches: list[RenderBatch] = []
        self.prepared: list[str] = []
        self.more: list[str] = []  # further queues
        self.blend: dict[str, Any] | None = None  # Blender's export
        self.shown: list[str] = []  # environments shown
        self.current: dict[str, Any] = {}
        self.beats = True
        self._stop = threading.Event()
        self._threads = [threading.Thread(target=self._work, daemon=True), threading.Thread(target=self._beat, daemon=True)]

    def __enter__(self) -> PeerWorker:
        self.report()
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def stop(self) -> None:
        """Stops without answering work in progress, like a killed worker."""
        self._stop.set()
        for thread in self._threads:
            thread.join()
        self.redis.delete(worker_key(self.name), offer_key(self.name))
        self.redis.close()
        self.http.close()

    def report(self) -> None:
        if self.tags is not None:
            asked: Any = self.redis.get(terms_key(self.name))
            self.terms = Terms() if asked is None else Terms.from_bytes(asked)
            offer = Offer(self.tags, self.memory, self.slots, self.terms.digest, queues=self.terms.queues, why=self.rests)
            self.redis.set(offer_key(self.name), offer.to_bytes(), ex=HEARTBEAT_TTL_S)
        current = [self.current, *[{}] * (self.slots - 1)]
        state: Literal["ready", "paused"] = "paused" if self.rests else "ready"
        report = WorkerReport(
            *(self.name, "host", 1, self.slots, "a peer", self.kind, state, time.time(), 1e6, current, self.denoises),
            frames=self.knows_frames,
            blurs=self.blurs,
            vectors=self.knows_vectors,
            trains_guides=self.trains_guides,
            several=self.several,
            recalls=self.recalls,
            views=self.views,
            explains=self.explains,
            denoises_views=self.denoises,
            transport=self.transport,
            has_card_queue=self.has_cards,
            views_on_cards=self.has_cards,
            drafts_views=self.drafts,
        )
        self.redis.set(worker_key(self.name), report.to_bytes(), ex=HEARTBEAT_TTL_S)

    def send(self, event: dict[str, Any], sums: bytes | None = None) -> None:
        while not self._stop.is_set():
            try:
                self.redis.xadd(RESULTS, Result(event, sums).to_fields())  # type: ignore[arg-type]
                return
            except redis.RedisError:
                time.sleep(0.1)

    def answer(self, work: RenderBatch) -> None:
        """Renders a batch and sends its sums."""
        sums = expected_sums(work.tile, work.first, work.count, work.settings.seed + 1000 * work.frame)
        self.send(
            {"type": "batch", **self._about(work), "seconds": self.sample_s * work.count, "bad": [], "bad_count": 0},
            pack_sums(sums),
        )

    def _beat(self) -> None:
        while not self._stop.wait(0.25):
            try:
                if self.beats:
                    self.report()
            except redis.RedisError:
                continue

    def _work(self) -> None:
        while not self._stop.is_set():
            try:
                if self.rests or not self.is_fetching or self.redis.exists(pause_key(self.name)):
                    time.sleep(0.05)
                    continue
                queues = [view_queue(self.kind)] * self.views + [denoise_queue(self.kind)] * self.denoises
                queues += [
                    *self.more,
                    own_prepare_queue(self.kind, self.name),
                    prepare_queue(self.kind),
                    *self.terms.queues,
                    render_queue(self.kind),
                ]
                queues = [card_view_queue(self.name)] if self.has_cards else queues
                found: Any = self.redis.brpop(queues, timeout=0.1)
            except redis.RedisError:
                time.sleep(0.1)
                continue
            if found is None:
                continue
            _, message = found
            _, arguments, _ = json.loads(base64.b64decode(json.loads(message)["body"]))
            if "parts" in arguments:
                self._view(ViewParts.from_json(arguments["parts"]))
            elif "picture" in arguments:
                self._denoise_view(ViewDenoise.from_json(arguments["picture"]))
            elif "pixel" in arguments:
                self._explain(ExplainPixel.from_json(arguments["pixel"]))
            elif "watch" in arguments.get("frame", {}):
                self._view_frame(ViewFrame.from_json(arguments["frame"]))
            elif "frames" in arguments:
                self._prepare_frames(PrepareFrames(**arguments["frames"]))
            elif "environment" in arguments:
                self._show(ShowEnvironment(**arguments["environment"]))
            elif "vectors" in arguments:
                self._point(FrameVectors(**arguments["vectors"]))
            elif "guide" in arguments:
                self._train(TrainPathGuide.from_json(arguments["guide"]))
            elif "scene" in arguments:
                self._prepare(arguments["scene"])
            elif "frame" in arguments:
                self._denoise(DenoiseFrame.from_json(arguments["frame"]))
            else:
                id = json.loads(message)["headers"]["id"]
                batches = arguments["batches"] if "batches" in arguments else [arguments["batch"]]
                self.messages.append(len(batches))
                for batch in batches:
                    work = RenderBatch.from_json(batch)
                    if len(batches) > 1 and self.recalls and self.redis.exists(recall_key(id)):
                        self.recalled.append(work.batch)
                        self.send({"type": "batch-returned", **self._about(work), "error": "recalled", "recalled": True})
                    else:
                        self._render(work, id)

    def _explain(self, work: ExplainPixel) -> None:
        self.explained.append(work)
        unfit = [{"type": "begun"}, {"type": "returned", "error": self.unfit, "unfit": True}]
        for answer in self.on_explain(work) if self.unfit is None else unfit:
            self.redis.rpush(explained_key(work.message), json.dumps({"worker": self.name, **answer}))

    def _cannot(self, type: str, about: dict[str, Any]) -> bool:
        """Returns True if the test declared this worker's machine unfit for such work, and sends that as the answer."""
        if self.unfit is not None:
            self.send({"type": type, **about, "error": self.unfit, "unfit": True})
        return self.unfit is not None

    def _denoise(self, work: DenoiseFrame) -> None:
        """Answers a denoising request: the picture is half the colour plus albedo and normal; in a shot, the mean of all."""
        about = {"work": work.work, "worker": self.name}
        if self._cannot("denoise-failed", about):
            return
        try:
            if work.frames:
                self._denoise_in_shot(work, about)
                return
            means = self.http.get(f"/api/farm/films/{work.job}/{work.frame}").raise_for_status()
            self.on_denoise(work.job)
            color, albedo, normal = np.frombuffer(means.content, "<f4").reshape(3, work.height, work.width, 3)
            clean = (color / 2 + albedo + normal).astype("<f4").tobytes()
            sha256 = hashlib.sha256(clean).hexdigest()
            self.http.put(f"/api/farm/blobs/{sha256}", content=clean).raise_for_status()
            seen = {"version": means.headers["x-film-version"], "samples": int(means.headers["x-samples"])}
            self.guides.append(work.guide)
            self.denoised.append(work.job)  # recorded first, since the test may check it as soon as it has the response
            self.send({"type": "denoised", **about, "sha256": sha256, **seen})
        except (ValueError, httpx.HTTPError) as error:
            self.send({"type": "denoise-failed", **about, "error": str(error)})

    def _denoise_in_shot(self, work: DenoiseFrame, about: dict[str, Any]) -> None:
        total, versions, samples = np.zeros((work.height, work.width, 3), np.float32), [], 0
        for frame, motion in work.frames:
            assert len(self.http.get(f"/api/farm/blobs/{motion}").raise_for_status().content) == 16 * work.height * work.width
            means = self.http.get(f"/api/farm/films/{work.job}/{frame}?ids=true").raise_for_status()
            planes = np.frombuffer(means.content, "<f4").reshape(11, work.height, work.width)
            total += planes[:3].reshape(total.shape)
            versions.append(means.headers["x-film-version"])
            samples = int(means.headers["x-samples"]) if frame == work.frame else samples
        clean = (total / len(work.frames)).astype("<f4").tobytes()
        sha256 = hashlib.sha256(clean).hexdigest()
        self.http.put(f"/api/farm/blobs/{sha256}", content=clean).raise_for_status()
        self.denoised_in_shots.append(work.frames)
        seen = {"version": VERSION_SEPARATOR.join(versions), "samples": samples}
        self.send({"type": "denoised", **about, "sha256": sha256, **seen})

    def _show(self, work: ShowEnvironment) -> None:
        """Answers a request for an environment's picture with the file's bytes reversed; fails if its path contains "broken"."""
        about = {"work": work.work, "worker": self.name}
        if self._cannot("environment-failed", about):
            return
        content = self.http.get(f"/api/farm/blobs/{work.sha256}").raise_for_status().content
        self.shown.append(work.path)
        if "broken" in work.path:
            self.send({"type": "environment-failed", **about, "error": f"{work.path}: is black all over; it lights nothing"})
            return
        sha256 = hashlib.sha256(content[::-1]).hexdigest()
        self.http.put(f"/api/farm/blobs/{sha256}", content=content[::-1]).raise_for_status()
        self.send({"type": "environment-shown", **about, "sha256": sha256})

    def _point(self, work: FrameVectors) -> None:
        """Answers a request for motion vectors: the vector of each pixel is (column, row, 2 * frame, -column)."""
        about = {"work": work.work, "worker": self.name}
        if self._cannot("vectors-failed", about):
            return
        try:
            if self.on_vectors(work.job):
                return
            rows, columns = np.mgrid[0 : work.height, 0 : work.width]
            made = np.stack([columns, rows, np.full_like(rows, work.frame), -columns], -1).astype("<f4").tobytes()
            sha256 = hashlib.sha256(made).hexdigest()
            self.http.put(f"/api/farm/blobs/{sha256}", content=made).raise_for_status()
            self.vectors.append(work)
            self.send({"type": "vectors-made", **about, "sha256": sha256})
        except (ValueError, httpx.HTTPError) as error:
            self.send({"type": "vectors-failed", **about, "error": str(error)})

    def _train(self, work: TrainPathGuide) -> None:
        """Answers a request for a path guide: its blob is the job's id and the frame's key."""
        about = {"work": work.work, "worker": self.name}
        if self._cannot("path-guide-failed", about):
            return
        try:
            if self.on_path_guide(work):
                return
            self.path_guides.append(work)
            self.send({"type": "path-guide-trained", **about, "sha256": self.store(guide_of(work.job, work.frame))})
        except (ValueError, httpx.HTTPError) as error:
            self.send({"type": "path-guide-failed", **about, "error": str(error)})

    def store(self, content: bytes) -> str:
        """Stores a blob at the service, which may be starting, and returns its hash."""
        sha256 = hashlib.sha256(content).hexdigest()
        while True:
            try:
                self.http.put(f"/api/farm/blobs/{sha256}", content=content).raise_for_status()
                return sha256
            except httpx.TransportError:
                if self._stop.wait(0.05):
                    raise

    def _render(self, work: RenderBatch, message: str) -> None:
        if self._stop.is_set():
            return
        self.batches.append(work)
        about = self._about(work)
        self.current = {key: about[key] for key in ("batch", "job", "frame", "tile", "first", "count")} | {"message": message}
        try:
            if self.on_batch(work) is not False and not self._stop.is_set():
                self.answer(work)
        except ValueError as error:
            self.send({"type": "batch-failed", **about, "error": str(error), "reproduce": "rayfarm render scene.glb"})
        finally:
            self.current = {}

    def _view(self, work: ViewParts) -> None:
        """Renders the parts of a view, with the samples of a batch."""
        if self.redis.get(view_key(work.watch)) != str(work.view).encode():
            self.unwanted.append(work)
            return
        self.current = {"view": work.watch, "message": work.message}
        if work.draft is None:
            self._tell(work, "begun")
        assert work.on_card == self.has_cards
        if (declined := self.on_view(work)) is not None:
            self._tell(work, "declined", **declined)
            if declined.get("is_loading"):
                self._tell(work, "over")
            self.current = {}
            return
        try:
            for part in work.parts:
                if self._stop.is_set() or self.redis.get(view_key(work.watch)) != str(work.view).encode():
                    break
                if self.on_part(work, part) is False:
                    return
                sums = expected_sums(part.tile, part.first, part.count, work.settings.seed)
                self.parts.append((work, part))
                if work.draft is not None:
                    self._tell(work, "draft", self.draft_jpeg, seconds=1e-9 * part.tile.w * part.tile.h * part.count)
                    return
                self._tell(work, "part", pack_sums(sums), number=part.number, seconds=1e-5 * part.tile.w * part.tile.h)
            self._tell(work, "over")
        except ValueError as error:
            self._tell(work, "failed", error=str(error))
        finally:
            self.current = {}

    def _denoise_view(self, work: ViewDenoise) -> None:
        """Answers a request to denoise a view's picture: half the colour plus albedo and normal, as of a frame."""
        self._tell(work, "begun")
        self.current = {"view": work.watch, "message": work.message}
        self.report()
        try:
            means = self.http.get(f"/api/farm/views/{work.message}").raise_for_status()
            self.on_denoise(work.watch)
            color, albedo, normal = np.frombuffer(means.content, "<f4").reshape(3, work.height, work.width, 3)
            self.denoised.append(work.watch)
            self._tell(work, "denoised", rgbe9995.pack(color / 2 + albedo + normal).astype("<u4").tobytes())
            self._tell(work, "over")
        except (ValueError, httpx.HTTPError) as error:
            self._tell(work, "failed", error=str(error))
        finally:
            self.current = {}

    def _tell(self, work: ViewParts | ViewFrame | ViewDenoise, type: str, sums: bytes = b"", **more: Any) -> None:
        if not self._stop.is_set():
            answer = ViewAnswer(type, work.watch, work.view, work.message, self.name, more, sums)
            self.redis.rpush(VIEW_ANSWERS, answer.to_bytes())
            self.redis.expire(VIEW_ANSWERS, ANSWERS_TTL_S)

    def _view_frame(self, work: ViewFrame) -> None:
        self._tell(work, "begun")
        names = {"frame-prepared": "frame", "frame-failed": "failed", "frames-returned": "returned"}

        def send(event: dict[str, Any]) -> None:
            self._tell(
                work, names[event["type"]], **{name: event[name] for name in ("frame", "info", "error", "unfit") if name in event}
            )

        self._prepare_frames(work.work, send)
        self._tell(work, "over")

    def _about(self, work: RenderBatch) -> dict[str, Any]:
        about = {key: getattr(work, key) for key in ("batch", "job", "frame", "first", "count")}
        return {**about, "tile": list(work.tile), "worker": self.name}

    def _prepare_frames(self, work: PrepareFrames, send: Callable[[dict[str, Any]], None] | None = None) -> None:
        """Prepares frames in which the camera moves one unit to the right per frame.

        `on_frame` raises for a frame that cannot be prepared.
        """
        send = send or self.send
        about = {"work": work.work, "job": work.job, "kind": self.kind, "worker": self.name}
        if self.unfit is not None:
            send({"type": "frames-returned", **about, "error": self.unfit, "unfit": True, "passing": self.passing})
            return
        self.current = {"scene": work.scene, "work": work.work}
        for key in work.frames:
            frame = key / 2
            self.frames.append(frame)
            self.shutters.append(work.shutter)
            try:
                compiled = self.on_frame(frame)
                ref = None
                if compiled is not None:
                    sha256 = hashlib.sha256(compiled).hexdigest()
                    self.http.put(f"/api/farm/blobs/{sha256}", content=compiled).raise_for_status()
                    ref = BlobRef("", sha256, len(compiled), self._keep_shared())
                view = {**(work.view or work.base_auto), "eye": [frame, 0.0, 5.0]}
                views = [{**view, "eye": [frame + shift, 0.0, 5.0]} for shift in (-0.25, 0.25)] if work.shutter else []
                info = FrameInfo(ref, view, {}, self.frame_warnings, 0.01, views)
                send({"type": "frame-prepared", **about, "frame": key, "info": asdict(info)})
            except ValueError as error:
                send({"type": "frame-failed", **about, "frame": key, "error": str(error)})
        self.current = {}

    def _keep_shared(self) -> tuple[tuple[str, int], ...]:
        if self.shared is None:
            return ()
        sha256 = hashlib.sha256(self.shared).hexdigest()
        if self.http.post(f"/api/farm/blobs/{sha256}/keep").status_code == 404:
            self.http.put(f"/api/farm/blobs/{sha256}", content=self.shared).raise_for_status()
        return ((sha256, len(self.shared)),)

    def _prepare(self, scene: str) -> None:
        self.prepared.append(scene)
        about = {"scene": scene, "kind": self.kind, "worker": self.name}
        self.send({"type": "prepare-started", **about})
        if self.unfit is not None:
            self.send({"type": "prepare-returned", **about, "error": self.unfit, "unfit": True, "passing": self.passing})
            return
        try:
            self.on_prepare(scene)
            answer = self.http.get(f"/api/farm/scenes/{scene}/manifest")
            if answer.status_code == 404:
                raise ValueError("The scene was deleted.")
            manifest = answer.raise_for_status().json()
            main = next(file for file in manifest["files"] if file["path"] == manifest["main"])
            content = self.http.get(f"/api/farm/blobs/{main['sha256']}").raise_for_status().content
            assert hashlib.sha256(content).hexdigest() == main["sha256"]
            if b"broken" in content:
                raise ValueError(f"{manifest['main']}, line 1: this is no scene.")
            compiled = b"compiled for " + self.kind.encode() + content
            sha256 = hashlib.sha256(compiled).hexdigest()
            self.http.put(f"/api/farm/blobs/{sha256}", content=compiled).raise_for_status()
            view = {"eye": [0.0, 0.0, 5.0], "target": [0.0, 0.0, 0.0], "up": [0.0, 1.0, 0.0], "fov": 40.0}
            ref = BlobRef("", sha256, len(compiled))
            cameras = [{"name": "front", "view": view}, {"name": "overview", "view": {**view, "fov": 60.0}}]
            counts, bounds = {"triangles": 12}, [[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]]
            variants = ["beach", "night", "night"] if b"variants" in content else []
            guessed = ["2 materials were guessed.", "The file x.png is missing."] if b"guessed" in content else []
            info = SceneInfo(self.kind, ref, None, cameras, counts, bounds, [], guessed, {}, 0.01, variants, blend=self.blend)
            self.send({"type": "prepared", **about, "info": asdict(info)})
        except ValueError as error:
            self.send({"type": "prepare-failed", **about, "error": str(error)})
