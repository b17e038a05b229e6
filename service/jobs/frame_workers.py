"""Describes which workers rendered the samples of a frame, tile by tile."""

from __future__ import annotations

from pydantic import BaseModel, Field

from service.store.films import Film

__all__ = ["FrameWorkersOut", "TileSharesOut", "WorkerShareOut", "frame_workers"]


class WorkerShareOut(BaseModel):
    """A worker and the number of samples that it rendered of a frame."""

    name: str = Field(description="name of the worker")
    samples: int = Field(description="over all pixels")


class TileSharesOut(BaseModel):
    """A tile with samples, and how many of them each worker rendered."""

    x: int = Field(description="left edge in pixels")
    y: int = Field(description="upper edge in pixels")
    w: int = Field(description="width in pixels")
    h: int = Field(description="height in pixels")
    samples: int = Field(description="per pixel")
    shares: list[int] = Field(description="per pixel, of each worker in the order of `workers`")


class FrameWorkersOut(BaseModel):
    """Which workers rendered the samples of a frame."""

    workers: list[WorkerShareOut] = Field(description="by name")
    unknown: int = Field(description="samples over all pixels whose worker was not recorded")
    tiles: list[TileSharesOut] = Field(description="those that have samples")


def frame_workers(film: Film, key: int) -> FrameWorkersOut:
    """Returns the workers of a frame's samples. key: key of the frame (2 * frame number).

    Raises FilmUnavailable, FilmLost or FilmClosed.
    """
    counted = film.worker_shares(key)
    names = sorted({name for _, shares in counted for name in shares})
    total, known, tiles = 0, dict.fromkeys(names, 0), []
    for tile, (samples, shares) in zip(film.tiles, counted, strict=True):
        if not samples:
            continue
        pixels = tile.w * tile.h
        total += samples * pixels
        for name, own in shares.items():
            known[name] += own * pixels
        own_shares = [shares.get(name, 0) for name in names]
        tiles.append(TileSharesOut(x=tile.x, y=tile.y, w=tile.w, h=tile.h, samples=samples, shares=own_shares))
    workers = [WorkerShareOut(name=name, samples=samples) for name, samples in known.items()]
    return FrameWorkersOut(workers=workers, unknown=total - sum(known.values()), tiles=tiles)
