"""Fills a farm's database with the rows of very many jobs, as after years of use, without films."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from sqlalchemy import insert

from renderer.settings import RenderSettings
from renderer.view import View
from service.store.database import Sessions
from service.store.models import Frame, Job, Scene

__all__ = ["many_jobs"]

STATES = ("finished", "finished", "failed", "finished", "cancelled")
PAUSED_EVERY = 500  # few, since the engine loads paused jobs
SCENES = ("Kitchen", "Milk truck", "Cornell box", "Atrium at noon")
_VIEW = View((0.0, 0.0, 5.0), (0.0, 0.0, 0.0))
_FIRST = 1_700_000_000.0


def many_jobs(sessions: Sessions, n: int) -> None:
    """Inserts n jobs of four scenes into the database, created one per minute; most are finished.

    Every tenth job is a shot of three frames.
    """
    settings = RenderSettings(view=_VIEW, width=640, height=360).to_json()
    with sessions.begin() as session:
        session.execute(
            insert(Scene),
            [_scene(f"scene{i}", name) for i, name in enumerate(SCENES)],
        )
        session.execute(insert(Job), [_job(i, settings) for i in range(n)])
        session.execute(insert(Frame), [frame for i in range(n) for frame in _frames(i)])


def _scene(id: str, name: str) -> dict[str, Any]:
    info = {"cameras": [{"name": "Front", "view": asdict(_VIEW)}]}
    plain = {"error": None, "environment": None, "variant": None, "notes": [], "compiled": {}}
    return {
        "id": id,
        "name": name,
        "status": "ready",
        "created": _FIRST,
        "main": "a.obj",
        "files": [],
        "bytes": 1,
        "info": info,
        **plain,
    }


def _state(i: int) -> str:
    return "paused" if i % PAUSED_EVERY == 1 else STATES[i % len(STATES)]


def _job(i: int, settings: dict[str, Any]) -> dict[str, Any]:
    state = _state(i)
    scene = i % len(SCENES)
    return {
        "id": f"{i:020x}",
        "scene": f"scene{scene}",
        "name": f"{SCENES[scene]} take {i}",
        "state": state,
        "priority": i % 3,
        "created": _FIRST + 60 * i,
        "started": _FIRST + 60 * i + 1,
        "finished": _FIRST + 60 * i + 31 if state == "finished" else None,
        "active_s": 30.0,
        "request": {"scene": f"scene{scene}", "width": 640, "height": 360, "spp": 64},
        "settings": settings,
        "tile_size": 64,
        "spp": 64,
        "error": "The lamp broke." if state == "failed" else None,
        "shot": {"fps": 24.0} if i % 10 == 9 else None,
    }


def _frames(i: int) -> list[dict[str, Any]]:
    state = _state(i)
    target = 640 * 360 * 64
    progress = 1.0 if state == "finished" else 0.25
    own = {"job": f"{i:020x}", "target": target, "bad_samples": 0, "progress": progress, "samples": 0}  # there are no films
    return [{**own, "number": 2 * n, "state": "queued"} for n in range(3 if i % 10 == 9 else 1)]
