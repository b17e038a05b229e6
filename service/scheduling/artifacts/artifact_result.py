"""Result of a request for an artifact."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["ArtifactResult"]


@dataclass(frozen=True)
class ArtifactResult:
    """A finished artifact: SHA-256 of its blob, the version and sample count of its film, and the seconds that it took a worker.

    waited_s: seconds from its request until it was stored, also those until a worker began. is_preview: whether a better one can
    be requested.
    """

    sha256: str
    version: str = ""
    samples: int = 0
    seconds: float = 0.0
    waited_s: float = 0.0
    is_preview: bool = False
