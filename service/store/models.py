"""The database tables: scenes, jobs, frames, and access control. Samples are stored in films, not here."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    Float,
    ForeignKey,
    Index,
    Integer,
    LargeBinary,
    String,
    Text,
    UniqueConstraint,
    false,
    text,
)
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column

from renderer.sentences import Sentence
from service.store.sentence_columns import SentenceList, SentenceRecord, SentenceText

__all__ = [
    "ACTIVE_STATES",
    "FINAL_STATES",
    "STATE_LABELS",
    "Base",
    "Delivery",
    "Environment",
    "FarmOwner",
    "Frame",
    "FrameChange",
    "Job",
    "Key",
    "Member",
    "Project",
    "Quota",
    "Reference",
    "ReviewNote",
    "Scene",
    "ShareTerms",
    "Spent",
    "Take",
    "User",
    "Wait",
    "WorkerTerms",
    "blobs_of",
]

ACTIVE_STATES = ("queued", "running", "paused")
FINAL_STATES = ("finished", "failed", "cancelled")
STATE_LABELS: dict[str, str] = {  # as parameters of sentences
    "queued": Sentence("state-queued", "queued"),
    "running": Sentence("state-running", "running"),
    "paused": Sentence("state-paused", "paused"),
    "finished": Sentence("state-finished", "finished"),
    "failed": Sentence("job-state-failed", "failed"),
    "cancelled": Sentence("state-cancelled", "cancelled"),
}
HAS_NOTE = text("note IS NOT NULL")


class Base(DeclarativeBase):
    """Base class of all tables."""


def blobs_of(refs: Iterable[dict[str, Any]]) -> set[str]:
    """Returns the hashes of the blobs to which these BlobRefs (protocol.contract, as JSON) and their parts refer.

    Malformed references are skipped.
    """
    found = {ref["sha256"] for ref in refs if isinstance(ref.get("sha256"), str)}
    for ref in refs:
        parts = ref.get("parts") or ()
        if isinstance(parts, list | tuple):
            found |= {part[0] for part in parts if isinstance(part, list | tuple) and part and isinstance(part[0], str)}
    return found


class Scene(Base):
    """An uploaded scene, or one derived from it with other lighting, another material variant, up axis or floor.

    The id is a hash of the content, so uploading the same files again gives the same scene. A strict scene, which fails on
    warnings, has another id.
    """

    __tablename__ = "scenes"

    id: Mapped[str] = mapped_column(String(40), primary_key=True)
    name: Mapped[str] = mapped_column(String(255))
    status: Mapped[str] = mapped_column(String(16), index=True)  # preparing | ready | failed
    error: Mapped[str | None] = mapped_column(SentenceText)
    created: Mapped[float] = mapped_column(Float, index=True)
    main: Mapped[str] = mapped_column(Text)
    environment: Mapped[str | None] = mapped_column(Text)
    variant: Mapped[str | None] = mapped_column(Text)
    up: Mapped[str | None] = mapped_column(String(2))  # the axis of the file that becomes Y; None: a guess
    floor: Mapped[str | None] = mapped_column(String(8))  # the studio's: on | auto; None: off
    project: Mapped[str] = mapped_column(String(64), default="", server_default="")  # its members see it; empty: all users
    user: Mapped[str | None] = mapped_column(String(64))  # who uploaded it; None: a farm without authentication
    key: Mapped[str | None] = mapped_column(String(20))  # id of the token that was used
    of: Mapped[str | None] = mapped_column(String(40), index=True)  # the upload that it is derived from; None: it is an upload
    files: Mapped[list[dict[str, Any]]] = mapped_column(JSON)  # contract.BlobRef each
    bytes: Mapped[int] = mapped_column(BigInteger)
    notes: Mapped[list[str]] = mapped_column(
        SentenceList, default=list
    )  # warnings of the upload; of a failed scene, all warnings
    strict: Mapped[bool] = mapped_column(Boolean, default=False, server_default=false())  # whether warnings make it fail
    info: Mapped[dict[str, Any] | None] = mapped_column(
        SentenceRecord
    )  # contract.SceneInfo of the first worker kind that prepared it
    compiled: Mapped[dict[str, Any]] = mapped_column(JSON, default=dict)  # kind -> BlobRef
    measured: Mapped[dict[str, Any] | None] = mapped_column(
        JSON(none_as_null=True)
    )  # by its latest job: scheduling/jobs/measurements.py

    @property
    def blobs(self) -> set[str]:
        """The hashes of the blobs that the scene refers to: files, Blender's export, compiled forms, preview and pictures.

        Skips malformed references, so that a damaged row, or one of another release, does not block the deletion of others.
        """
        files = self.files if isinstance(self.files, list) else []
        compiled = self.compiled if isinstance(self.compiled, dict) else {}
        info = self.info if isinstance(self.info, dict) else {}
        blend = info.get("blend")
        written = blend.get("files") if isinstance(blend, dict) else None
        files = [*files, *(written if isinstance(written, list) else ())]
        pictures = (info.get(name) for name in ("thumbnail", "preview", "poster"))
        return blobs_of([ref for ref in (*files, *compiled.values(), *pictures) if isinstance(ref, dict)])


class Job(Base):
    """A request to render pictures of a scene, with its progress."""

    __tablename__ = "jobs"
    # Covering indexes for lists and counts: a row takes thousands of bytes, mostly its settings.
    __table_args__ = (
        Index("jobs_listed", "created", "id", "state", "scene", "name", "project"),
        Index("jobs_by_state", "state", "created", "id", "scene", "name", "project"),
        Index("jobs_ended", "finished", "id"),
        Index("jobs_by_picture", "picture", "created"),
        Index("jobs_of_user", "user", "state", "created"),
        Index("jobs_noted", "id", sqlite_where=HAS_NOTE, postgresql_where=HAS_NOTE),
    )

    id: Mapped[str] = mapped_column(String(40), primary_key=True)
    scene: Mapped[str] = mapped_column(String(40), index=True)  # the uploaded scene
    lit: Mapped[str | None] = mapped_column(String(40), index=True)  # the derived scene that is rendered, if any
    light: Mapped[str | None] = mapped_column(Text)  # name of the uploaded image that lights it
    name: Mapped[str] = mapped_column(String(255))
    state: Mapped[str] = mapped_column(String(16))
    priority: Mapped[int] = mapped_column(Integer, default=0)
    created: Mapped[float] = mapped_column(Float)
    started: Mapped[float | None] = mapped_column(Float)
    finished: Mapped[float | None] = mapped_column(Float)
    active_s: Mapped[float] = mapped_column(Float, default=0.0)  # seconds of rendering, without pauses
    request: Mapped[dict[str, Any]] = mapped_column(JSON)  # the original request
    settings: Mapped[dict[str, Any] | None] = mapped_column(JSON)  # RenderSettings; None until the scene is ready
    tile_size: Mapped[int | None] = mapped_column(Integer)
    spp: Mapped[int | None] = mapped_column(Integer)
    noise: Mapped[float | None] = mapped_column(Float)
    seconds: Mapped[float | None] = mapped_column(Float)
    kind: Mapped[str | None] = mapped_column(String(128))  # kind of the workers that render it, fixed at its first batch
    error: Mapped[str | None] = mapped_column(SentenceText)
    reproduce: Mapped[str | None] = mapped_column(Text)  # command that reproduces the error
    shot: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))  # see service/shot.py; None: a still at frame 0
    focus: Mapped[list[int] | None] = mapped_column(JSON(none_as_null=True))  # x, y, w, h of the area rendered first
    history: Mapped[dict[str, Any] | None] = mapped_column(
        JSON(none_as_null=True), deferred=True
    )  # see service/scheduling/jobs/history.py
    idempotency_key: Mapped[str | None] = mapped_column(String(255), unique=True)
    checked: Mapped[float | None] = mapped_column(Float)  # time of the last full check of its film: service/maintenance/scrub.py
    pinned: Mapped[bool] = mapped_column(Boolean, default=False, server_default=false())  # exempt from deletion by age
    user: Mapped[str | None] = mapped_column(String(64))  # who created it; None: a farm without authentication
    max_slots: Mapped[int | None] = mapped_column(Integer)  # limit of slots that work on it at a time
    deadline: Mapped[float | None] = mapped_column(Float)  # Unix time
    late: Mapped[float | None] = mapped_column(Float)  # time since when it is expected to miss its deadline; None: it is not
    needs: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))  # service/scheduling/fleet/needs.py
    picture: Mapped[str | None] = mapped_column(
        String(64)
    )  # cache key, equal for jobs whose samples are interchangeable: intake/picture.py
    taken: Mapped[dict[str, Any] | None] = mapped_column(
        JSON(none_as_null=True)
    )  # samples reused at its start: maintenance/reuse.py
    project: Mapped[str] = mapped_column(String(64), default="", server_default="")  # the project of its scene
    key: Mapped[str | None] = mapped_column(String(20))  # id of the token that created it
    doubted: Mapped[list[str] | None] = mapped_column(
        JSON(none_as_null=True)
    )  # workers with untrusted samples: maintenance/taint.py
    note: Mapped[str | None] = mapped_column(Text)  # free text by a user
    review: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))  # service/jobs/notes.py; None: no review yet

    @property
    def compiled_scene_id(self) -> str:
        """The id of the scene to render: the uploaded one, or one derived from it."""
        return self.lit or self.scene


class ReviewNote(Base):
    """A note on a job's picture, or a reply to one. See service/jobs/notes.py."""

    __tablename__ = "review_notes"
    __table_args__ = (Index("review_notes_of_job", "job", "created"),)

    id: Mapped[str] = mapped_column(String(20), primary_key=True)
    job: Mapped[str] = mapped_column(ForeignKey("jobs.id", ondelete="CASCADE"))
    reply_to: Mapped[str | None] = mapped_column(String(20))  # the note that it answers; None: it is not a reply
    frame: Mapped[int] = mapped_column(Integer)  # in half frames: renderer.frames.frame_key
    x: Mapped[float | None] = mapped_column(Float)  # place as a fraction of the picture's width; None: the whole picture
    y: Mapped[float | None] = mapped_column(Float)
    author: Mapped[str] = mapped_column(String(64))  # the user's name, or the name that a guest typed
    link: Mapped[str | None] = mapped_column(String(20))  # id of the share link that a guest used; None: written by a user
    text: Mapped[str] = mapped_column(Text)
    created: Mapped[float] = mapped_column(Float)
    resolved: Mapped[float | None] = mapped_column(Float)
    resolved_by: Mapped[str | None] = mapped_column(String(64))
    resolved_guest: Mapped[bool | None] = mapped_column(Boolean)  # whether that is a name that a guest typed; None: unknown


