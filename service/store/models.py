"""What the database records: scenes, jobs and frames, and who may do what with them. Samples are recorded by the films."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from sqlalchemy import JSON, BigInteger, Boolean, Float, ForeignKey, Index, Integer, String, Text, UniqueConstraint, false, text
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column

__all__ = [
    "ACTIVE",
    "FINAL",
    "Base",
    "Delivery",
    "Environment",
    "Frame",
    "FrameChange",
    "Job",
    "Key",
    "Member",
    "Owner",
    "Project",
    "Quota",
    "Reference",
    "Scene",
    "ShareTerms",
    "Spent",
    "User",
    "Wait",
    "WorkerTerms",
    "blobs_of",
]

ACTIVE = ("queued", "running", "paused")
FINAL = ("finished", "failed", "cancelled")
NOTED = text("note IS NOT NULL")


class Base(DeclarativeBase):
    """The tables of this service."""


def blobs_of(refs: Iterable[dict[str, Any]]) -> set[str]:
    """The hashes of the blobs that worker.protocol.contract.BlobRefs refer to, and of their parts; those that can be made out."""
    found = {ref["sha256"] for ref in refs if isinstance(ref.get("sha256"), str)}
    for ref in refs:
        parts = ref.get("parts") or ()
        if isinstance(parts, list | tuple):
            found |= {part[0] for part in parts if isinstance(part, list | tuple) and part and isinstance(part[0], str)}
    return found


class Scene(Base):
    """An upload, or one under another light or with other materials of its files, which some job's request made of it.

    The id is a hash of the content, so the same files are the same scene; strict, they are another one.
    """

    __tablename__ = "scenes"

    id: Mapped[str] = mapped_column(String(40), primary_key=True)
    name: Mapped[str] = mapped_column(String(255))
    status: Mapped[str] = mapped_column(String(16), index=True)  # preparing | ready | failed
    error: Mapped[str | None] = mapped_column(Text)
    created: Mapped[float] = mapped_column(Float, index=True)
    main: Mapped[str] = mapped_column(Text)
    environment: Mapped[str | None] = mapped_column(Text)
    variant: Mapped[str | None] = mapped_column(Text)
    project: Mapped[str] = mapped_column(String(64), default="", server_default="")  # whose members see it; empty: everybody
    user: Mapped[str | None] = mapped_column(String(64))  # who uploaded it; None: a farm that asks nobody who they are
    key: Mapped[str | None] = mapped_column(String(20))  # by which token
    of: Mapped[str | None] = mapped_column(String(40), index=True)  # the upload that it is made of; None: it is one
    files: Mapped[list[dict[str, Any]]] = mapped_column(JSON)  # contract.BlobRef each
    bytes: Mapped[int] = mapped_column(BigInteger)
    notes: Mapped[list[str]] = mapped_column(JSON, default=list)  # warnings of the upload itself; of a refused scene, all
    strict: Mapped[bool] = mapped_column(Boolean, default=False, server_default=false())  # warnings fail it
    info: Mapped[dict[str, Any] | None] = mapped_column(JSON)  # contract.SceneInfo of the first kind that prepared it
    compiled: Mapped[dict[str, Any]] = mapped_column(JSON, default=dict)  # kind -> BlobRef
    measured: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))  # by its latest job: scheduling/measured.py

    @property
    def blobs(self) -> set[str]:
        """The hashes of the blobs that it refers to: its files, what Blender wrote, what it was compiled to, its thumbnail.

        Those that can be made out: a damaged row, or one of another release, must not keep others from being deleted.
        """
        files = self.files if isinstance(self.files, list) else []
        compiled = self.compiled if isinstance(self.compiled, dict) else {}
        info = self.info if isinstance(self.info, dict) else {}
        blend = info.get("blend")
        written = blend.get("files") if isinstance(blend, dict) else None
        files = [*files, *(written if isinstance(written, list) else ())]
        refs = [ref for ref in (*files, *compiled.values(), info.get("thumbnail")) if isinstance(ref, dict)]
        return blobs_of(refs)


class Job(Base):
    """A request for pictures of a scene, and how far it is."""

    __tablename__ = "jobs"
    # Lists and tallies are made of these alone: a row is thousands of bytes long, mostly its settings.
    __table_args__ = (
        Index("jobs_listed", "created", "id", "state", "scene", "name", "project"),
        Index("jobs_by_state", "state", "created", "id", "scene", "name", "project"),
        Index("jobs_ended", "finished", "id"),
        Index("jobs_by_picture", "picture", "created"),
        Index("jobs_of_user", "user", "state", "created"),
        Index("jobs_noted", "id", sqlite_where=NOTED, postgresql_where=NOTED),
    )

    id: Mapped[str] = mapped_column(String(40), primary_key=True)
    scene: Mapped[str] = mapped_column(String(40), index=True)  # the upload
    lit: Mapped[str | None] = mapped_column(String(40), index=True)  # what is rendered, where that is another scene's row
    light: Mapped[str | None] = mapped_column(Text)  # what the uploaded image is called that lights it
    name: Mapped[str] = mapped_column(String(255))
    state: Mapped[str] = mapped_column(String(16))
    priority: Mapped[int] = mapped_column(Integer, default=0)
    created: Mapped[float] = mapped_column(Float)
    started: Mapped[float | None] = mapped_column(Float)
    finished: Mapped[float | None] = mapped_column(Float)
    active_s: Mapped[float] = mapped_column(Float, default=0.0)  # wall time spent rendering, pauses left out
    request: Mapped[dict[str, Any]] = mapped_column(JSON)  # as it was asked
    settings: Mapped[dict[str, Any] | None] = mapped_column(JSON)  # RenderSettings; None until the scene is ready
    tile_size: Mapped[int | None] = mapped_column(Integer)
    spp: Mapped[int | None] = mapped_column(Integer)
    noise: Mapped[float | None] = mapped_column(Float)
    seconds: Mapped[float | None] = mapped_column(Float)
    kind: Mapped[str | None] = mapped_column(String(128))  # of the workers that render it, fixed at its first batch
    error: Mapped[str | None] = mapped_column(Text)
    reproduce: Mapped[str | None] = mapped_column(Text)  # a command that shows the error again
    shot: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))  # see service/shot.py; None: a still at frame 0
    focus: Mapped[list[int] | None] = mapped_column(JSON(none_as_null=True))  # x, y, w, h that is rendered first
    history: Mapped[dict[str, Any] | None] = mapped_column(
        JSON(none_as_null=True), deferred=True
    )  # see service/scheduling/jobs/history.py
    idempotency_key: Mapped[str | None] = mapped_column(String(255), unique=True)
    checked: Mapped[float | None] = mapped_column(Float)  # when its film was last read as a whole: service/keeping/scrub.py
    pinned: Mapped[bool] = mapped_column(Boolean, default=False, server_default=false())  # stays whatever its age
    user: Mapped[str | None] = mapped_column(String(64))  # who asked for it; None: a farm that asks nobody who they are
    max_slots: Mapped[int | None] = mapped_column(Integer)  # that may work on it at a time
    deadline: Mapped[float | None] = mapped_column(Float)  # by when it is wanted
    late: Mapped[float | None] = mapped_column(Float)  # since when it is expected to miss that; None: it is not
    needs: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))  # service/scheduling/fleet/needs.py
    picture: Mapped[str | None] = mapped_column(
        String(64)
    )  # equal for jobs of which one's samples are the other's: intake/picture.py
    taken: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))  # what it began with: keeping/reuse.py
    project: Mapped[str] = mapped_column(String(64), default="", server_default="")  # its scene's
    key: Mapped[str | None] = mapped_column(String(20))  # by which token it was asked for
    doubted: Mapped[list[str] | None] = mapped_column(JSON(none_as_null=True))  # whose samples in its film: keeping/taint.py
    note: Mapped[str | None] = mapped_column(Text)  # what somebody wrote about it

    @property
    def stage(self) -> str:
        """The scene whose compiled form is rendered."""
        return self.lit or self.scene


class Wait(Base):
    """A job that begins only when another is finished. The row goes when that is; see service/scheduling/waiting.py."""

    __tablename__ = "waits"

    job: Mapped[str] = mapped_column(ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True)
    other: Mapped[str] = mapped_column(String(40), primary_key=True, index=True)  # which may be deleted meanwhile


class ShareTerms(Base):
    """What somebody's jobs get of the slots, where an administrator has said so: service/scheduling/jobs/shares.py."""

    __tablename__ = "shares"

    name: Mapped[str] = mapped_column(String(80), primary_key=True)  # as share_of says it
    weight: Mapped[float] = mapped_column(Float)
    max_slots: Mapped[int | None] = mapped_column(Integer)


