"""The file that lists the stored denoised pictures, so that they survive a restart."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from pathlib import Path

from service.scheduling.artifacts.artifact_result import ArtifactResult
from service.store.atomic_files import write_atomically
from service.store.blobs import is_sha256

__all__ = ["KeptArtifacts"]

MOST = 2000  # pictures in the file: the latest

log = logging.getLogger(__name__)


class KeptArtifacts:
    """The results of one kind of artifact, by job and frame key, as a JSON file. Its blobs are not swept at the start."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def load(self) -> dict[tuple[str, int], ArtifactResult]:
        """Returns the stored results; none if there is no file, or if it cannot be read."""
        try:
            rows = json.loads(self._path.read_bytes())
            found = {
                (str(job), int(frame)): ArtifactResult(
                    str(sha256), str(version), int(samples), float(seconds), float(waited[0]) if waited else 0.0
                )
                for job, frame, sha256, version, samples, seconds, *waited in rows  # files of earlier releases lack the last
            }
        except FileNotFoundError:
            return {}
        except (OSError, ValueError, TypeError, OverflowError) as error:
            log.warning("denoised pictures are made again, since %s cannot be read: %s", self._path.name, error)
            return {}
        return {key: result for key, result in found.items() if is_sha256(result.sha256)}

    def save(self, made: Mapping[tuple[str, int], ArtifactResult]) -> None:
        """Stores the latest results. Only logs a fault of the disk: the artifacts are made again then."""
        latest = list(made.items())[-MOST:]
        rows = [
            [job, frame, each.sha256, each.version, each.samples, each.seconds, each.waited_s] for (job, frame), each in latest
        ]
        try:
            write_atomically(self._path, json.dumps(rows).encode())
        except OSError as error:
            log.warning("denoised pictures are made again after a restart: %s", error)
