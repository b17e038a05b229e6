"""A Python client of a farm's service.

    with rayfarm.Client("http://127.0.0.1:8000") as farm:
        scene = farm.wait_for_scene(farm.upload([Path("milk-truck.glb")])["id"])
        job = farm.submit(scene["id"], width=960, height=540, spp=256)
        farm.wait(job["id"])
        Path("milk-truck.exr").write_bytes(farm.image(job["id"], "exr"))

Answers are the service's JSON as dicts; /docs of the service describes every field. A fault is a ClientError whose message
is the service's own sentence.
"""

from __future__ import annotations

import contextlib
import time
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import httpx

from renderer.errors import RayfarmError

__all__ = ["Client", "ClientError"]

Json = dict[str, Any]
POLL_S = 0.3
FINAL = ("finished", "failed", "cancelled")


class ClientError(RayfarmError):
    """The service cannot be reached, or refuses. `status`: its HTTP status, None where it was not reached."""

    def __init__(self, message: str, status: int | None = None) -> None:
        super().__init__(message)
        self.status = status


class Client:
    """A farm's service at `url`. Every method raises ClientError."""

    def __init__(self, url: str, timeout_s: float = 60.0) -> None:
        self.url = url.rstrip("/") if "://" in url else f"http://{url.rstrip('/')}"
        self._http = httpx.Client(base_url=self.url, timeout=httpx.Timeout(timeout_s, connect=5.0))

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def upload(
        self,
        files: Mapping[str, Path] | Sequence[Path],
        main: str | None = None,
        environment: str | None = None,
        name: str | None = None,
    ) -> Json:
        """Upload a scene: files by their path inside it, or a list of files side by side. Returns {id, status, ...}.

        main: which file is the scene, where that is not plain. environment: the path of an environment image among them.
        """
        named = files if isinstance(files, Mapping) else {path.name: path for path in files}
        fields = {key: value for key, value in (("main", main), ("environment", environment), ("name", name)) if value}
        with contextlib.ExitStack() as stack:
            parts = [("files", (path_inside, stack.enter_context(path.open("rb")))) for path_inside, path in named.items()]
            return self._json("POST", "/api/scenes", data=fields, files=parts, timeout=httpx.Timeout(3600.0, connect=5.0))

    def scene(self, scene: str) -> Json:
        """A scene: status (preparing, ready, failed), cameras, counts, bounds, warnings."""
        return self._json("GET", f"/api/scenes/{scene}")

    def wait_for_scene(self, scene: str, timeout_s: float = 900.0, watch: Callable[[Json], None] | None = None) -> Json:
        """The scene once it is ready. Raises ClientError with its error where it fails."""
        for state in self._poll(lambda: self.scene(scene), timeout_s):
            if watch:
                watch(state)
            if state["status"] == "ready":
                return state
            if state["status"] == "failed":
                raise ClientError(f"The scene cannot be rendered: {state.get('error') or 'no reason given'}")
        raise ClientError(f"The scene {scene} is still being prepared after {timeout_s:.0f} s; look at {self.url}.")

    def submit(self, scene: str, idempotency_key: str | None = None, **request: Any) -> Json:
        """Ask for a picture: width, height, spp, camera or view, max_depth, seed, ... as POST /api/jobs takes them."""
        headers = {"Idempotency-Key": idempotency_key or uuid.uuid4().hex}
        return self._json("POST", "/api/jobs", json={"scene": scene, **request}, headers=headers)

    def job(self, job: str) -> Json:
        """A job: state, progress 0..1, eta_s, samples, error."""
        return self._json("GET", f"/api/jobs/{job}")

    def jobs(self) -> list[Json]:
        """All jobs."""
        return self._list("/api/jobs", "jobs")

    def change(self, job: str, **fields: Any) -> Json:
        """Change a job: state (running, paused, cancelled), priority, spp."""
        return self._json("PATCH", f"/api/jobs/{job}", json=fields)

    def wait(self, job: str, timeout_s: float | None = None, watch: Callable[[Json], None] | None = None) -> Json:
        """The job once it is finished, failed or cancelled; a service that restarts meanwhile is waited for."""
        for state in self._poll(lambda: self.job(job), timeout_s):
            if watch:
                watch(state)
            if state["state"] in FINAL:
                return state
        raise ClientError(f"The job {job} is not finished after {timeout_s:.0f} s; it goes on at {self.url}.")

    def image(self, job: str, format: str = "png", frame: int = 0, **query: Any) -> bytes:
        """A frame as it is now, as the bytes of a png, exr or jpg. query: aov, exposure, tonemap, ..."""
        return self._send("GET", f"/api/jobs/{job}/frames/{frame}/image.{format}", params=query).content

    def digest(self, job: str, frame: int = 0) -> str:
        """SHA-256 of a frame's film."""
        return str(self._json("GET", f"/api/jobs/{job}/frames/{frame}/digest")["digest"])

    def workers(self) -> list[Json]:
        """The farm's workers."""
        return self._list("/api/workers", "workers")

    def _poll(self, ask: Callable[[], Json], timeout_s: float | None) -> Iterator[Json]:
        """Answers, a moment apart, until the time is over. A service that is away is asked again for a minute."""
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        away_since: float | None = None
        while deadline is None or time.monotonic() < deadline:
            try:
                yield ask()
                away_since = None
            except ClientError as error:
                away_since = away_since or time.monotonic()
                gone = error.status is not None and error.status < 500
                if gone or time.monotonic() - away_since > 60:
                    raise
            time.sleep(POLL_S)

    def _list(self, path: str, key: str) -> list[Json]:
        data = self._send("GET", path).json()
        return data[key] if isinstance(data, dict) else data

    def _json(self, method: str, path: str, **kwargs: Any) -> Json:
        data = self._send(method, path, **kwargs).json()
        if not isinstance(data, dict):
            raise ClientError(f"{self.url} does not answer as a Rayfarm service does.")
        return data

    def _send(self, method: str, path: str, **kwargs: Any) -> httpx.Response:
        try:
            response = self._http.request(method, path, **kwargs)
        except httpx.InvalidURL as error:
            raise ClientError(f"{self.url} is no address; give one as http://host:8000") from error
        except httpx.ConnectError as error:
            raise ClientError(f"No farm answers at {self.url}. Start one with `rayfarm up`, or name another server.") from error
        except httpx.HTTPError as error:
            raise ClientError(f"{self.url} does not answer ({error or type(error).__name__}). Try again.") from error
        if response.is_success:
            return response
        raise ClientError(_problem(response), response.status_code)


def _problem(response: httpx.Response) -> str:
    """The service's sentence (application/problem+json), or its status."""
    try:
        data = response.json()
        return str(data.get("detail") or data["title"])
    except (ValueError, KeyError, AttributeError):
        return f"{response.request.url} answers {response.status_code} {response.reason_phrase}"