class Take(Base):
    """A saved camera with the settings of a scene's live view. See service/scenes/takes.py."""

    __tablename__ = "takes"
    __table_args__ = (Index("takes_of_scene", "scene", "created"),)

    id: Mapped[str] = mapped_column(String(20), primary_key=True)
    scene: Mapped[str] = mapped_column(ForeignKey("scenes.id", ondelete="CASCADE"))
    name: Mapped[str] = mapped_column(String(100))
    author: Mapped[str | None] = mapped_column(String(64))  # None: a farm without logins, and no name was given
    created: Mapped[float] = mapped_column(Float)
    request: Mapped[dict[str, Any]] = mapped_column(JSON)  # fields of models.jobs.JobIn, without `scene`
    exposure: Mapped[float] = mapped_column(Float)  # in stops
    tonemap: Mapped[str] = mapped_column(String(400))  # name of the tone curve
    picture: Mapped[bytes | None] = mapped_column(LargeBinary, deferred=True)  # a small WebP
    has_picture: Mapped[bool] = mapped_column(Boolean)


class Wait(Base):
    """A dependency of a job, which starts only after another job has finished. The row is then deleted.

    See service/scheduling/waiting.py.
    """

    __tablename__ = "waits"

    job: Mapped[str] = mapped_column(ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True)
    other: Mapped[str] = mapped_column(String(40), primary_key=True, index=True)  # may be deleted meanwhile


