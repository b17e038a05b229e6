"""Targets of the comparison: all target figures of all rows are defined here."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

__all__ = ["TABLE", "Goal", "Target", "at_least", "at_most"]


@dataclass(frozen=True)
class Goal:
    """A target figure that a value must reach (lower bound) or must not exceed (upper bound)."""

    bound: float
    side: Literal["at least", "at most"]

    def met(self, value: float) -> bool:
        """Returns whether a value satisfies the bound."""
        return value >= self.bound if self.side == "at least" else value <= self.bound

    def __str__(self) -> str:
        return f"{self.side} {self.bound:g}"


def at_least(bound: float) -> Goal:
    """Returns a lower bound."""
    return Goal(bound, "at least")


def at_most(bound: float) -> Goal:
    """Returns an upper bound."""
    return Goal(bound, "at most")


@dataclass(frozen=True)
class Target:
    """The targets of one row.

    lines: targets of single lines, by their names. each: target of every other line. mean: target of the geometric mean of these
    other lines.
    """

    title: str
    unit: str
    mean: Goal | None = None
    each: Goal | None = None
    lines: dict[str, Goal] = field(default_factory=dict)

    def goal_of(self, line: str) -> Goal | None:
        """Returns the target of the line with this name: its own, or else `each`; None if both are missing."""
        return self.lines.get(line, self.each)


_RATIO = "times the peer's"

TABLE: dict[str, Target] = {
    "against": Target("Samples a second against another commit of ours, by processor time", _RATIO, each=at_least(0.98)),
    "samples": Target("Samples a second against Mitsuba 3, llvm_ad_rgb", _RATIO, mean=at_least(1.3), each=at_least(1.1)),
    "error-time": Target(
        "Error in the same time against Mitsuba 3, multijitter",
        "times less error",
        mean=at_least(1.7),
        each=at_least(1.3),
        lines={"many lights": at_least(8.0)},
    ),
    "error-samples": Target(
        "Error by the same number of samples against Mitsuba 3, multijitter", "times less error", each=at_least(1.3)
    ),
    "cycles": Target(
        "Against Cycles 4.5",
        _RATIO,
        lines={"samples a second": at_least(3.0), "error in the same time": at_least(4.0)},
    ),
    "rays": Target(
        "Rays a second, one thread, against Embree 4's rtcIntersect1 and rtcOccluded1",
        _RATIO,
        mean=at_least(1.0),
        each=at_least(0.85),
    ),
    "build": Target("Building the BVH against Embree 4, medium quality, all cores", _RATIO, each=at_least(1.0)),
    "ready": Target(
        "From a GLB file to a scene that can be rendered",
        "seconds, or bytes a triangle",
        lines={
            "1 M triangles, seconds": at_most(1.5),
            "1 M triangles, bytes each": at_most(90),
            "10 M triangles, seconds": at_most(12.0),
            "10 M triangles, bytes each": at_most(90),
        },
    ),
    "formats": Target(
        "From a file of a million triangles to a scene that can be rendered",
        "seconds of the processor, or bytes a triangle",
        lines={
            f"{name}, {what}": at_most(bound)
            for name in ("a.glb", "a.ply", "a.stl", "a.usdc", "a.fbx", "a.3mf", "a.blend", "compressed.blend")
            for what, bound in (("seconds", 1.5), ("bytes each", 90))
        },
    ),
    "threads": Target("Samples a second of two threads", "times those of one", each=at_least(1.95)),
    "cold": Target(
        "Kernels that are not compiled yet",
        "seconds",
        lines={"empty cache to the first tile": at_most(15.0), "a worker joins a farm that has compiled": at_most(3.0)},
    ),
    # Allowed growth from the smallest to the largest, over the measured growth; a tenth is allowed for timing noise.
    "scaling": Target("Growth of the cost", "times the growth that log, log, linear, linear, linear allow", each=at_least(0.9)),
}
