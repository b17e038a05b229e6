"""Python client of a farm's service.

    with rayfarm.Client("http://127.0.0.1:8000") as farm:
        scene = farm.wait_for_scene(farm.upload([Path("milk-truck.glb")]).id)
        job = farm.submit(scene.id, width=960, height=540, spp=256)
        farm.wait(job.id, watch=lambda job: print(f"{job.progress:.0%}"))
        Path("milk-truck.exr").write_bytes(farm.image(job.id, "exr"))

Methods return the dataclasses of rayfarm.responses. Errors are ClientErrors with the service's message.
"""

from __future__ import annotations

import contextlib
import json
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import quote

import httpx

from rayfarm.named_files import Files, by_name
from rayfarm.responses import Environment, Frame, Job, Scene, Worker, read, read_list
from renderer.errors import RayfarmError
from renderer.frames import frame_text
from renderer.variables import VariableError, value_of
from worker.exchange.foreign_server import MAX_ANSWER, describe_answer, is_address, is_loopback, not_a_farm
from worker.exchange.trust import verify_option, verify_option_for

if TYPE_CHECKING:
    from websockets.sync.client import ClientConnection

__all__ = ["TOKEN_VARIABLE", "Client", "ClientError"]

TOKEN_VARIABLE = "RAYFARM_API_TOKEN"

POLL_S = 0.3
UNREACHABLE_TIMEOUT_S = 60.0
RETENTION_EVERY_S = 0.5  # polling interval of a deletion
LONG_TIMEOUT = httpx.Timeout(3600.0, connect=5.0)  # for large uploads, and for answers that take long to make
ANSWER_S = 300.0  # timeout of a whole JSON answer
MAX_PICTURE = 8 << 30
MAX_MESSAGE = 64 << 20  # bytes; fits the largest tile, and all frames of a long shot
PROBLEM = "application/problem+json"
SAMPLES_HEADER = "X-Samples"  # sent with every picture
FRAMES_HEADER = "X-Frames"  # sent with every movie

T = TypeVar("T")


NO_FARM = "farm-not-answering"  # code of the error that no farm answers at the address


class ClientError(RayfarmError):
    """Raised if the service cannot be reached or rejects a request.

    status: the HTTP status; None if no farm responded. code, params: the message's code and its values; empty for messages of the
    client itself, except NO_FARM.
    """

    def __init__(
        self, message: str, status: int | None = None, code: str = "", params: Mapping[str, Any] = MappingProxyType({})
    ) -> None:
        super().__init__(message)
        self.status = status
        self.code = code
        self.params = params


class NotAFarm(ClientError):  # noqa: N818 - it is what was found
    """Raised if the server at the address responds, but is not a farm's service."""


@dataclass(frozen=True)
class _Answer:
    """A response with its complete body."""

    headers: httpx.Headers
    body: bytes


