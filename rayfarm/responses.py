"""The service's responses as the Python client returns them. The service's page /docs describes every field.

Compatible with services of other releases: fields added by a newer one are ignored; a missing required field raises a ValueError
that names it.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import Any, ClassVar, TypeVar, cast

__all__ = [
    "BadSample",
    "Camera",
    "Environment",
    "Frame",
    "Job",
    "Scene",
    "Shot",
    "ShownInNotebooks",
    "Worker",
    "read",
    "read_list",
]

T = TypeVar("T")


class ShownInNotebooks:
    """Base class of scenes and jobs, which notebooks display as a progressive picture.

    They do so only for objects that a client returned. widget_of: function that returns the widget for an object and its client,
    or None without anywidget; set when the package is imported.
    """

    widget_of: ClassVar[staticmethod[[Any, Any], Any]] = staticmethod(lambda answer, farm: None)

    def _repr_mimebundle_(self, **asked: Any) -> Any:
        farm = getattr(self, "_farm", None)
        widget = None if farm is None else type(self).widget_of(self, farm)
        return {"text/plain": repr(self)} if widget is None else widget._repr_mimebundle_(**asked)


@dataclass(frozen=True)
class Camera:
    """A camera of a scene. `view`: its view, as accepted by `Client.submit`."""

    name: str
    view: dict[str, Any]


@dataclass(frozen=True)
class Scene(ShownInNotebooks):
    """An uploaded scene. status: preparing, ready or failed."""

    id: str
    status: str
    name: str
    main: str  # the scene file
    created: float  # Unix time
    bytes: int
    error: str | None = None
    step: str | None = None  # current step of preparing
    progress: float | None = None  # of preparing, 0 to 1
    files: list[dict[str, Any]] = field(default_factory=list)
    cameras: list[Camera] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)  # triangles, spheres, materials, ...
    bounds: list[list[float]] | None = None  # lower and upper corner
    animations: list[str] = field(default_factory=list)
    fps: float | None = None  # the file's own, else 24
    clips: list[dict[str, Any]] = field(default_factory=list)  # name, start and end in seconds
    variants: list[str] = field(default_factory=list)  # of a glTF file's materials
    variant: str | None = None  # the variant in use
    warnings: list[str] = field(default_factory=list)
    strict: bool = False  # whether warnings fail it
    has_floor: bool = False  # whether the studio's floor was added
    defaults: dict[str, Any] = field(default_factory=dict)  # settings in the scene file
    thumbnail: str | None = None


@dataclass(frozen=True)
class Environment:
    """An environment: a preset, or an uploaded image."""

    id: str
    name: str
    kind: str  # preset or image
    environment: dict[str, Any]  # its `environment` in a job's request


@dataclass(frozen=True)
class BadSample:
    """A sample that was discarded because it was NaN or infinite. reproduce: command that traces its path again."""

    x: int
    y: int
    sample: int
    reproduce: str = ""


@dataclass(frozen=True)
class Frame:
    """A frame of a job. state: queued, preparing, running, finished or failed."""

    number: float
    samples: int
    progress: float
    state: str = ""
    spp: float = 0.0  # mean samples per pixel
    noise: float | None = None
    error: str | None = None
    bad_samples: int = 0
    bad: list[BadSample] = field(default_factory=list)  # the first bad samples


@dataclass(frozen=True)
class Shot:
    """The frames of a job that has several: which there are, and how many are in each state."""

    frames: str  # such as 0-99,120
    count: int
    order: str
    states: dict[str, int] = field(default_factory=dict)
    failed: str = ""  # in the format of `frames`
    fps: float | None = None
    clip: str | None = None
    turntable: float | None = None
    every: int = 8
    first: float | None = None  # the frame that is rendered first
    noise: float | None = None  # maximum over its frames
    forecast: float | None = None  # expected noise at its end


@dataclass(frozen=True)
class Wait:
    """A job that another job depends on."""

    id: str
    name: str | None = None  # None if the job was deleted
    state: str | None = None


@dataclass(frozen=True)
class Job(ShownInNotebooks):
    """A job and its progress. state: queued, running, paused, finished, failed or cancelled."""

    id: str
    scene: str
    state: str
    progress: float  # 0 to 1
    samples: int  # of all pixels together
    created: float  # Unix time
    name: str = ""
    message: str | None = None  # why it does not progress
    error: str | None = None
    reproduce: str | None = None  # a command that reproduces the error
    priority: int = 0
    started: float | None = None
    finished: float | None = None
    active_s: float = 0.0
    elapsed_s: float = 0.0  # the same with the denoising of a finished still; 0 from services of earlier releases
    eta_s: float | None = None
    samples_per_s: float = 0.0
    bad_samples: int = 0
    width: int | None = None
    height: int | None = None
    spp: int | None = None
    noise: float | None = None
    seconds: float | None = None
    tile_size: int | None = None
    kind: str | None = None  # kind of the workers that render it
    settings: dict[str, Any] | None = None  # fixed when the scene is ready
    frames: list[Frame] = field(default_factory=list)  # of a shot only the first; see Client.frames
    shot: Shot | None = None
    after: list[str] = field(default_factory=list)  # ids of its dependencies
    user: str | None = None  # the user who submitted it
    max_slots: int | None = None  # maximum number of slots at a time
    needs: list[str] = field(default_factory=list)  # requirements on workers
    deadline: float | None = None  # Unix time
    expected: float | None = None  # expected finish, if it has a deadline
    late: float | None = None  # Unix time since which it is expected to miss the deadline
    warning: str | None = None  # a problem that the user may want to fix
    waits_for: list[Wait] = field(default_factory=list)  # its unfinished dependencies
    taken: dict[str, Any] | None = None  # the reused film: `job` and its `spp`
    review: dict[str, Any] | None = None  # the verdict, and the numbers of notes

    @property
    def is_over(self) -> bool:
        """Returns True if the job is finished, failed or cancelled."""
        return self.state in ("finished", "failed", "cancelled")


@dataclass(frozen=True)
class Offer:
    """The capabilities of a worker, as it reports them."""

    tags: list[str] = field(default_factory=list)
    memory: int = 0  # usable bytes
    slots_most: int = 0  # its number of processes
    hours: str = ""  # empty: always
    idle_minutes: float = 0.0
    idle_by: list[str] = field(default_factory=list)  # sources of user activity at its machine
    nice: int = 0
    memory_limit: int = 0  # bytes; 0: none
    rests: str | None = None  # why it is idle by its own hours or limits
    trouble: str | None = None  # which terms it cannot apply


@dataclass(frozen=True)
class Card:
    """A graphics card with which a worker's slot renders. memory: bytes; slot: index in `Worker.current`."""

    number: int
    name: str
    memory: int
    capability: str = ""  # compute capability, such as 8.6
    slot: int = 0
    samples_per_s: float = 0.0  # 0: none yet