class WorkerTerms(Base):
    """What was asked of a worker, by its name: also of one that is away, for when it comes back."""

    __tablename__ = "worker_terms"

    name: Mapped[str] = mapped_column(String(255), primary_key=True)
    terms: Mapped[dict[str, Any]] = mapped_column(JSON)  # worker.protocol.terms.Terms


class Environment(Base):
    """An uploaded image that lights scenes. Its id is a hash of its content."""

    __tablename__ = "environments"

    id: Mapped[str] = mapped_column(String(40), primary_key=True)
    name: Mapped[str] = mapped_column(String(255))
    project: Mapped[str] = mapped_column(String(64), default="", server_default="")  # whose members see it; empty: everybody
    user: Mapped[str | None] = mapped_column(String(64))
    key: Mapped[str | None] = mapped_column(String(20))
    created: Mapped[float] = mapped_column(Float, index=True)
    file: Mapped[dict[str, Any]] = mapped_column(JSON)  # worker.protocol.contract.BlobRef
    thumbnail: Mapped[str] = mapped_column(String(64))  # the SHA-256 of a small picture, a JPEG

    @property
    def blobs(self) -> set[str]:
        """The hashes of the blobs that it refers to."""
        return {self.thumbnail, *blobs_of([self.file] if isinstance(self.file, dict) else [])}


