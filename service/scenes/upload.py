"""Creates scenes from uploads and from the examples."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator
from dataclasses import dataclass, replace

from anyio.to_thread import run_sync

from renderer.sentences import Sentence
from service.access.visit import Visit
from service.errors import NotFound
from service.farm import Farm
from service.intake.examples import examples, form_of
from service.intake.projects import UploadOwner, id_in_project
from service.intake.record import record
from service.intake.uploads import Upload, receive_upload, store_form
from service.jobs.lookup import find_scene, no_scene
from service.store.disk_space import translated_disk_errors
from service.store.models import Scene
from telemetry import tracing

__all__ = ["UploadRequest", "open_example", "upload"]


@dataclass(frozen=True)
class UploadRequest:
    """Body of an upload, as multipart/form-data. project: name, or empty. strict: whether warnings make the scene fail.

    traceparent: W3C Trace Context of the client.
    """

    content_type: str
    chunks: AsyncIterator[bytes]
    project: str
    strict: bool
    traceparent: str | None = None


async def upload(request: UploadRequest, visit: Visit, farm: Farm) -> Scene:
    """Stores the files of an upload as a scene, which workers then prepare. The same files always give the same scene.

    Raises FarmError.
    """
    begun = time.time()
    owner = await run_sync(_owner, request.project, visit, farm)
    bases: list[Scene] = []

    def find_base(id: str) -> Scene:
        found = find_scene(id, farm)
        if not visit.sight.is_visible(found.project):
            raise no_scene(id)
        bases[:] = [found]
        return found

    def write(stored: Upload) -> Scene:
        its = replace(owner, project=bases[0].project) if bases and not request.project else owner
        farm.access.projects.recheck(its.project, visit.caller, visit.sight)
        return _record_scene(stored.as_strict() if request.strict else stored, its, visit, farm)

    scene = await receive_upload(request.content_type, request.chunks, farm.blobs, farm.garbage, farm.settings, write, find_base)
    _record_upload_span(scene, begun, request.traceparent)
    return scene


def open_example(name: str, project: str, visit: Visit, farm: Farm) -> Scene:
    """Stores an example as a scene, as if its files had been uploaded. name: of the example. Raises FarmError."""
    owner = _owner(project, visit, farm)
    found = next((each for each in examples(farm.settings.examples) if each[0].name == name), None)
    if found is None:
        raise NotFound(
            Sentence(
                "example-not-found",
                "There is no example {name}. GET /api/examples lists those that are there.",
                name=repr(name[:60]),
            )
        )
    with translated_disk_errors():
        form = form_of(*found, farm.blobs)

    def write(stored: Upload) -> Scene:
        return _record_scene(stored, owner, visit, farm)

    return store_form(form, farm.blobs, farm.garbage, farm.settings, lambda size: None, write)


def _owner(project: str, visit: Visit, farm: Farm) -> UploadOwner:
    return UploadOwner(farm.access.projects.check(project, visit.sight), visit.user, visit.token)


def _record_scene(stored: Upload, owner: UploadOwner, visit: Visit, farm: Farm) -> Scene:
    farm.quotas.check_bytes(visit.caller, stored.size)
    return record(replace(stored, id=id_in_project(owner.project, stored.id)), farm.sessions, farm.events, owner=owner)


def _record_upload_span(scene: Scene, begun: float, traceparent: str | None) -> None:
    first = tracing.root_span("scene", scene.id)
    is_new = scene.created >= begun  # otherwise its trace started earlier
    tracing.record_span(
        *("upload", begun, time.time(), None if is_new else first),
        own=first if is_new else None,
        links=[tracing.parse_traceparent(traceparent)],
        scene=scene.id,
        bytes=scene.bytes,
        files=len(scene.files),
    )
