"""Quotas of users and tokens: stored bytes (uploads and films), concurrent jobs, samples per day.

Users have the farm's default limits unless an administrator sets others. Administrators, and farms without login, have no limits
by default. Deleting a job frees its bytes at once; its samples count until 24 hours have passed.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, fields
from typing import Any, Literal, get_args

from sqlalchemy import Float, Select, case, cast, delete, func, select
from sqlalchemy.orm import InstrumentedAttribute, Session

from renderer.sentences import Sentence
from service.access.roles import Caller
from service.errors import NotFound, OutOfSpace, OverQuota
from service.store.database import Sessions
from service.store.models import ACTIVE_STATES, Environment, Frame, FrameChange, Job, Key, Quota, Reference, Scene, Spent, User

__all__ = ["DAY_S", "MAX_LIMIT", "NO_LIMITS", "Allowance", "Limits", "Quotas", "record_spent_samples"]

DAY_S = 86400.0
RETRY_AFTER_S = 60.0  # seconds after which a caller with too many jobs may retry
COUNT_TTL_S = 5.0  # age up to which a sum of bytes admits further jobs; counting them reads one size per job
MAX_LIMIT = (1 << 63) - 1  # largest number that is reported or may be set
ADVICE = "or ask the administrator of this farm for more"


@dataclass(frozen=True)
class Limits:
    """Three amounts of a user or token: stored bytes, unfinished jobs, and samples in the last 24 hours.

    They are either limits, where None means unlimited, or what is used at present.
    """

    bytes: int | None = None
    jobs: int | None = None
    samples_day: int | None = None


NO_LIMITS = Limits()
Kind = Literal["user", "token"]


@dataclass(frozen=True)
class Allowance:
    """Limits of a user or token, and how much of them is used.

    whose: user:NAME or token:ID. is_own: whether an administrator set these limits; otherwise they are the defaults.
    """

    whose: str
    limits: Limits
    used: Limits
    is_own: bool = False


class Quotas:
    """Looks up the limits of users and tokens, and how much of them is used.

    usual: the default limits. size_of: function that returns the size in bytes of a job's film, by job id.
    """

    def __init__(self, sessions: Sessions, usual: Limits, size_of: Callable[[str], int]) -> None:
        self._sessions = sessions
        self._usual = usual
        self._size_of = size_of
        self._counted: dict[tuple[Kind, str], tuple[float, int]] = {}  # time.monotonic() of the latest count, and the bytes

    def allowances_of(self, caller: Caller | None) -> list[Allowance]:
        """Returns the allowances that apply to a caller: the user's, and the token's if it has its own limits."""
        with self._sessions() as session:
            allowed = list(self._limits(caller, session))
            return [Allowance(whose, limits, self._usage_of(whose, session)) for whose, limits in allowed]

    def resource_names(self) -> list[str]:
        """Returns all users, and the tokens that have limits of their own, as sorted strings user:NAME and token:ID."""
        with self._sessions() as session:
            users = {f"user:{name}" for name in session.scalars(select(User.name))}
            return sorted(users | set(session.scalars(select(Quota.whose))))

    def existing_allowances(self, named: Collection[str]) -> list[Allowance]:
        """Returns the allowances of the given users and tokens (as `resource_names` returns them). A deleted one has no usage."""
        names: dict[Kind, list[str]] = {kind: [] for kind in get_args(Kind)}
        for kind, name in map(_kind_and_name, named):
            names[kind].append(name)
        with self._sessions() as session:
            rows = {row.whose: _limits_of(row) for row in session.scalars(select(Quota).where(Quota.whose.in_(named)))}
            chiefs = set(session.scalars(select(User.name).where(User.role == "admin", User.name.in_(names["user"]))))
            # One query per table for all of a kind: one query per user or token would take minutes with many of both.
            counts = (self._bytes, _jobs, _samples)
            used = {kind: [count(kind, session, some) for count in counts] for kind, some in names.items() if some}
        found = []
        for whose in named:
            kind, name = _kind_and_name(whose)
            usual = NO_LIMITS if kind == "token" or name in chiefs else self._usual
            uses = Limits(*(each[name] for each in used[kind]))
            found.append(Allowance(whose, rows.get(whose, usual), uses, whose in rows))
        return found

    def set(self, whose: str, limits: Limits | None) -> None:
        """Sets the limits of a user or token. Raises NotFound, or OutOfSpace if the disk is full.

        whose: user:NAME or token:ID. limits: None restores the default limits.
        """
        kind, _, name = whose.partition(":")
        with self._sessions.begin() as session:
            row = session.get(User if kind == "user" else Key, name)
            if row is None or (isinstance(row, Key) and row.kind != "token"):
                raise NotFound(
                    Sentence("user-not-found", "There is no user {name}. GET /api/users lists them.", name=repr(name[:64]))
                    if kind == "user"
                    else Sentence("token-not-found", "There is no token {id}. GET /api/tokens lists them.", id=repr(name[:64]))
                )
            session.execute(delete(Quota).where(Quota.whose == whose))
            if limits is not None:
                session.add(Quota(whose=whose, **{each.name: getattr(limits, each.name) for each in fields(Limits)}))

    def check_bytes(self, caller: Caller | None, added: int = 0) -> None:
        """Checks the storage quota.

        Raises OutOfSpace if `added` bytes would exceed the caller's limit, or if it is already reached.
        """
        with self._sessions() as session:
            for whose, limits in self._limits(caller, session):
                if limits.bytes is None:
                    continue
                used = self._bytes_of(*_kind_and_name(whose), session)
                if used + added > limits.bytes or used >= limits.bytes:
                    raise OutOfSpace(
                        Sentence(
                            "quota-bytes-exceeded",
                            "{owner} uploads and films use {used} of {limit}, and this needs {more} more. Delete jobs "
                            "or scenes, or ask the administrator of this farm for more.",
                            owner=_possessive(whose),
                            used=_in_mb(used),
                            limit=_in_mb(limits.bytes),
                            more=_in_mb(added),
                        )
                        if added
                        else Sentence(
                            "quota-bytes-full",
                            "{owner} uploads and films use {used} of {limit}. Delete jobs or scenes, or ask the "
                            "administrator of this farm for more.",
                            owner=_possessive(whose),
                            used=_in_mb(used),
                            limit=_in_mb(limits.bytes),
                        )
                    )

    def check_job(self, caller: Caller | None, session: Session, samples: int = 0, is_new: bool = True) -> None:
        """Checks the quotas of jobs, samples and bytes. Raises OverQuota, or OutOfSpace for bytes.

        samples: number of samples to add. session: the transaction that records the job. is_new: count it as one more job. To
        admit a job, a sum of bytes up to COUNT_TTL_S seconds old suffices, since the new film grows later; a rejection uses a new
        sum.
        """
        for whose, limits in self._limits(caller, session):
            kind, name = _kind_and_name(whose)
            if is_new and limits.jobs is not None and (count := _jobs(kind, session, [name])[name]) >= limits.jobs:
                raise OverQuota(
                    Sentence(
                        "quota-jobs-full",
                        "{owner} number of unfinished jobs is {count}; the limit is {limit}. Wait until one is "
                        "finished, cancel one, or ask the administrator of this farm for more.",
                        owner=_possessive(whose),
                        count=count,
                        limit=limits.jobs,
                    ),
                    RETRY_AFTER_S,
                )
            if limits.samples_day is not None:
                used = _samples(kind, session, [name])[name]
                if used >= limits.samples_day or used + samples > limits.samples_day:
                    raise OverQuota(
                        Sentence(
                            "quota-samples-exceeded",
                            "{owner} jobs of the last 24 hours used {used} of {limit} samples a day, and this needs "
                            "{more} more. Ask for fewer, wait, or ask the administrator of this farm for more.",
                            owner=_possessive(whose),
                            used=f"{used:,}",
                            limit=f"{limits.samples_day:,}",
                            more=f"{samples:,}",
                        )
                        if samples
                        else Sentence(
                            "quota-samples-full",
                            "{owner} jobs of the last 24 hours used {used} of {limit} samples a day. Ask for fewer, "
                            "wait, or ask the administrator of this farm for more.",
                            owner=_possessive(whose),
                            used=f"{used:,}",
                            limit=f"{limits.samples_day:,}",
                        ),
                        self._seconds_until_freed(whose, session),
                    )
            if limits.bytes is not None and not self._had_allowance_left(kind, name, limits.bytes):
                self.check_bytes(caller)

    def _limits(self, caller: Caller | None, session: Session) -> Iterable[tuple[str, Limits]]:
        if caller is None or not caller.is_known or caller.is_worker:
            return
        user = f"user:{caller.name}"
        row = session.get(Quota, user)
        if row is not None:
            yield user, _limits_of(row)
        elif not caller.sees_everything:
            yield user, self._usual
        if caller.kind == "token" and caller.key is not None:
            token = f"token:{caller.key}"
            if (row := session.get(Quota, token)) is not None:
                yield token, _limits_of(row)

    def _usage_of(self, whose: str, session: Session) -> Limits:
        kind, name = _kind_and_name(whose)
        return Limits(*(count(kind, session, [name])[name] for count in (self._bytes, _jobs, _samples)))

    def _bytes(self, kind: Kind, session: Session, names: Collection[str]) -> Counter[str]:
        """Returns the total bytes of uploads and films, by user or token."""
        sizes = Counter[str]()
        uploads = select(_owner(Scene, kind), func.sum(Scene.bytes)).where(Scene.of.is_(None))
        sizes.update(
            {
                owner: int(size or 0)
                for owner, size in session.execute(_filtered_by_owner(Scene, kind, names, uploads, grouped=True))
            }
        )
        for row in (Environment, Reference):
            for owner, file in session.execute(_filtered_by_owner(row, kind, names, select(_owner(row, kind), row.file))):
                sizes[owner] += int((file or {}).get("size") or 0)
        for owner, id in session.execute(_filtered_by_owner(Job, kind, names, select(_owner(Job, kind), Job.id))):
            sizes[owner] += self._size_of(id)
        return sizes

    def _bytes_of(self, kind: Kind, name: str, session: Session) -> int:
        """Returns the total bytes of one user's or token's uploads and films, and caches the sum for `_had_allowance_left`."""
        used = self._bytes(kind, session, [name])[name]
        self._counted[kind, name] = time.monotonic(), used
        return used

    def _had_allowance_left(self, kind: Kind, name: str, limit: int) -> bool:
        """Returns True if the latest sum of bytes is less than COUNT_TTL_S seconds old and below the limit."""
        counted, used = self._counted.get((kind, name), (-COUNT_TTL_S, limit))
        return used < limit and time.monotonic() - counted < COUNT_TTL_S

    def _seconds_until_freed(self, whose: str, session: Session) -> float:
        kind, name = _kind_and_name(whose)
        oldest = session.scalar(select(func.min(Job.created)).where(_owner(Job, kind) == name, Job.created > time.time() - DAY_S))
        return RETRY_AFTER_S if oldest is None else max(RETRY_AFTER_S, oldest + DAY_S - time.time())


def record_spent_samples(jobs: Iterable[Job], session: Session) -> None:
    """Records the samples of jobs that are about to be deleted, so that they still count towards the daily quota."""
    since = time.time() - DAY_S
    session.execute(delete(Spent).where(Spent.created < since))
    for job in jobs:
        if job.user is not None and job.created > since and session.get(Spent, job.id) is None:
            samples = session.scalar(select(func.sum(Frame.samples)).where(Frame.job == job.id))
            session.add(Spent(job=job.id, user=job.user, key=job.key, created=job.created, samples=int(samples or 0)))


def _samples_since(since: float) -> list[tuple[Select[Any], Any]]:
    """Returns the queries that sum the samples rendered since the Unix time `since`.

    With each comes the database table whose columns name the samples' owner.
    """
    asked = case((Frame.target > Frame.samples, Frame.target), else_=Frame.samples)
    # as floats: SQLite's integer sums overflow at 2**63
    of_jobs = select(func.sum(cast(case((Job.state.in_(ACTIVE_STATES), asked), else_=Frame.samples), Float)))
    of_jobs = of_jobs.join(Job, Frame.job == Job.id).where((Job.created > since) | Job.state.in_(ACTIVE_STATES))
    coming = select(func.sum(cast(FrameChange.samples, Float))).join(Job, FrameChange.job == Job.id)
    gone = select(func.sum(Spent.samples)).where(Spent.created > since)
    return [(of_jobs, Job), (coming, Job), (gone, Spent)]


def _limits_of(row: Quota) -> Limits:
    return Limits(row.bytes, row.jobs, row.samples_day)


def _jobs(kind: Kind, session: Session, names: Collection[str]) -> Counter[str]:
    """Returns the number of unfinished jobs, by user or token."""
    active = select(_owner(Job, kind), func.count()).where(Job.state.in_(ACTIVE_STATES))
    return Counter({row[0]: row[1] for row in session.execute(_filtered_by_owner(Job, kind, names, active, grouped=True))})


def _samples(kind: Kind, session: Session, names: Collection[str]) -> Counter[str]:
    """Returns the number of samples rendered in the last 24 hours, by user or token."""
    samples = Counter[str]()
    for query, row in _samples_since(time.time() - DAY_S):
        for count, owner in session.execute(
            _filtered_by_owner(row, kind, names, query.add_columns(_owner(row, kind)), grouped=True)
        ):
            samples[owner] = min(samples[owner] + int(count or 0), MAX_LIMIT)
    return samples


def _filtered_by_owner(row: Any, kind: Kind, names: Collection[str], query: Any, grouped: bool = False) -> Any:
    """Restricts a query to the database rows of the given users or tokens.

    row: the table with the owner columns. grouped: also group the result by owner.
    """
    owner = _owner(row, kind)
    query = query.where(owner.in_(names))
    return query.group_by(owner) if grouped else query


def _owner(row: Any, kind: Kind) -> InstrumentedAttribute[str]:
    found: InstrumentedAttribute[str] = row.user if kind == "user" else row.key
    return found


def _kind_and_name(whose: str) -> tuple[Kind, str]:
    kind, _, name = whose.partition(":")
    return "user" if kind == "user" else "token", name


def _possessive(whose: str) -> str:
    if whose.startswith("user:"):
        return Sentence("owner-you", "Your")
    return Sentence("owner-this-token", "This token's")


def _in_mb(size: int) -> str:
    return f"{size / 1e6:,.1f} MB" if size < 1e10 else f"{size / 1e9:,.1f} GB"
