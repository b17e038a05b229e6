"""Takes of a scene: cameras with the settings of its live view, saved under a name for everyone who may see the scene."""

from __future__ import annotations

import base64
import io
import secrets
import time
from typing import Any

from PIL import Image
from sqlalchemy import Select, func, select
from sqlalchemy.orm import Session

from renderer.sentences import Sentence
from service.errors import Conflict, Invalid, NotFound
from service.farm import Farm
from service.intake.names import is_visible, plain_title
from service.jobs.lookup import no_scene
from service.jobs.notes import Writer
from service.models.jobs import JobIn
from service.models.queue import QueueOptionsIn
from service.models.takes import MAX_SIDE, TakeIn, TakeOut
from service.store.models import Scene, Take

__all__ = ["add_take", "delete_take", "rename_take", "select_takes", "take_out", "take_picture"]

MAX_TAKES = 200  # of a scene
FORMATS = ("PNG", "WEBP", "JPEG")
QUALITY = 80  # of a stored WebP
# Fields of a job's request that a live view does not read.
JOB_ONLY = {
    *("scene", "name", "views", "vary", "spp", "noise", "seconds", "tile_size", "priority", "frames", "order", "every"),
    *("verify", "denoise", "exposure", "tonemap", "strict", "fresh"),
    *QueueOptionsIn.model_fields,
}


def select_takes(scene: str) -> Select[Any]:
    """Returns the query for the takes of a scene, oldest first."""
    return select(Take).where(Take.scene == scene).order_by(Take.created, Take.id)


def add_take(scene: str, asked: TakeIn, writer: Writer, farm: Farm) -> TakeOut:
    """Saves a take. Raises NotFound, Invalid, Conflict if the scene has too many, and OverQuota."""
    name, author = _plain_name(asked.name), writer.user or plain_title(asked.author or "") or None
    if asked.request.scene != scene:
        raise Invalid(
            Sentence("take-of-other-scene", "request: its scene is another one. Give {scene}.", scene=scene), field="request"
        )
    farm.curves.find(asked.tonemap)
    picture = None if asked.picture is None else _small_picture(asked.picture)
    writer.check_rate(farm)
    with farm.sessions.begin() as session:
        if session.get(Scene, scene, with_for_update=True) is None:
            raise no_scene(scene)
        if (session.scalar(select(func.count()).where(Take.scene == scene)) or 0) >= MAX_TAKES:
            raise Conflict(Sentence("takes-too-many", "The scene has {most} takes. Delete some first.", most=MAX_TAKES))
        take = Take(id=secrets.token_hex(6), scene=scene, name=name, author=author, created=time.time())
        take.request, take.exposure, take.tonemap = _view_fields(asked.request), asked.exposure, asked.tonemap
        take.picture, take.has_picture = picture, picture is not None
        session.add(take)
        session.flush()
        return take_out(take)


def rename_take(scene: str, take: str, name: str, writer: Writer, farm: Farm) -> TakeOut:
    """Renames a take. Raises NotFound, Invalid and OverQuota."""
    plain = _plain_name(name)
    writer.check_rate(farm)
    with farm.sessions.begin() as session:
        found = _find_take(scene, take, session)
        found.name = plain
        session.flush()
        return take_out(found)


def delete_take(scene: str, take: str, writer: Writer, farm: Farm) -> None:
    """Deletes a take. Raises NotFound and OverQuota."""
    writer.check_rate(farm)
    with farm.sessions.begin() as session:
        session.delete(_find_take(scene, take, session))


def take_picture(scene: str, take: str, farm: Farm) -> bytes:
    """Returns the picture of a take, as WebP. Raises NotFound."""
    with farm.sessions() as session:
        picture = _find_take(scene, take, session).picture
    if picture is None:
        raise NotFound(Sentence("take-without-picture", "This take has no picture."))
    return picture


def take_out(take: Take) -> TakeOut:
    """Returns a take as the API's model."""
    return TakeOut(
        id=take.id,
        name=take.name,
        author=take.author,
        created=take.created,
        request={"scene": take.scene, **take.request},
        exposure=take.exposure,
        tonemap=take.tonemap,
        picture=f"/api/scenes/{take.scene}/takes/{take.id}/picture.webp" if take.has_picture else None,
    )


def _view_fields(request: JobIn) -> dict[str, Any]:
    """Returns the given fields of a request that a live view reads, as JSON."""
    return request.model_dump(mode="json", exclude=JOB_ONLY, exclude_unset=True, exclude_none=True)


def _plain_name(text: str) -> str:
    if not is_visible(name := plain_title(text)):
        raise Invalid(Sentence("take-name-missing", "Give the take a name."), field="name")
    return name


def _small_picture(text: str) -> bytes:
    """Returns a picture in base64 as WebP, without the metadata of the file. Raises Invalid if it is damaged or too large."""
    invalid = Invalid(
        Sentence(
            "take-picture-invalid",
            "picture: send a PNG, WebP or JPEG image of at most {most} pixels a side, in base64.",
            most=MAX_SIDE,
        ),
        field="picture",
    )
    try:
        with Image.open(io.BytesIO(base64.b64decode(text, validate=True)), formats=FORMATS) as image:
            if max(image.size) > MAX_SIDE:  # before any pixel is decoded
                raise invalid
            pixels = image.convert("RGBA" if image.has_transparency_data else "RGB")
    except Exception:  # damaged chunks raise many kinds, as struct.error and IndexError
        raise invalid from None
    stored = io.BytesIO()
    Image.frombytes(pixels.mode, pixels.size, pixels.tobytes()).save(stored, "WEBP", quality=QUALITY)
    return stored.getvalue()


def _find_take(scene: str, take: str, session: Session) -> Take:
    found = session.get(Take, take)
    if found is None or found.scene != scene:
        raise NotFound(Sentence("take-not-found", "This scene has no take {id}; it may have been deleted.", id=repr(take[:60])))
    return found
