"""Facade of all work for workers other than batches. Used by the engine, the message handler and the lifecycle of jobs."""

from __future__ import annotations

from service.events import Events
from service.scheduling.artifacts.artifact_result import ArtifactResult
from service.scheduling.artifacts.denoising import DenoisedLights, Denoising
from service.scheduling.artifacts.environments import Environments
from service.scheduling.artifacts.frame_preparation import FramePreparation
from service.scheduling.artifacts.kept_artifacts import KeptArtifacts
from service.scheduling.artifacts.path_guides import PathGuides
from service.scheduling.artifacts.previews import DenoisedPreviews
from service.scheduling.artifacts.scene_preparation import ScenePreparations
from service.scheduling.artifacts.unfit_machines import MachineFault
from service.scheduling.artifacts.vectors import Vectors
from service.scheduling.dispatching.dispatcher import Dispatcher
from service.scheduling.fleet.workers import Workers
from service.scheduling.incoming.messages import (
    DenoiseDone,
    DenoiseFailed,
    EnvironmentFailed,
    EnvironmentShown,
    Message,
    PathGuideFailed,
    PathGuideTrained,
    VectorsFailed,
    VectorsMade,
)
from service.settings import Settings
from service.store.blobs import BlobStore

__all__ = ["DENOISED_FILE", "ArtifactTasks"]

DENOISED_FILE = "denoised.json"  # in the data folder


class ArtifactTasks:
    """Preparation of scenes and frames, path guides, and the artifacts that clients request."""

    def __init__(self, settings: Settings, dispatcher: Dispatcher, workers: Workers, blobs: BlobStore, events: Events) -> None:
        self.preparing = ScenePreparations(dispatcher, workers, settings.prepare_deadline)
        self.moments = FramePreparation(dispatcher, workers, settings.prepare_deadline, settings.frame_scenes_bytes)
        self.denoising = Denoising(dispatcher, workers, blobs, events)
        self.denoising.keep_in(KeptArtifacts(settings.data / DENOISED_FILE))
        self.denoised_lights = DenoisedLights(dispatcher, workers, blobs, events)
        self.vectors = Vectors(dispatcher, workers, blobs, events)
        self.environments = Environments(dispatcher, workers, blobs, events)
        self.previews = DenoisedPreviews(dispatcher, workers, blobs, events)
        self.path_guides = PathGuides(dispatcher, workers, blobs, events)
        self.previews.yield_to((self.denoising, self.denoised_lights))
        self.denoised_lights.yield_to((self.denoising, self.previews))
        self._denoisers = (self.denoising, self.previews, self.denoised_lights)
        self._aside = (*self._denoisers, self.vectors, self.environments, self.path_guides)

    @property
    def wait_for_slots(self) -> bool:
        """Returns True if scenes or clients' requests wait for a slot or are being worked on. Frames of shots are not counted."""
        return len(self.preparing.leases) > 0 or self.has_requests

    @property
    def has_requests(self) -> bool:
        """Returns True if clients wait for artifacts, or frames for path guides."""
        return any(each.has_requests for each in self._aside)

    def fill_artifacts(self) -> None:
        """Sends clients' open artifact requests to workers. Raises QueueError."""
        for each in self._aside:
            each.dispatch_work()

    def review_artifacts(self) -> None:
        """Sends lost artifact requests again, and fails overdue ones. Called once a second."""
        for each in self._aside:
            each.release_lost()

    def handle_artifact(self, message: Message) -> None:
        """Handles a worker's answer to an artifact request. Ignores other messages."""
        match message:
            case DenoiseDone():
                result = ArtifactResult(message.sha256, message.version, message.samples, message.seconds)
                for each in self._denoisers:
                    each.handle_answer(message.work, result)
            case DenoiseFailed():
                for each in self._denoisers:
                    each.handle_answer(message.work, None, message.error, _machine_fault(message))
            case VectorsMade():
                self.vectors.handle_answer(message.work, ArtifactResult(message.sha256))
            case VectorsFailed():
                self.vectors.handle_answer(message.work, None, message.error, _machine_fault(message))
            case PathGuideTrained():
                self.path_guides.handle_answer(message.work, ArtifactResult(message.sha256))
            case PathGuideFailed():
                self.path_guides.handle_answer(message.work, None, message.error, _machine_fault(message))
            case EnvironmentShown():
                self.environments.handle_answer(message.work, ArtifactResult(message.sha256))
            case EnvironmentFailed():
                self.environments.handle_answer(message.work, None, message.error, _machine_fault(message))

    def discard_job(self, job: str) -> None:
        """Discards the artifact requests and artifacts of a deleted job."""
        for each in self._denoisers:
            each.discard_job(job)
        self.vectors.discard_job(job)
        self.path_guides.discard_job(job)

    def close(self) -> None:
        """Stops the threads that query the blob store."""
        for each in self._aside:
            each.close()


def _machine_fault(message: DenoiseFailed | VectorsFailed | EnvironmentFailed | PathGuideFailed) -> MachineFault | None:
    return MachineFault(message.worker, message.error, passing=False) if message.unfit else None