class Reference(Base):
    """An uploaded picture to compare with. Its id is a hash of its content."""

    __tablename__ = "reference_pictures"

    id: Mapped[str] = mapped_column(String(40), primary_key=True)
    name: Mapped[str] = mapped_column(String(255))
    project: Mapped[str] = mapped_column(String(64), default="", server_default="")  # whose members see it; empty: everybody
    user: Mapped[str | None] = mapped_column(String(64))
    key: Mapped[str | None] = mapped_column(String(20))
    created: Mapped[float] = mapped_column(Float, index=True)
    file: Mapped[dict[str, Any]] = mapped_column(JSON)  # worker.protocol.contract.BlobRef: as it was uploaded
    film: Mapped[dict[str, Any]] = mapped_column(JSON)  # likewise: as the page reads it (watching/film_packet.py), by gzip
    width: Mapped[int] = mapped_column(Integer)
    height: Mapped[int] = mapped_column(Integer)
    is_display: Mapped[bool] = mapped_column(Boolean)  # it had 8 bits a channel, as a screen shows them
    clipped: Mapped[int] = mapped_column(Integer)  # pixels that the film cannot have as they were

    @property
    def blobs(self) -> set[str]:
        """The hashes of the blobs that it refers to."""
        return blobs_of([ref for ref in (self.file, self.film) if isinstance(ref, dict)])


class Frame(Base):
    """One picture of a job. Of a still, how it goes is said by the job."""

    __tablename__ = "frames"
    __table_args__ = (Index("frames_of_job", "job"),)

    job: Mapped[str] = mapped_column(ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True)
    number: Mapped[int] = mapped_column(Integer, primary_key=True)  # in halves: renderer.frames.frame_key
    samples: Mapped[int] = mapped_column(BigInteger, default=0)  # in the film, all pixels together
    target: Mapped[int] = mapped_column(BigInteger, default=0)  # what the request comes to at most
    bad_samples: Mapped[int] = mapped_column(BigInteger, default=0)
    progress: Mapped[float] = mapped_column(Float, default=0.0)
    state: Mapped[str] = mapped_column(String(16), server_default="queued", default="queued")  # running | finished | failed
    error: Mapped[str | None] = mapped_column(Text)
    noise: Mapped[float | None] = mapped_column(Float)
    spp: Mapped[int | None] = mapped_column(Integer)  # where it is to have others than the job
    # RenderSettings at its moment; None until that is known.
    settings: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))
    # Kind -> BlobRef of what was compiled for this frame alone, for as long as it is needed.
    compiled: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))

    @property
    def blobs(self) -> set[str]:
        """The hashes of the blobs that it refers to."""
        compiled = self.compiled if isinstance(self.compiled, dict) else {}
        return blobs_of([ref for ref in compiled.values() if isinstance(ref, dict)])


class FrameChange(Base):
    """What is being done to the frames of a long shot: service/store/frame_changes.py. The row goes when all is done."""

    __tablename__ = "frame_changes"

    job: Mapped[str] = mapped_column(ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True)
    steps: Mapped[list[dict[str, Any]]] = mapped_column(JSON)  # frame_changes.Step each
    done: Mapped[int] = mapped_column(Integer)  # of the frames that its steps name, all together
    samples: Mapped[int] = mapped_column(BigInteger)  # that frames come to which are not written down yet, for quotas


class User(Base):
    """Somebody who may log in."""

    __tablename__ = "users"

    name: Mapped[str] = mapped_column(String(64), primary_key=True)
    role: Mapped[str] = mapped_column(String(16))  # view | submit | admin
    password: Mapped[str | None] = mapped_column(Text)  # Argon2id; None: by a link alone
    subject: Mapped[str | None] = mapped_column(String(512), index=True)  # issuer and subject, of whom an OpenID provider lets in
    created: Mapped[float] = mapped_column(Float)


