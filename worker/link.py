"""A worker's way to the service: join the farm, fetch manifests and blobs, store blobs. Plain HTTP with the farm's token."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import urlsplit

import httpx

from worker.contract import SAMPLES_HEADER, VERSION_HEADER, BlobRef, Manifest

__all__ = ["FarmAnswer", "Link", "LinkError", "RefusedError"]

CHUNK = 1 << 20
LOOPBACK = ("127.0.0.1", "localhost", "::1")
TIMEOUT = httpx.Timeout(60.0, connect=10.0)


class LinkError(Exception):
    """The service cannot be reached, or does not answer as a service does. Worth another try."""


class RefusedError(Exception):
    """The service answered and said no; another try gives the same answer."""


@dataclass(frozen=True)
class FarmAnswer:
    """What a worker is told when it joins. `instance`: the service's id; `data_dir`: its data folder on its own machine."""

    redis_url: str
    instance: str
    data_dir: str


class Link:
    """One HTTP client of the service. Made anew in every process: connections do not survive a fork."""

    def __init__(self, service: str, token: str) -> None:
        self.service = service.rstrip("/")
        self._token = token
        self._client: httpx.Client | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {"service": self.service, "_token": self._token, "_client": None}

    @property
    def client(self) -> httpx.Client:
        """The connection pool, opened on first use."""
        if self._client is None:
            headers = {"Authorization": f"Bearer {self._token}"}
            self._client = httpx.Client(base_url=self.service, headers=headers, timeout=TIMEOUT)
        return self._client

    def forget_connections(self) -> None:
        """After a fork: leave the parent's sockets to the parent and open new ones on the next use."""
        self._client = None

    def join(self) -> FarmAnswer:
        """Ask to join the farm. Raises LinkError while no service answers, RefusedError where the token is not the farm's."""
        data = self._send("GET", "/api/farm/join").json()
        try:
            return FarmAnswer(_reachable(data["redis_url"], self.service), data["instance"], data.get("data_dir") or "")
        except (KeyError, TypeError) as error:
            raise LinkError(f"{self.service} answers, but not as a Rayfarm service does") from error

    def join_patiently(self, say: Callable[[str], None], stop: Callable[[], bool] = lambda: False) -> FarmAnswer | None:
        """Join as soon as the service is there; None where `stop` became true. Says once per reason why it waits."""
        said = ""
        pause = 0.2
        while not stop():
            try:
                return self.join()
            except LinkError as error:
                if str(error) != said:
                    said = str(error)
                    say(f"waiting for the service: {said}")
                time.sleep(pause)
                pause = min(pause * 1.5, 3.0)
        return None

    def manifest(self, scene: str) -> Manifest:
        """The files of an uploaded scene."""
        return Manifest.from_json(self._send("GET", f"/api/farm/scenes/{scene}/manifest").json())

    def fetch(self, sha256: str, out: BinaryIO) -> None:
        """Write a blob to `out`. Raises LinkError where what arrives has another hash."""
        digest = hashlib.sha256()
        try:
            with self.client.stream("GET", f"/api/farm/blobs/{sha256}") as response:
                self._check(response)
                for chunk in response.iter_bytes(CHUNK):
                    digest.update(chunk)
                    out.write(chunk)
        except httpx.HTTPError as error:
            raise LinkError(self._why(error)) from error
        if digest.hexdigest() != sha256:
            raise LinkError(f"blob {sha256[:12]} arrived damaged from {self.service}")

    def means(self, job: str, frame: int, out: BinaryIO) -> tuple[str, int]:
        """Write a frame's means (DenoiseFrame says how) to `out`; returns the film's version and number of samples."""
        try:
            with self.client.stream("GET", f"/api/farm/films/{job}/{frame}") as response:
                self._check(response)
                for chunk in response.iter_bytes(CHUNK):
                    out.write(chunk)
                return response.headers[VERSION_HEADER], int(response.headers[SAMPLES_HEADER])
        except httpx.HTTPError as error:
            raise LinkError(self._why(error)) from error
        except (KeyError, ValueError) as error:
            raise LinkError(f"{self.service} does not say of what its means are") from error

    def store(self, path: Path) -> BlobRef:
        """Store a file as a blob at the service, by its hash."""
        with path.open("rb") as file:
            sha256 = hashlib.file_digest(file, "sha256").hexdigest()
            size = file.tell()
            file.seek(0)
            content = iter(lambda: file.read(CHUNK), b"")
            self._send("PUT", f"/api/farm/blobs/{sha256}", content=content, headers={"Content-Length": str(size)})
        return BlobRef(path="", sha256=sha256, size=size)

    def kernels(self, name: str, out: BinaryIO) -> bool:
        """Write the kernels of this name (renderer.artefact) to `out`; False where the farm has none."""
        try:
            with self.client.stream("GET", f"/api/farm/kernels/{name}") as response:
                if response.status_code == httpx.codes.NOT_FOUND:
                    return False
                self._check(response)
                for chunk in response.iter_bytes(CHUNK):
                    out.write(chunk)
        except httpx.HTTPError as error:
            raise LinkError(self._why(error)) from error
        return True

    def has_kernels(self, name: str) -> bool:
        """Whether the farm has the kernels of this name."""
        try:
            response = self.client.head(f"/api/farm/kernels/{name}")
        except httpx.HTTPError as error:
            raise LinkError(self._why(error)) from error
        if response.status_code == httpx.codes.NOT_FOUND:
            return False
        self._check(response)
        return True

    def store_kernels(self, name: str, file: BinaryIO) -> None:
        """Give the farm the kernels of this name."""
        size = file.seek(0, os.SEEK_END)
        file.seek(0)
        content = iter(lambda: file.read(CHUNK), b"")
        self._send("PUT", f"/api/farm/kernels/{name}", content=content, headers={"Content-Length": str(size)})

    def _send(self, method: str, path: str, **kwargs: Any) -> httpx.Response:
        try:
            response = self.client.request(method, path, **kwargs)
        except httpx.HTTPError as error:
            raise LinkError(self._why(error)) from error
        self._check(response)
        return response

    def _check(self, response: httpx.Response) -> None:
        if response.is_success:
            return
        if response.status_code in (401, 403):
            raise RefusedError(
                f"{self.service} does not know this token. Take the token that `rayfarm up` shows, or ask who runs the farm."
            )
        said = f"{self.service} answers {response.status_code} to {response.request.method} {response.request.url.path}"
        if response.status_code >= 500 or response.status_code == 429:
            raise LinkError(said)
        raise RefusedError(said)

    def _why(self, error: httpx.HTTPError) -> str:
        return f"no answer from {self.service} ({error or type(error).__name__})"


def _reachable(redis_url: str, service: str) -> str:
    """Redis's address as seen from here: what the service calls its own machine is the machine that was reached."""
    url, host = urlsplit(redis_url), urlsplit(service).hostname
    if url.hostname not in LOOPBACK or host is None or host in LOOPBACK:
        return redis_url
    user, at, address = url.netloc.rpartition("@")
    port = address.rpartition(":")[2]
    return url._replace(netloc=f"{user}{at}{f'[{host}]' if ':' in host else host}:{port}").geturl()
