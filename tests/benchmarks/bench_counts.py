"""Measures the processor time of lists, searches, quotas and starts as the number of scenes grows.

    python3 farm.py bench counts [--scenes 1000,10000]

N scenes come with N/10 users and tokens, N/50 projects, and N jobs, environments and references each. Times are milliseconds of
the service's process, the minimum of several tries.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from sqlalchemy import insert

from service.access.roles import OWNER, Role
from service.store.models import Environment, Frame, Job, Key, Member, Project, Reference, Scene, User
from tests.helpers import running_redis
from tests.service.conftest import Service

TRIES = 2
ASKED = {
    "scenes, a page": "/api/scenes?limit=100",
    "scenes, all on a page of 1,000": "/api/scenes?limit=1000",
    "scenes, a search": "/api/scenes?limit=100&search=house+77",
    "scenes, the last page": "/api/scenes?limit=100&offset={last}",
    "a scene": "/api/scenes/s0000007",
    "jobs, a page": "/api/jobs?limit=100",
    "jobs, a search": "/api/jobs?limit=100&search=house+77",
    "jobs, tallies": "/api/jobs/tallies",
    "users": "/api/users",
    "tokens": "/api/tokens",
    "projects": "/api/projects",
    "quotas": "/api/quotas",
    "environments": "/api/environments",
    "pictures to compare with": "/api/references",
    "shares": "/api/shares",
    "metrics": "/metrics",
}


def fill(service: Service, scenes: int) -> None:
    """Fills the database as after years of use of a farm with `scenes` scenes."""

    def ref(n: int) -> dict[str, Any]:
        return {"name": f"file{n}.obj", "sha256": hashlib.sha256(str(n).encode()).hexdigest(), "size": 1000 + n}

    users, projects = scenes // 10, max(1, scenes // 50)
    who, where = [f"user{n}" for n in range(users)], [f"project{n}" for n in range(projects)]
    info = {"cameras": [{"name": "camera", "view": {}}], "counts": {"triangles": 12}, "warnings": ["a word"] * 3}
    common = lambda n: {"project": where[n % projects] if n % 2 else "", "user": who[n % users], "created": 1e9 + n}  # noqa: E731
    rows: dict[Any, list[dict[str, Any]]] = {
        User: [{"name": name, "role": "submit", "password": None, "created": 1e9} for name in who],
        Project: [{"name": name, "created": 1e9} for name in where],
        Member: [{"project": where[n % projects], "user": who[n], "role": "submit"} for n in range(users)],
        Key: [
            {"id": f"k{n}", "hash": f"h{n}", "kind": "token", "user": who[n], "name": "token", "role": "submit", "created": 1e9}
            for n in range(users)
        ],
        Scene: [
            {"id": f"s{n:07}", "name": f"house {n}", "status": "ready", "main": "house.obj", "files": [ref(n)], "bytes": 1000 + n}
            | {"notes": [], "info": info, "compiled": {"kind": ref(n)}, **common(n)}
            for n in range(scenes)
        ],
        Job: [
            {"id": f"j{n:07}", "scene": f"s{n:07}", "name": f"night {n}", "state": "finished", "finished": 1e9 + n}
            | {"request": {"scene": f"s{n:07}", "width": 64, "height": 48}, "settings": None, "spp": 4, **common(n)}
            for n in range(scenes)
        ],
        Frame: [{"job": f"j{n:07}", "number": 0, "samples": 1 << 14, "target": 1 << 14} for n in range(scenes)],
        Environment: [
            {"id": f"e{n:07}", "name": f"sky {n}", "file": ref(n), "thumbnail": ref(n)["sha256"], **common(n)}
            for n in range(scenes)
        ],
        Reference: [
            {"id": f"r{n:07}", "name": f"plate {n}", "file": ref(n), "film": ref(n), "width": 64, "height": 48, **common(n)}
            | {"is_display": True, "clipped": 0}
            for n in range(scenes)
        ],
    }
    with service.farm.sessions.begin() as session:
        for table, each in rows.items():
            session.execute(insert(table), each)


def least(action: Callable[[], Any]) -> float:
    """Calls `action` several times, and returns the processor time of the fastest call, in milliseconds."""
    found = []
    for _ in range(TRIES):
        before = time.process_time()
        action()
        found.append(time.process_time() - before)
    return 1000 * min(found)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=lambda text: [int(n) for n in text.split(",")], default=[1000, 10_000])
    options = parser.parse_args()
    taken: dict[str, list[float]] = {}
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="rayfarm-counts-")))
        server = running_redis(folder)
        server.start()
        stack.callback(server.stop)
        for scenes in options.scenes:
            service = Service(folder / str(scenes), server)
            fill(service, scenes)
            service.http.timeout = 300
            service.http.headers["Authorization"] = f"Bearer {service.farm.access.keys.create('token', OWNER, Role.ADMIN)[0]}"

            def ask(path: str, service: Service = service, scenes: int = scenes) -> None:
                service.http.get(path.format(last=scenes - 100)).raise_for_status()

            ask("/healthz")
            for what, path in ASKED.items():
                taken.setdefault(what, []).append(least(partial(ask, path)))
            taken.setdefault("a restart", []).append(least(service.restart))
            service.stop()
    print("| milliseconds of a processor | " + " | ".join(f"{scenes:,} scenes" for scenes in options.scenes) + " |")
    print("|---|" + "---|" * len(options.scenes))
    for what, times in taken.items():
        print(f"| {what} | " + " | ".join(f"{each:,.0f}" for each in times) + " |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