@dataclass(frozen=True)
class Worker:
    """A worker of the farm. state: starting, ready or paused."""

    name: str
    host: str
    slots: int
    kind: str
    state: str
    cpu: str = ""
    pid: int = 0
    message: str | None = None  # why it is paused
    started: float = 0.0
    samples_per_s: float = 0.0  # of one slot
    current: list[dict[str, Any]] = field(default_factory=list)  # current work of each slot
    denoises: bool = False
    cards: list[Card] = field(default_factory=list)  # graphics cards with which its slots render
    cards_unused: list[str] = field(default_factory=list)  # why others are not used
    transport: str = "redis"  # how it reaches the queue: redis, or https: through the service alone
    offer: Offer | None = None  # None for an older release, which can only be paused


def read(cls: type[T], data: Any) -> T:
    """Converts the JSON of a response to a dataclass. Raises ValueError that names the invalid fields."""
    from pydantic import ValidationError

    try:
        answer: T = _adapter(cast("Any", cls)).validate_python(data)
    except ValidationError as error:
        raise ValueError(_sentence(_noun(cls), error.errors())) from None
    return answer


def read_list(cls: type[T], data: Any) -> list[T]:
    """Converts a list of responses, like `read`."""
    if not isinstance(data, list):
        raise ValueError(f"it sends something else than a list of {_noun(cls)}s")
    return [read(cls, item) for item in data]


@functools.cache
def _adapter(cls: Any) -> Any:
    from pydantic import TypeAdapter  # takes 0.2 s to import, which --help avoids

    return TypeAdapter(cls)  # type: ignore[valid-type,unused-ignore]


def _noun(cls: type[Any]) -> str:
    return cls.__name__.lower()


def _sentence(noun: str, errors: list[Any]) -> str:
    lacking = [str(error["loc"][-1]) for error in errors if error["type"] == "missing"]
    if lacking:
        return f"its {noun} lacks {', '.join(lacking[:4])}"
    at = ".".join(str(part) for part in errors[0]["loc"])
    return f"its {noun} cannot be read" + (f" ({at}: {errors[0]['msg'].lower()})" if at else "")