class ShareTerms(Base):
    """An administrator's settings for one share of the farm's slots: its weight and its maximum number of slots.

    See service/scheduling/jobs/shares.py.
    """

    __tablename__ = "shares"

    name: Mapped[str] = mapped_column(String(80), primary_key=True)  # as returned by share_of
    weight: Mapped[float] = mapped_column(Float)
    max_slots: Mapped[int | None] = mapped_column(Integer)


class WorkerTerms(Base):
    """An administrator's settings for the worker with a name. They also apply when the worker reconnects."""

    __tablename__ = "worker_terms"

    name: Mapped[str] = mapped_column(String(255), primary_key=True)
    terms: Mapped[dict[str, Any]] = mapped_column(JSON)  # protocol.terms.Terms


class Environment(Base):
    """An uploaded environment image for lighting. Its id is a hash of its content."""

    __tablename__ = "environments"

    id: Mapped[str] = mapped_column(String(40), primary_key=True)
    name: Mapped[str] = mapped_column(String(255))
    project: Mapped[str] = mapped_column(String(64), default="", server_default="")  # its members see it; empty: all users
    user: Mapped[str | None] = mapped_column(String(64))
    key: Mapped[str | None] = mapped_column(String(20))
    created: Mapped[float] = mapped_column(Float, index=True)
    file: Mapped[dict[str, Any]] = mapped_column(JSON)  # protocol.contract.BlobRef
    thumbnail: Mapped[str] = mapped_column(String(64))  # SHA-256 of a JPEG thumbnail

    @property
    def blobs(self) -> set[str]:
        """The hashes of the blobs that the environment refers to."""
        return {self.thumbnail, *blobs_of([self.file] if isinstance(self.file, dict) else [])}


