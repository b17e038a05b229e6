"""API models of workers, and of changes to them."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, Field, model_validator

from protocol.contract import WorkerReport
from protocol.hours import Hours
from renderer.frames import frame_number
from renderer.sentences import Sentence, from_text
from service.models.coded import Coded
from service.models.strict import Strict
from service.scheduling.snapshot import Snapshot

__all__ = ["WorkerOut", "WorkerPatch", "worker_out"]


def _valid_hours(text: str | None) -> str | None:
    if text:
        Hours.parse(text)
    return text


Week = Annotated[str | None, Field(max_length=500), AfterValidator(_valid_hours)]


class WorkerPatch(Strict):
    """The changeable settings of a running worker. Null resets a setting, except `state`, to the worker's start value."""

    state: Literal["running", "paused"] | None = Field(None, description="`paused`: the worker takes no new work")
    hours: Week = Field(
        None, description="working hours by the worker's clock, such as Mon-Fri 19:00-07:00, Sat-Sun; empty: always"
    )
    idle_minutes: float | None = Field(
        None,
        ge=0,
        le=1e6,
        allow_inf_nan=False,
        description="minutes without activity of a user before the worker renders; 0: it always renders",
    )
    nice: int | None = Field(None, ge=0, le=19, description="Unix niceness: higher yields more to other programs")
    slots: int | None = Field(None, ge=1, le=4096, description="maximum number of slots; not more than at its start")
    memory_gb: float | None = Field(
        None, ge=0, le=1e6, allow_inf_nan=False, description="GB of memory above which it takes no new work; 0: no limit"
    )

    @model_validator(mode="after")
    def _says_something(self) -> WorkerPatch:
        if not self.model_fields_set or (self.state is None and "state" in self.model_fields_set):
            raise ValueError(
                Sentence(
                    "worker-change-empty",
                    "nothing to change; give one of {fields}",
                    fields=["state", "hours", "idle_minutes", "nice", "slots", "memory_gb"],
                )
            )
        return self

    @property
    def terms(self) -> dict[str, Any]:
        """Returns the requested terms by the field names of protocol.terms.Terms. None resets a term to its start value."""
        said = {name: getattr(self, name) for name in self.model_fields_set - {"state"}}
        if "memory_gb" in said:
            gigabytes = said.pop("memory_gb")
            said["memory"] = None if gigabytes is None else round(gigabytes * 1e9)
        return said


class OfferOut(Coded):
    """What a worker offers, as it reports: tags, memory, hours and limits."""

    tags: list[str] = Field(description="tags that jobs can require by `needs`")
    memory: int = Field(description="bytes available: its limit, or the machine's memory")
    slots_most: int = Field(description="number of slots at its start")
    hours: str = Field(description="working hours by the worker's clock; empty: always")
    idle_minutes: float = Field(description="minutes without activity of a user before it renders; 0: it always renders")
    idle_by: list[str] = Field(description="sources of user activity: load, terminals, desktop, screen")
    nice: int = Field(description="Unix niceness of its processes")
    memory_limit: int = Field(description="bytes of memory above which it takes no new work; 0: no limit")
    rests: str | None = Field(description="why it takes no work at present, by its hours or limits")
    trouble: str | None = Field(description="requested settings that it cannot apply")


class CardOut(BaseModel):
    """A graphics card with which a worker's slot renders."""

    number: int = Field(description="number of the card on its machine")
    name: str = Field(description="model of the card")
    memory: int = Field(description="bytes of memory")
    capability: str = Field(description="compute capability, such as 8.6")
    slot: int = Field(description="index in `current`")
    samples_per_s: float = Field(description="samples per second of its latest batches; 0: none yet")


class WorkerOut(Coded):
    """A connected worker, as it reports itself."""

    name: str = Field(description="name of the worker")
    host: str = Field(description="name of its machine")
    pid: int = Field(description="process id on its machine")
    slots: int = Field(description="number of slots, each of which renders one batch at a time")
    cpu: str = Field(description="model of the processor")
    kind: str = Field(description="renderer version and processor kind; workers of one kind produce equal samples")
    state: Literal["starting", "ready", "paused"] = Field(description="whether it takes work")
    message: str | None = Field(description="why it is paused")
    started: float = Field(description="Unix time of its start")
    samples_per_s: float = Field(description="samples per second of one slot")
    current: list[dict[str, Any]] = Field(description="what each slot does at present; empty for an idle slot")
    denoises: bool = Field(description="whether it has Open Image Denoise")
    memory_used: int | None = Field(description="bytes used on its machine; null: unknown")
    memory_total: int | None = Field(description="bytes of memory of its machine; null: unknown")
    failures: int = Field(description="batches that failed there since the service started")
    speeds: list[float] = Field(
        description="samples per second of all slots while they render: means per minute of the last hour, newest last"
    )
    cards: list[CardOut] = Field([], description="graphics cards with which its slots render")
    cards_unused: list[str] = Field([], description="why other graphics cards are not used, a sentence each")
    transport: Literal["redis", "https"] = Field("redis", description="how it reaches the queue; https: through the service")
    offer: OfferOut | None = Field(
        description="its tags, hours and limits; null: a worker of an older release, which can only be paused"
    )


def worker_out(report: WorkerReport, why: str | None, view: Snapshot) -> WorkerOut:
    """Returns the API's model of a worker. why: the reason if it is paused, even while it still finishes its tasks."""
    current = [{**doing, "frame": frame_number(doing["frame"])} if _renders_frame(doing) else doing for doing in report.current]
    vitals = view.roster.vitals.get(report.name)
    offer = view.roster.offers.get(report.name)
    return WorkerOut(
        **{
            **asdict(report),
            "current": current,
            "state": report.state if why is None else "paused",
            "transport": report.transport or "redis",
            "cards_unused": [from_text(each) for each in report.cards_unused],
        },
        message=why or (offer.why if offer is not None and report.state == "paused" else None),
        memory_used=vitals.memory_used if vitals else None,
        memory_total=vitals.memory_total if vitals else None,
        failures=view.failures.get(report.name, 0),
        speeds=list(view.roster.speeds.get(report.name, ())),
        offer=OfferOut(**asdict(offer), rests=offer.why) if offer else None,
    )


def _renders_frame(doing: dict[str, Any]) -> bool:
    """Returns True if a slot's current work is a frame of a job. Frame keys are in units of half a frame."""
    return isinstance(doing.get("frame"), int)
