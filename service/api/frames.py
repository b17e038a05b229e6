"""/api/jobs/{id}/frames/{n}: the pictures, valid at any moment: what is not rendered yet has fewer samples, or none."""

from __future__ import annotations

import hashlib
from typing import Annotated, Literal

import numpy as np
from fastapi import APIRouter, Path, Query, Request, Response
from pydantic import BaseModel

from renderer import film as film_math
from renderer.image import tonemap
from renderer.image.encode import encode
from service.api.jobs import find_job
from service.farm import Farm, FarmDependency
from service.films import Film
from service.problem import Problem

__all__ = ["router"]

router = APIRouter(prefix="/api/jobs/{id}/frames/{n}", tags=["frames"])

MEDIA = {"png": "image/png", "jpg": "image/jpeg", "exr": "image/x-exr", "hdr": "image/vnd.radiance"}
AOVS: dict[str, slice | int] = {"albedo": film_math.ALBEDO, "normal": film_math.NORMAL, "depth": film_math.DEPTH}

Number = Annotated[int, Path(ge=0, le=65535, description="the frame; a still is 0")]
IMAGE = {"content": {media: {} for media in MEDIA.values()}, "description": "The picture."}


class Pixel(BaseModel):
    """A pixel as the film has it: means of its samples, scene-linear."""

    x: int
    y: int
    samples: int
    color: list[float]
    albedo: list[float]
    normal: list[float]
    depth: float


class Digest(BaseModel):
    """SHA-256 of a frame's sums and sample counts."""

    digest: str
    samples: int


@router.get("/image.{extension}", response_class=Response, responses={200: IMAGE, 304: {"description": "Not changed."}})
def image(
    id: str,
    n: Number,
    extension: Literal["png", "exr", "jpg", "hdr"],
    request: Request,
    farm: FarmDependency,
    aov: Literal["color", "albedo", "normal", "depth"] = "color",
    exposure: float = Query(0.0, ge=-32, le=32, allow_inf_nan=False, description="stops; for png and jpg"),
    tonemap_curve: str = Query("neutral", alias="tonemap", max_length=40, description="a curve's name; for png and jpg"),
    width: int | None = Query(None, ge=16, description="a smaller copy, at least this wide: for lists"),
) -> Response:
    """The picture so far. EXR and HDR are scene-linear; PNG and JPEG are exposed and tone-mapped."""
    if tonemap_curve not in tonemap.CURVES:
        raise Problem(422, f"tonemap: {tonemap_curve!r} is no curve; known are {', '.join(tonemap.CURVES)}.")
    film = _film(id, n, farm)
    key = f"{film.version(n)} {extension} {aov} {exposure} {tonemap_curve} {width}"
    headers = {"ETag": f'"{hashlib.sha256(key.encode()).hexdigest()[:32]}"', "Cache-Control": "no-cache"}
    if headers["ETag"] in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    if aov == "color":
        data = encode(_smaller(film.channel(n), width), extension, exposure, tonemap_curve)
    else:
        data = encode(_smaller(_visible(film, n, aov, extension), width), extension, 0.0, "srgb")
    headers["Content-Disposition"] = f'inline; filename="{id}-{n:04d}{"" if aov == "color" else "-" + aov}.{extension}"'
    return Response(data, media_type=MEDIA[extension], headers=headers)


@router.get("/pixel", response_model=Pixel)
def pixel(id: str, n: Number, farm: FarmDependency, x: int = Query(ge=0), y: int = Query(ge=0)) -> Pixel:
    """The exact values of a pixel, counted from the upper left, and how many samples it has."""
    film = _film(id, n, farm)
    if x >= film.width or y >= film.height:
        raise Problem(422, f"There is no pixel {x}, {y}: the frame is {film.width} x {film.height}, counted from 0.")
    at, tile = next((i, t) for i, t in enumerate(film.tiles) if t.x <= x < t.x + t.w and t.y <= y < t.y + t.h)
    sums = film.tile_sums(n, at)
    sums = np.zeros((film_math.CHANNELS, 1, 1), np.int64) if sums is None else sums[:, y - tile.y, x - tile.x, None, None]
    mean = {name: film_math.mean(sums, film.film_exponent, channel)[0, 0] for name, channel in AOVS.items()}
    return Pixel(
        x=x,
        y=y,
        samples=int(sums[film_math.SAMPLES, 0, 0]),
        color=film_math.mean(sums, film.film_exponent)[0, 0].tolist(),
        albedo=mean["albedo"].tolist(),
        normal=mean["normal"].tolist(),
        depth=float(mean["depth"]),
    )


@router.get("/digest", response_model=Digest)
def digest(id: str, n: Number, farm: FarmDependency) -> Digest:
    """A name for the frame's every bit: equal requests give equal digests, whoever rendered them."""
    film = _film(id, n, farm)
    return Digest(digest=film.digest(n), samples=film.samples(n))


def _film(id: str, n: int, farm: Farm) -> Film:
    job = find_job(id, farm)
    if n != 0:
        raise Problem(404, f"The job has no frame {n}; it has frame 0.")
    film = farm.film(job)
    if film is None:
        raise Problem(409, f"The job has no picture yet: {job.error or 'its scene is still being prepared.'}")
    return film


def _smaller(values: np.ndarray, width: int | None) -> np.ndarray:
    """The (h, w, 3) picture averaged over squares of whole pixels, so that it is at least `width` wide; what is left over at
    the right and lower edges of the last squares is cut off."""
    side = min(values.shape[1] // (width or values.shape[1]), values.shape[0])
    if side <= 1:
        return values
    h, w = values.shape[0] // side, values.shape[1] // side
    return values[: h * side, : w * side].reshape(h, side, w, side, 3).mean(axis=(1, 3), dtype=np.float32)


def _visible(film: Film, n: int, aov: str, extension: str) -> np.ndarray:
    """An AOV as an RGB picture: as it is for EXR and HDR, within 0 ... 1 for what is to be looked at."""
    values = film.channel(n, AOVS[aov])
    if values.ndim == 2:
        if extension in ("png", "jpg"):
            values = values / max(float(values.max()), 1e-12)
        return np.repeat(values[..., None], 3, axis=2)
    return values * 0.5 + 0.5 if aov == "normal" and extension in ("png", "jpg") else values