class Client:
    """Client of the farm's service at `url`. Every method raises ClientError."""

    def __init__(self, url: str, timeout_s: float = 60.0, token: str | None = None, certificate: str | None = None) -> None:
        """Stores the address and credentials.

        token: sent to a farm that requires a login; default $RAYFARM_API_TOKEN. certificate: path of the farm's own certificate,
        if the machine does not trust it; default $RAYFARM_TLS_CERT.
        """
        self.url = url.rstrip("/") if "://" in url else f"http://{url.rstrip('/')}"
        if token is None:
            try:
                token = value_of(TOKEN_VARIABLE)
            except VariableError as error:
                raise ClientError(str(error)) from error
        if not (token.isascii() and token.isprintable()):
            raise ClientError(f"The token has characters that no token has. Look at {TOKEN_VARIABLE}.")
        try:
            verify = verify_option(certificate)
        except (OSError, ValueError) as error:
            raise ClientError(f"The farm's certificate cannot be read: {error}.") from None
        self._verify = verify
        try:
            self._http = httpx.Client(
                verify=verify_option_for(verify, self.url),
                base_url=self.url if is_address(self.url) else "",
                timeout=httpx.Timeout(timeout_s, connect=5.0),
                headers={"Authorization": f"Bearer {token}"} if token else {},
                trust_env=not is_loopback(self.url),
            )
        except (ImportError, ValueError, httpx.InvalidURL) as error:
            raise ClientError(f"The proxy that HTTP_PROXY, ALL_PROXY and their like name cannot be used: {error}") from None

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the connections."""
        self._http.close()

    def call(self, method: str, path: str, **json_body: Any) -> Any:
        """Calls any route of the API, with an optional JSON body. Returns the response's JSON; None if it has none.

        farm.call("POST", "/api/users", name="anna", role="submit")
        """
        answer = self._send(method, path, json=json_body or None)
        return self._data(answer) if answer.body else None

    def upload(
        self,
        files: Files,
        main: str | None = None,
        environment: str | None = None,
        name: str | None = None,
        project: str = "",
        strict: bool = False,
        up: str | None = None,
        floor: str | None = None,
    ) -> Scene:
        """Uploads a scene: one file, a list of files from one folder, or a dict of files by their path inside the scene.

        main: the scene file, if it is ambiguous. environment: path of an environment image among the files. project: the scene is
        visible only to its members. strict: warnings make the scene fail, see `wait_for_scene`. up: the axis of an OBJ, PLY, STL
        or OFF file that is up; None: a guess. floor: "on", or "auto" for scenes without lights; None: without one.

            farm.upload({"spot.obj": here / "spot.obj", "textures/spot.png": here / "spot.png"}, main="spot.obj")
        """
        named = by_name(files)
        given = {"main": main, "environment": environment, "name": name, "strict": "true" if strict else None}
        given |= {"up": up, "floor": floor}
        fields = {key: value for key, value in given.items() if value}
        with contextlib.ExitStack() as stack:
            try:
                parts = [("files", (inside, stack.enter_context(path.open("rb")))) for inside, path in named.items()]
            except OSError as error:
                raise ClientError(f"{error.filename} cannot be read: {error.strerror}.") from error
            return self._read(
                Scene,
                self._send("POST", "/api/scenes", params=_project_query(project), data=fields, files=parts, timeout=LONG_TIMEOUT),
            )

    def upload_environment(self, image: str | Path, project: str = "") -> Environment:
        """Uploads an equirectangular environment image.

        farm.submit(scene.id, environment={"image": farm.upload_environment(here / "studio.exr").id})
        """
        try:
            with Path(image).open("rb") as file:
                sent = self._send(
                    "POST",
                    "/api/environments",
                    params=_project_query(project),
                    files=[("file", (Path(image).name, file))],
                    timeout=httpx.Timeout(3600.0),
                )
        except OSError as error:
            raise ClientError(f"{error.filename} cannot be read: {error.strerror}.") from error
        return self._read(Environment, sent)

    def scene(self, scene: str) -> Scene:
        """Returns the current state of a scene.

        farm.scene(id).status  # preparing, ready or failed
        """
        return self._read(Scene, self._send("GET", f"/api/scenes/{_id(scene)}"))

    def scenes(self, **query: Any) -> list[Scene]:
        """Returns the scenes that match the query, newest first. query: search (words of names, or an id's prefix), project,
        limit, offset.

        farm.scenes(search="truck")
        """
        return self._list(Scene, "/api/scenes", **query)

    def wait_for_scene(self, scene: str, timeout_s: float = 900.0, watch: Callable[[Scene], None] | None = None) -> Scene:
        """Waits until the scene is ready, and returns it. Raises ClientError with the scene's error if it fails."""
        for found in self._poll(lambda: self.scene(scene), timeout_s):
            if watch:
                watch(found)
            if found.status == "ready":
                return found
            if found.status == "failed":
                raise ClientError(f"The scene cannot be rendered: {found.error or 'no reason given'}")
        raise ClientError(f"The scene {scene} is still being prepared after {timeout_s:.0f} s; look at {self.url}.")

    def submit(self, scene: str, idempotency_key: str | None = None, **request: Any) -> Job:
        """Submits a job: width, height, spp, camera or view, max_depth, seed, ... as in POST /api/jobs.

        farm.submit(scene.id, width=960, height=540, noise=0.02, camera=scene.cameras[0].name)
        """
        headers = {"Idempotency-Key": idempotency_key or uuid.uuid4().hex}
        return self._read(Job, self._send("POST", "/api/jobs", json={"scene": scene, **request}, headers=headers))

    def job(self, job: str) -> Job:
        """Returns the current state of a job.

        farm.job(id).progress  # 0 to 1
        """
        return self._read(Job, self._send("GET", f"/api/jobs/{_id(job)}"))

    def jobs(self, **query: Any) -> list[Job]:
        """Returns the jobs that match the query, newest first. query: search (words of names and notes, or an id's prefix),
        state, scene, ...

        farm.jobs(search="7f3a")
        """
        return self._list(Job, "/api/jobs", **query)

    def change(self, job: str, **fields: Any) -> Job:
        """Changes a job and returns it: state (running, paused, cancelled), priority, spp, after; for shots extend, again, first,
        order, frames.

        farm.change(job.id, state="paused")
        """
        return self._read(Job, self._send("PATCH", f"/api/jobs/{_id(job)}", json=fields))

    def delete(self, job: str) -> None:
        """Deletes a job with its pictures.

        farm.delete(job.id)
        """
        self._send("DELETE", f"/api/jobs/{_id(job)}")

    def wait(self, job: str, timeout_s: float | None = None, watch: Callable[[Job], None] | None = None) -> Job:
        """Waits until the job has ended (is finished, failed or cancelled), and returns it.

        Continues to wait while the service restarts.
        """
        for found in self._poll(lambda: self.job(job), timeout_s):
            if watch:
                watch(found)
            if found.is_over:
                return found
        raise ClientError(f"The job {job} is not finished after {timeout_s:.0f} s; it goes on at {self.url}.")

    def frames(self, job: str, **query: Any) -> list[Frame]:
        """Returns the frames of a job, in order; all of them without a query: state, limit, offset.

        [frame.number for frame in farm.frames(job.id) if frame.state == "failed"]
        """
        return self._list(Frame, f"/api/jobs/{_id(job)}/frames", **query)

    def movie(self, job: str, format: str = "mp4", **query: Any) -> bytes:
        """Returns the frames that have samples as a movie: mp4, webm or webp. query: frames, fps, width, exposure, tonemap.

        Path("shot.mp4").write_bytes(farm.movie(job.id))
        """
        answer = self._send("GET", f"/api/jobs/{_id(job)}/movie.{format}", limit=MAX_PICTURE, params=query, timeout=LONG_TIMEOUT)
        if FRAMES_HEADER not in answer.headers:
            raise NotAFarm(not_a_farm(self.url, "what it sends is not a film of a farm"))
        return answer.body

    def image(self, job: str, format: str = "png", frame: float = 0, **query: Any) -> bytes:
        """Returns the present picture of a frame as a png, exr or jpg file. query: aov, exposure, tonemap, denoise, ...

        Path("out.png").write_bytes(farm.image(job.id, exposure=1.0, denoise=True))
        """
        path = f"/api/jobs/{_id(job)}/frames/{frame_text(frame)}/image.{format}"
        waits = {"timeout": LONG_TIMEOUT} if query.get("denoise") else {}
        answer = self._send("GET", path, limit=MAX_PICTURE, params=query, **waits)
        if SAMPLES_HEADER not in answer.headers:
            raise NotAFarm(not_a_farm(self.url, "what it sends is not a picture of a farm"))
        return answer.body

    def deep_image(self, job: str, frame: float = 0) -> bytes:
        """Returns the present deep picture of a frame as an EXR file, of a job with the setting deep.

        Path("out.deep.exr").write_bytes(farm.deep_image(job.id))
        """
        path = f"/api/jobs/{_id(job)}/frames/{frame_text(frame)}/deep.exr"
        answer = self._send("GET", path, limit=MAX_PICTURE, timeout=LONG_TIMEOUT)
        if SAMPLES_HEADER not in answer.headers:
            raise NotAFarm(not_a_farm(self.url, "what it sends is not a picture of a farm"))
        return answer.body

    def digest(self, job: str, frame: float = 0) -> str:
        """Returns the SHA-256 of a frame's film. Equal requests give equal digests."""
        answer = self._send("GET", f"/api/jobs/{_id(job)}/frames/{frame_text(frame)}/digest")
        data = self._data(answer)
        if not isinstance(data, dict) or not isinstance(data.get("digest"), str):
            raise self._not_a_farm_error(answer)
        return str(data["digest"])

    def workers(self) -> list[Worker]:
        """Returns the farm's workers by name."""
        return self._list(Worker, "/api/workers")

    def let_go(
        self, dry_run: bool = True, progress: Callable[[int, int | None], None] = lambda done, planned: None, **rules: Any
    ) -> dict[str, Any]:
        """Deletes data by retention rules: films_days, films_bytes, compiled_days, uploads_days; by default the farm's own rules.

        farm.let_go(films_days=30)["bytes"]  # dry run; dry_run=False deletes, and waits until it is done
        progress: called with the number of items done and, once it is known, their total.
        """
        data = self._retention("POST", json={"dry_run": dry_run, **rules})
        while data.get("state") == "running":
            progress(int(data["done"]), data["planned"])
            time.sleep(RETENTION_EVERY_S)
            data = self._retention("GET")
        if data.get("state") in ("failed", "stopped"):
            raise ClientError(data.get("error") or "The service has ended before all was deleted. Try again.")
        return data

    def _retention(self, method: str, **options: Any) -> dict[str, Any]:
        answer = self._send(method, "/api/retention", timeout=LONG_TIMEOUT, **options)
        data = self._data(answer)
        if not isinstance(data, dict) or not isinstance(data.get("items"), list):
            raise self._not_a_farm_error(answer)
        return data

    def socket(self, path: str) -> ClientConnection:
        """Opens a WebSocket of the API, such as /api/jobs/{id}/live.

        with farm.socket(f"/api/jobs/{job.id}/live") as live: print(live.recv())
        """
        from websockets.exceptions import InvalidHandshake, InvalidStatus, InvalidURI
        from websockets.sync.client import connect

        headers = {"Authorization": authorization} if (authorization := self._http.headers.get("Authorization")) else None
        secure = self._verify if self.url.startswith("https") and not isinstance(self._verify, bool) else None
        try:
            return connect(
                f"ws{self.url.removeprefix('http')}{path}",
                additional_headers=headers,
                ssl=secure,
                compression=None,
                max_size=MAX_MESSAGE,
                open_timeout=20,
                proxy=None if is_loopback(self.url) else True,
            )
        except InvalidStatus as error:
            status = error.response.status_code
            raise ClientError(f"{self.url} refuses the live picture ({status}). Is its token right?", status) from None
        except (OSError, TimeoutError, InvalidHandshake, InvalidURI) as error:
            raise ClientError(f"{self.url} does not answer ({error or type(error).__name__}). Try again.") from error

    def _poll(self, ask: Callable[[], T], timeout_s: float | None) -> Iterator[T]:
        """Yields results of `ask` at short intervals until the timeout. Retries for a minute while the service is unreachable."""
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        away_since: float | None = None
        while deadline is None or time.monotonic() < deadline:
            try:
                yield ask()
                away_since = None
            except ClientError as error:
                away_since = away_since or time.monotonic()
                gone = isinstance(error, NotAFarm) or (error.status is not None and error.status < 500)
                if gone or time.monotonic() - away_since > UNREACHABLE_TIMEOUT_S:
                    raise
            time.sleep(POLL_S)

    def _list(self, cls: type[T], path: str, **query: Any) -> list[T]:
        answer = self._send("GET", path, params=query)
        try:
            found = read_list(cls, self._data(answer))
        except ValueError as error:
            raise self._not_a_farm_error(answer, error) from None
        if not found:
            self._check_connection()  # an empty list does not show that a farm sent it
        return found

    def _check_connection(self) -> None:
        """Raises ClientError if no farm answers."""
        answer = self._send("GET", "/api/info")
        data = self._data(answer)
        if not isinstance(data, dict) or data.get("name") != "rayfarm":
            raise self._not_a_farm_error(answer)

    def _read(self, cls: type[T], answer: _Answer) -> T:
        data = self._data(answer)
        if not isinstance(data, dict):
            raise self._not_a_farm_error(answer)
        try:
            found = read(cls, data)
        except ValueError as error:
            raise self._not_a_farm_error(answer, error) from None
        object.__setattr__(found, "_farm", self)  # for display in a notebook
        return found

    def _data(self, answer: _Answer) -> Any:
        try:
            return json.loads(answer.body)
        except (ValueError, RecursionError):
            raise self._not_a_farm_error(answer) from None

    def _not_a_farm_error(self, answer: _Answer, why: ValueError | None = None) -> NotAFarm:
        came = str(why) if why else describe_answer(answer.body, answer.headers.get("Content-Type", ""))
        return NotAFarm(not_a_farm(self.url, came))

    def _send(self, method: str, path: str, limit: int = MAX_ANSWER, **kwargs: Any) -> _Answer:
        """Sends a request; returns a successful response of at most `limit` bytes, since the server is not trusted."""
        if not is_address(self.url):
            raise ClientError(f"{self.url} is not the address of a farm; give one such as http://host:8000")
        try:
            with self._http.stream(method, path, **kwargs) as response:
                body = self._body(response, limit)
        except httpx.ConnectError as error:
            raise ClientError(
                f"No farm answers at {self.url}. Start one with `rayfarm up`, or give the address of one that runs, such as "
                "http://host:8000.",
                code=NO_FARM,
                params={"url": self.url},
            ) from error
        except (httpx.HTTPError, httpx.StreamError, httpx.InvalidURL, UnicodeError) as error:
            raise ClientError(f"{self.url} does not answer ({error or type(error).__name__}). Try again.") from error
        except OSError as error:
            raise ClientError(f"A file of the scene cannot be read any more ({error.strerror or error}).") from error
        except ValueError as error:  # NaN or infinity, which JSON cannot express
            raise ClientError(f"This cannot be sent to a farm ({error}).") from error
        if response.is_success:
            return _Answer(response.headers, body)
        if response.is_redirect:
            where = response.headers.get("Location", "another address")
            raise NotAFarm(not_a_farm(self.url, f"it sends on to {where!r}"), response.status_code)
        raise self._refusal(response, body)

    def _body(self, response: httpx.Response, limit: int) -> bytes:
        deadline = time.monotonic() + ANSWER_S
        body = bytearray()
        for chunk in response.iter_bytes():
            body += chunk
            if len(body) > limit:
                raise NotAFarm(not_a_farm(self.url, "its answer exceeds the size limit"))
            if limit == MAX_ANSWER and time.monotonic() > deadline:
                raise ClientError(f"{self.url} takes longer than {ANSWER_S:.0f} s for a short answer. Try again.")
        return bytes(body)

    def _refusal(self, response: httpx.Response, body: bytes) -> ClientError:
        """Returns the error for a rejected request: the service's message (application/problem+json), or a description of the
        status.
        """
        status = response.status_code
        said = f"{self.url} answers {status} {response.reason_phrase}".rstrip()
        if response.headers.get("Content-Type", "").startswith(PROBLEM):
            with contextlib.suppress(ValueError, KeyError, TypeError, RecursionError):
                problem = json.loads(body)
                return ClientError(
                    str(problem["detail"]), status, str(problem.get("code", "")), dict(problem.get("params") or {})
                )
        if status in (401, 403, 407):
            return ClientError(f"{said}: it asks for a login, or refuses access. Ask its administrator.", status)
        if status >= 500 or status in (408, 429):
            return ClientError(f"{said}. The farm, or a proxy before it, has a fault; try again in a moment.", status)
        return NotAFarm(not_a_farm(self.url, f"it answers {status} to {response.request.url.path}"), status)


def _id(text: str) -> str:
    """Quotes an id as one path segment. An empty id becomes "-"; otherwise the path would be that of the list."""
    return quote(text, safe="") or "-"


def _project_query(project: str) -> dict[str, str]:
    return {"project": project} if project else {}