class Reference(Base):
    """An uploaded reference picture for comparisons. Its id is a hash of its content."""

    __tablename__ = "reference_pictures"

    id: Mapped[str] = mapped_column(String(40), primary_key=True)
    name: Mapped[str] = mapped_column(String(255))
    project: Mapped[str] = mapped_column(String(64), default="", server_default="")  # its members see it; empty: all users
    user: Mapped[str | None] = mapped_column(String(64))
    key: Mapped[str | None] = mapped_column(String(20))
    created: Mapped[float] = mapped_column(Float, index=True)
    file: Mapped[dict[str, Any]] = mapped_column(JSON)  # protocol.contract.BlobRef of the uploaded file
    film: Mapped[dict[str, Any]] = mapped_column(JSON)  # BlobRef: gzipped film of protocol.pictures
    width: Mapped[int] = mapped_column(Integer)
    height: Mapped[int] = mapped_column(Integer)
    is_display: Mapped[bool] = mapped_column(Boolean)  # whether it had 8 bits per channel, display-encoded
    clipped: Mapped[int] = mapped_column(Integer)  # number of pixels that the film format cannot represent exactly

    @property
    def blobs(self) -> set[str]:
        """The hashes of the blobs that the reference picture refers to."""
        return blobs_of([ref for ref in (self.file, self.film) if isinstance(ref, dict)])


class Frame(Base):
    """One frame of a job. The state of a still image's only frame is that of the job."""

    __tablename__ = "frames"
    __table_args__ = (Index("frames_of_job", "job"),)

    job: Mapped[str] = mapped_column(ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True)
    number: Mapped[int] = mapped_column(Integer, primary_key=True)  # in half frames: renderer.frames.frame_key
    samples: Mapped[int] = mapped_column(BigInteger, default=0)  # stored in the film, over all pixels
    target: Mapped[int] = mapped_column(BigInteger, default=0)  # samples over all pixels that the request needs at most
    bad_samples: Mapped[int] = mapped_column(BigInteger, default=0)
    progress: Mapped[float] = mapped_column(Float, default=0.0)
    state: Mapped[str] = mapped_column(String(16), server_default="queued", default="queued")  # running | finished | failed
    error: Mapped[str | None] = mapped_column(SentenceText)
    noise: Mapped[float | None] = mapped_column(Float)
    spp: Mapped[int | None] = mapped_column(Integer)  # if it differs from the job's
    # RenderSettings of this frame; None until they are known.
    settings: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))
    # Kind -> BlobRef of the form compiled for this frame alone, while it is needed.
    compiled: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))

    @property
    def blobs(self) -> set[str]:
        """The hashes of the blobs that the frame refers to."""
        compiled = self.compiled if isinstance(self.compiled, dict) else {}
        return blobs_of([ref for ref in compiled.values() if isinstance(ref, dict)])


class FrameChange(Base):
    """A pending change of a shot's frames that is too large for one transaction (service/store/frame_changes.py).

    The row is deleted when the change is complete.
    """

    __tablename__ = "frame_changes"

    job: Mapped[str] = mapped_column(ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True)
    steps: Mapped[list[dict[str, Any]]] = mapped_column(JSON)  # frame_changes.Step each
    done: Mapped[int] = mapped_column(Integer)  # number of frames processed, counted over all steps
    samples: Mapped[int] = mapped_column(BigInteger)  # samples of frames that are not inserted yet, for quotas


class User(Base):
    """A user who may log in."""

    __tablename__ = "users"

    name: Mapped[str] = mapped_column(String(64), primary_key=True)
    role: Mapped[str] = mapped_column(String(16))  # view | submit | admin
    password: Mapped[str | None] = mapped_column(Text)  # Argon2id hash; None: the user logs in by link only
    subject: Mapped[str | None] = mapped_column(String(512), index=True)  # issuer and subject at an OpenID provider
    created: Mapped[float] = mapped_column(Float)


class Project(Base):
    """A project, whose content is visible only to its members. See service/access/projects.py."""

    __tablename__ = "projects"

    name: Mapped[str] = mapped_column(String(64), primary_key=True)
    created: Mapped[float] = mapped_column(Float)


