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
from service.intake.uploads import Upload, receive_upload, scene_id, store_form
from service.jobs.lookup import find_scene, no_scene
from service.store.disk_space import translated_disk_errors
from service.store.models import Scene
from telemetry import tracing

__all__ = ["UploadRequest", "open_example", "upload"]

NO_LIGHTS = "scene-without-light"  # code of renderer.scene.studio.NO_LIGHTS_WARNING


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
    if (equal := _equal_scene(stored, owner.project, farm)) is not None:
        return equal
    return record(replace(stored, id=id_in_project(owner.project, stored.id)), farm.sessions, farm.events, owner=owner)


def _equal_scene(stored: Upload, project: str, farm: Farm) -> Scene | None:
    """Returns the scene of the same files that was uploaded without a floor, or with floor "auto", if both have the same content.

    They do if the files have light, at all times and in all variants. Returns None if there is no such scene, if its light is not
    known, or if the upload itself exists as a scene.
    """
    if stored.floor == "on" or stored.strict or stored.environment is not None:
        return None
    other = scene_id(stored.files, stored.main, None, stored.variant, stored.up, None if stored.floor else "auto")
    with farm.sessions() as session:
        if session.get(Scene, id_in_project(project, stored.id)) is not None:
            return None
        scene = session.get(Scene, id_in_project(project, other))
    if scene is None or scene.of is not None or scene.status != "ready" or scene.info is None:
        return None
    changes = "#" in stored.main or any(scene.info.get(name) for name in ("clips", "animations", "variants", "vary"))
    is_lit = all(getattr(warning, "code", "") != NO_LIGHTS for warning in scene.info.get("warnings", []))
    return scene if is_lit and not changes and not scene.info.get("floor") else None


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