class Project(Base):
    """What some users alone see: service/access/projects.py."""

    __tablename__ = "projects"

    name: Mapped[str] = mapped_column(String(64), primary_key=True)
    created: Mapped[float] = mapped_column(Float)


class Member(Base):
    """A user who sees a project."""

    __tablename__ = "members"

    project: Mapped[str] = mapped_column(ForeignKey("projects.name", ondelete="CASCADE"), primary_key=True)
    user: Mapped[str] = mapped_column(String(64), primary_key=True, index=True)
    role: Mapped[str] = mapped_column(String(16), default="submit", server_default="submit")  # view | submit: at most this, there


class Quota(Base):
    """How much somebody may have, where an administrator has said so: service/access/quotas.py. None: no limit."""

    __tablename__ = "quotas"

    whose: Mapped[str] = mapped_column(String(80), primary_key=True)  # user:NAME or token:ID
    bytes: Mapped[int | None] = mapped_column(BigInteger)
    jobs: Mapped[int | None] = mapped_column(Integer)
    samples_day: Mapped[int | None] = mapped_column(BigInteger)


class Spent(Base):
    """What a job of the last day has rendered that was deleted, or by its id and /again, that is rendered anew."""

    __tablename__ = "spent"

    job: Mapped[str] = mapped_column(String(40), primary_key=True)
    user: Mapped[str | None] = mapped_column(String(64))
    key: Mapped[str | None] = mapped_column(String(20))
    created: Mapped[float] = mapped_column(Float, index=True)  # of the job
    samples: Mapped[int] = mapped_column(BigInteger)


class Key(Base):
    """A secret that lets somebody in. Only its hash is here."""

    __tablename__ = "keys"

    id: Mapped[str] = mapped_column(String(20), primary_key=True)  # which may be shown
    hash: Mapped[str] = mapped_column(String(64), unique=True)  # SHA-256
    kind: Mapped[str] = mapped_column(String(16))  # session | token | link | worker
    user: Mapped[str] = mapped_column(String(64), index=True)  # whose it is; of a worker's: who made it
    name: Mapped[str] = mapped_column(String(255))  # what it is for, in its owner's words
    role: Mapped[str] = mapped_column(String(16))  # at most this, and at most what the user may
    created: Mapped[float] = mapped_column(Float)
    expires: Mapped[float | None] = mapped_column(Float)
    seen: Mapped[float | None] = mapped_column(Float)


class Delivery(Base):
    """A message to one hook about the end of one job; service/hooks/outbox.py sends it until it has arrived."""

    __tablename__ = "deliveries"
    __table_args__ = (UniqueConstraint("hook", "job", "ended", name="deliveries_once"), Index("deliveries_due", "due"))

    id: Mapped[str] = mapped_column(String(40), primary_key=True)  # the same at every attempt
    hook: Mapped[str] = mapped_column(String(2048))  # a URL, or the path of a program
    job: Mapped[str] = mapped_column(String(40))  # empty: since when this hook is told
    ended: Mapped[float] = mapped_column(Float)
    message: Mapped[dict[str, Any]] = mapped_column(JSON)
    attempts: Mapped[int] = mapped_column(Integer, default=0)
    due: Mapped[float | None] = mapped_column(Float)  # when it is sent next; None: it has arrived, or is given up
    done: Mapped[float | None] = mapped_column(Float)
    error: Mapped[str | None] = mapped_column(Text)  # of the latest attempt


class Owner(Base):
    """Which service works as the farm, where several were started for it. service/owning/ says how that changes."""

    __tablename__ = "owners"

    what: Mapped[str] = mapped_column(String(40), primary_key=True)
    epoch: Mapped[int] = mapped_column(BigInteger)  # greater with each owner; what one of a lesser writes is refused
    owner: Mapped[str | None] = mapped_column(String(40))  # a life of a service; None: it has given the farm up
    place: Mapped[str] = mapped_column(String(300))  # its machine and port, for people
    url: Mapped[str] = mapped_column(String(300))  # where other services reach it
    folder: Mapped[str] = mapped_column(String(64))  # the id of its data folder, where its films lie
    process: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))  # service/owning/process.py
    locked: Mapped[bool] = mapped_column(Boolean)  # whether it holds the folder's lock: who gets that knows then that it is dead
    since: Mapped[float] = mapped_column(Float)
    takeovers: Mapped[int] = mapped_column(Integer)  # from owners that had not given up
    asked: Mapped[int] = mapped_column(BigInteger)  # by services that stand by: each time one more
    answered: Mapped[int] = mapped_column(BigInteger)  # by the owner, to which of these
    asked_by: Mapped[str | None] = mapped_column(String(300))
    asked_at: Mapped[float | None] = mapped_column(Float)  # unix time