class Member(Base):
    """The membership of a user in a project."""

    __tablename__ = "members"

    project: Mapped[str] = mapped_column(ForeignKey("projects.name", ondelete="CASCADE"), primary_key=True)
    user: Mapped[str] = mapped_column(String(64), primary_key=True, index=True)
    role: Mapped[str] = mapped_column(String(16), default="submit", server_default="submit")  # view | submit: at most this


class Quota(Base):
    """Limits of a user or token that an administrator has set; None means unlimited. See service/access/quotas.py."""

    __tablename__ = "quotas"

    whose: Mapped[str] = mapped_column(String(80), primary_key=True)  # user:NAME or token:ID
    bytes: Mapped[int | None] = mapped_column(BigInteger)
    jobs: Mapped[int | None] = mapped_column(Integer)
    samples_day: Mapped[int | None] = mapped_column(BigInteger)


class Spent(Base):
    """Samples of the last day that count towards quotas although no frame records them any more.

    job: id of a deleted job, or `<id>/again` for frames that are rendered again.
    """

    __tablename__ = "spent"

    job: Mapped[str] = mapped_column(String(40), primary_key=True)
    user: Mapped[str | None] = mapped_column(String(64))
    key: Mapped[str | None] = mapped_column(String(20))
    created: Mapped[float] = mapped_column(Float, index=True)  # of the job
    samples: Mapped[int] = mapped_column(BigInteger)


class Key(Base):
    """The secret of a session, token, share link or worker, which grants access. Only its hash is stored."""

    __tablename__ = "keys"

    id: Mapped[str] = mapped_column(String(20), primary_key=True)  # not secret
    hash: Mapped[str] = mapped_column(String(64), unique=True)  # SHA-256
    kind: Mapped[str] = mapped_column(String(16))  # session | token | link | worker | share
    user: Mapped[str] = mapped_column(String(64), index=True)  # owner; for a worker's key, its creator
    name: Mapped[str] = mapped_column(String(255))  # purpose, chosen by the owner; for a share link, its job
    role: Mapped[str] = mapped_column(String(16))  # upper limit, besides the user's own role
    created: Mapped[float] = mapped_column(Float)
    expires: Mapped[float | None] = mapped_column(Float)
    seen: Mapped[float | None] = mapped_column(Float)
    comments: Mapped[bool] = mapped_column(Boolean, default=False, server_default=false())  # a share link that allows notes


class Delivery(Base):
    """A webhook message to one hook about one job. service/hooks/outbox.py sends it until it is delivered."""

    __tablename__ = "deliveries"
    __table_args__ = (UniqueConstraint("hook", "job", "ended", name="deliveries_once"), Index("deliveries_due", "due"))

    id: Mapped[str] = mapped_column(String(40), primary_key=True)  # equal in all attempts
    hook: Mapped[str] = mapped_column(String(2048))  # URL, or path of a program
    job: Mapped[str] = mapped_column(String(40))  # empty: the row records since when this hook is configured
    ended: Mapped[float] = mapped_column(Float)
    message: Mapped[dict[str, Any]] = mapped_column(JSON)
    attempts: Mapped[int] = mapped_column(Integer, default=0)
    due: Mapped[float | None] = mapped_column(Float)  # time of the next attempt; None: delivered or given up
    done: Mapped[float | None] = mapped_column(Float)
    error: Mapped[str | None] = mapped_column(Text)  # of the latest attempt


class FarmOwner(Base):
    """The service that owns the farm, if several services were started for it. See service/ownership/."""

    __tablename__ = "owners"

    what: Mapped[str] = mapped_column(String(40), primary_key=True)
    epoch: Mapped[int] = mapped_column(BigInteger)  # increases with each owner; writes with a lesser epoch are refused
    owner: Mapped[str | None] = mapped_column(String(40))  # id of the owning process; None: ownership was released
    place: Mapped[str] = mapped_column(String(300))  # machine and port, for display
    url: Mapped[str] = mapped_column(String(300))  # URL for other services
    folder: Mapped[str] = mapped_column(String(64))  # id of the data folder with its films
    process: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))  # service/ownership/process.py
    locked: Mapped[bool] = mapped_column(Boolean)  # holds the folder's lock, which is free once the process is dead
    since: Mapped[float] = mapped_column(Float)
    takeovers: Mapped[int] = mapped_column(Integer)  # takeovers from owners that had not released ownership
    asked: Mapped[int] = mapped_column(BigInteger)  # number of the latest request by a standby service
    answered: Mapped[int] = mapped_column(BigInteger)  # number of the latest request that the owner answered
    asked_by: Mapped[str | None] = mapped_column(String(300))
    asked_at: Mapped[float | None] = mapped_column(Float)  # Unix time
