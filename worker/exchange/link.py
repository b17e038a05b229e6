"""A worker's HTTP client for the service: joins the farm, downloads manifests and blobs, uploads blobs. Uses the farm's token."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import urlencode, urlsplit

import httpx
from redis.connection import ConnectionPool

from protocol.channel import CHANNEL_PATH
from protocol.contract import SAMPLES_HEADER, VERSION_HEADER, BlobRef, Manifest
from renderer.sentences import Sentence
from worker.exchange.errors import (
    DamagedError,
    LinkError,
    NotAFarmError,
    RefusedError,
    TokenError,
    answered_status,
    not_reachable,
    token_unknown,
)
from worker.exchange.foreign_server import MAX_ANSWER, describe_answer, is_address, is_loopback, not_a_farm
from worker.exchange.trust import verify_option, verify_option_for

__all__ = ["FarmAnswer", "Link", "check_redis_url"]

CHUNK = 1 << 20
LOOPBACK = ("127.0.0.1", "localhost", "::1")
TIMEOUT = httpx.Timeout(60.0, connect=10.0)
ANSWER_S = 60.0  # timeout of a whole JSON answer
PROBLEM = "application/problem+json"  # distinguishes the service's errors from those of a proxy
RETRYABLE_STATUS = (408, 425, 429)


@dataclass(frozen=True)
class FarmAnswer:
    """The service's response to a worker that joins.

    redis_url: address of the farm's Redis. instance: the service's id. data_dir: the service's data folder, a path on the
    service's machine. reduces: whether the service accepts results that a site's reducer has added up (protocol/site.py).
    has_channel: whether the service replaces Redis for workers that cannot reach it (protocol/channel.py). name_suffix: what the
    names of such workers end with.
    """

    redis_url: str
    instance: str
    data_dir: str
    reduces: bool = False
    has_channel: bool = False
    name_suffix: str = ""


class Link:
    """An HTTP client for the service. Each process creates its own, since connections do not survive a fork.

    Every method raises TemporaryError (worker.exchange.errors) if the service is unreachable, failing or not a farm, and
    RefusedError if it rejects the request.
    """

    def __init__(self, service: str, token: str) -> None:
        """Stores address and token. Raises RefusedError if one of them is invalid."""
        self.service = service.rstrip("/")
        self.token = token
        self._client: httpx.Client | None = None
        if not token.strip():
            raise RefusedError(
                Sentence(
                    "worker-token-missing",
                    "RAYFARM_TOKEN is empty, but a worker needs the farm's token. Set it to the one that `rayfarm up` shows.",
                )
            )
        if not (token.isascii() and token.isprintable()):
            raise RefusedError(
                Sentence("worker-token-malformed", "The token has invalid characters. Use the one that `rayfarm up` shows.")
            )
        if not is_address(self.service):
            raise RefusedError(
                Sentence(
                    "service-address-invalid",
                    "{service} is not an address of a service; give one such as http://host:8000",
                    service=repr(service),
                )
            )

    def __getstate__(self) -> dict[str, Any]:
        return {"service": self.service, "token": self.token, "_client": None}

    @property
    def client(self) -> httpx.Client:
        """The connection pool, opened on first use."""
        if self._client is None:
            headers = {"Authorization": f"Bearer {self.token}"}
            try:
                verify = verify_option_for(verify_option(), self.service)
            except (OSError, ValueError) as error:
                raise RefusedError(
                    Sentence("farm-certificate-unreadable", "The farm's certificate cannot be read: {error}.", error=error)
                ) from None
            self._client = httpx.Client(
                base_url=self.service, headers=headers, timeout=TIMEOUT, verify=verify, trust_env=not is_loopback(self.service)
            )
        return self._client

    def forget_connections(self) -> None:
        """Drops the connections after a fork without closing the parent's sockets; the next request opens new ones."""
        self._client = None

    def join(self, over_https: bool = False) -> FarmAnswer:
        """Joins the farm; returns its address of Redis and other data. over_https: without an address of Redis.

        Raises RefusedError if a worker that joins over HTTPS is not possible there.
        """
        data = self._fetch_object("/api/farm/join?transport=https" if over_https else "/api/farm/join", "redis_url", "instance")
        has_channel = data.get("channel") == CHANNEL_PATH
        if over_https:
            if not has_channel:
                raise RefusedError(
                    Sentence(
                        "join-https-not-offered",
                        "{service} takes no workers over HTTPS: it is of an older release, or RAYFARM_HTTPS_WORKERS is "
                        "false there.",
                        service=self.service,
                    )
                )
            return FarmAnswer("", str(data["instance"]), "", bool(data.get("reduces")), True, str(data.get("name_suffix") or ""))
        given_url = data["redis_url"]
        try:
            if not isinstance(given_url, str):
                raise ValueError(Sentence("join-redis-url-type", "the address of Redis is not text"))
            redis_url = _reachable_redis_url(given_url, self.service)
            check_redis_url(redis_url)
        except ValueError as error:
            raise NotAFarmError(
                Sentence(
                    "join-redis-url-invalid",
                    "{service} answers with an invalid redis_url ({error}). Give the address that `rayfarm up` shows; if "
                    "it is this one, correct RAYFARM_REDIS_URL or RAYFARM_PUBLIC_REDIS_URL of the service.",
                    service=self.service,
                    error=error,
                )
            ) from None
        return FarmAnswer(
            redis_url,
            str(data["instance"]),
            str(data.get("data_dir") or ""),
            bool(data.get("reduces")),
            has_channel,
            str(data.get("name_suffix") or ""),
        )

    def manifest(self, scene: str) -> Manifest:
        """Downloads the manifest of an uploaded scene."""
        data = self._fetch_object(f"/api/farm/scenes/{scene}/manifest", "scene", "main", "files")
        try:
            return Manifest.from_json(data)
        except ValueError as error:
            raise NotAFarmError(
                Sentence(
                    "service-manifest-unreadable",
                    "{service} sent a manifest that cannot be read ({error})",
                    service=self.service,
                    error=error,
                )
            ) from None

    def fetch(self, sha256: str, out: BinaryIO) -> None:
        """Downloads a blob to `out`. Raises DamagedError if the received bytes have another hash."""
        digest = hashlib.sha256()
        with self._stream("GET", f"/api/farm/blobs/{sha256}") as response:
            for chunk in response.iter_bytes(CHUNK):
                digest.update(chunk)
                out.write(chunk)
        if digest.hexdigest() != sha256:
            raise DamagedError(
                Sentence(
                    "blob-download-damaged",
                    "blob {sha256} arrived damaged from {service}; it is fetched again",
                    sha256=sha256[:12],
                    service=self.service,
                )
            )

    def fetch_means(self, job: str, frame: int, out: BinaryIO, ids: bool = False, lights: Sequence[str] = ()) -> tuple[str, int]:
        """Downloads a frame's mean colour, albedo and normal to `out`. Returns the film's version and number of samples.

        ids: whether the object and material planes follow. lights: light groups whose light comes in place of the colour.
        protocol.contract.DenoiseFrame describes the format.
        """
        query = urlencode({**({"ids": "true"} if ids else {}), **({"lights": ",".join(lights)} if lights else {})})
        with self._stream("GET", f"/api/farm/films/{job}/{frame}{'?' if query else ''}{query}") as response:
            try:
                about = response.headers[VERSION_HEADER], int(response.headers[SAMPLES_HEADER])
            except (KeyError, ValueError) as error:
                raise NotAFarmError(
                    Sentence("service-length-missing", "{service} does not state the length of its answer", service=self.service)
                ) from error
            for chunk in response.iter_bytes(CHUNK):
                out.write(chunk)
        return about

    def fetch_view_means(self, message: str, out: BinaryIO) -> None:
        """Downloads the picture of a live view to `out`; format: protocol.view_parts.ViewDenoise. message: the message's id."""
        with self._stream("GET", f"/api/farm/views/{message}") as response:
            for chunk in response.iter_bytes(CHUNK):
                out.write(chunk)

    def store(self, path: Path) -> BlobRef:
        """Uploads a file as a blob, and returns its reference."""
        with path.open("rb") as file:
            sha256 = hashlib.file_digest(file, "sha256").hexdigest()
            size = file.tell()
            file.seek(0)
            content = iter(lambda: file.read(CHUNK), b"")
            with self._stream(
                "PUT", f"/api/farm/blobs/{sha256}", content=content, headers={"Content-Length": str(size)}
            ) as response:
                self._body(response)
        return BlobRef(path="", sha256=sha256, size=size)

    def has_blob(self, sha256: str) -> bool:
        """Returns True if the service has a blob. Also renews the time for which the service keeps it without a reference."""
        try:
            with self._stream("POST", f"/api/farm/blobs/{sha256}/keep"):
                return True
        except RefusedError:
            return False

    def kernels(self, name: str, out: BinaryIO) -> bool:
        """Downloads the kernels of this name (renderer.kernel_file) to `out`. Returns False if the farm has none."""
        try:
            with self._stream("GET", f"/api/farm/kernels/{name}") as response:
                for chunk in response.iter_bytes(CHUNK):
                    out.write(chunk)
        except RefusedError:
            return False
        return True

    def has_kernels(self, name: str) -> bool:
        """Returns True if the farm has the kernels of this name."""
        try:
            with self._stream("HEAD", f"/api/farm/kernels/{name}"):
                return True
        except RefusedError:
            return False

    def store_kernels(self, name: str, file: BinaryIO) -> None:
        """Uploads the kernels of this name. Raises RefusedError if the farm does not accept them."""
        size = file.seek(0, os.SEEK_END)
        file.seek(0)
        content = iter(lambda: file.read(CHUNK), b"")
        headers = {"Content-Length": str(size)}
        with self._stream("PUT", f"/api/farm/kernels/{name}", content=content, headers=headers) as response:
            self._body(response)

    def _fetch_object(self, path: str, *needed: str) -> dict[str, Any]:
        """Downloads the JSON object at `path`. Raises NotAFarmError if it is not an object with all keys in `needed`."""
        with self._stream("GET", path) as response:
            body = self._body(response)
        try:
            data = json.loads(body)
        except (ValueError, RecursionError):
            data = None
        if not isinstance(data, dict) or any(name not in data for name in needed):
            raise NotAFarmError(not_a_farm(self.service, describe_answer(body, response.headers.get("Content-Type", ""))))
        return data

    def _body(self, response: httpx.Response) -> bytes:
        """Reads the whole body, with limits on its size and duration, since the server is not trusted."""
        deadline = time.monotonic() + ANSWER_S
        body = bytearray()
        for chunk in response.iter_bytes():
            body += chunk
            if len(body) > MAX_ANSWER:
                raise NotAFarmError(not_a_farm(self.service, Sentence("answer-endless", "its answer is too long")))
            if time.monotonic() > deadline:
                raise LinkError(
                    Sentence(
                        "service-answer-timeout",
                        "{service} takes longer than {seconds} s to answer",
                        service=self.service,
                        seconds=f"{ANSWER_S:.0f}",
                    )
                )
        return bytes(body)

    @contextmanager
    def _stream(self, method: str, path: str, **kwargs: Any) -> Iterator[httpx.Response]:
        """Context manager that sends a request and yields the response before its body is read. Raises for an error status."""
        try:
            with self.client.stream(method, path, **kwargs) as response:
                self._check_status(response)
                yield response
        except (httpx.HTTPError, httpx.StreamError, httpx.InvalidURL, UnicodeError) as error:
            raise LinkError(not_reachable(self.service, error)) from error

    def _check_status(self, response: httpx.Response) -> None:
        if response.is_success:
            return
        status, request = response.status_code, response.request
        is_service = response.headers.get("Content-Type", "").startswith(PROBLEM)
        if status == 403 and is_service and request.url.path.startswith("/api/farm/kernels/"):
            raise RefusedError(
                self._detail(response)
                or Sentence("kernels-refused", "{service} accepts no kernels from this worker", service=self.service)
            )
        if status in (401, 403):
            raise TokenError(
                token_unknown(self.service)
                if is_service
                else Sentence(
                    "worker-token-refused",
                    "{service} does not know this token. Take the token that `rayfarm up` shows, or ask the "
                    "administrator of this farm. "
                    "If a login is in front of the farm, it must let /api/farm/ through.",
                    service=self.service,
                )
            )
        detail = self._detail(response) if is_service else ""
        asked = f"{request.method} {request.url.path}"
        said = (
            Sentence(
                "service-answered-detail",
                "{service} answers {status} to {request}: {detail}",
                service=self.service,
                status=status,
                request=asked,
                detail=detail,
            )
            if detail
            else answered_status(self.service, status, asked)
        )
        if response.is_redirect:
            raise NotAFarmError(
                Sentence(
                    "service-redirects-worker",
                    "{service} redirects workers to {address}. Give the address that `rayfarm up` shows; a "
                    "login in front of the farm must let /api/farm/ through.",
                    service=self.service,
                    address=repr(response.headers.get("Location", "another address")),
                )
            )
        if status >= 500 or status in RETRYABLE_STATUS:
            raise LinkError(said)
        if request.url.path == "/api/farm/join" or status < 400:
            raise NotAFarmError(
                not_a_farm(
                    self.service, Sentence("answer-status", "it answers {status} to {request}", status=status, request=asked)
                )
            )
        raise RefusedError(said)

    def _detail(self, response: httpx.Response) -> str:
        try:
            return str(json.loads(self._body(response))["detail"])
        except (ValueError, KeyError, TypeError):
            return ""


def check_redis_url(url: str) -> None:
    """Raises ValueError if `url` is not a valid Redis address. The message omits the password."""
    try:
        ConnectionPool.from_url(url).make_connection()
    except (ValueError, TypeError):  # TypeError: an invalid query parameter
        raise ValueError(
            Sentence("redis-address-invalid", "an address of Redis has the form redis://host:6379/0, rediss://... or unix://...")
        ) from None


def _reachable_redis_url(redis_url: str, service: str) -> str:
    """Returns Redis's address as reached from this machine.

    A loopback host in it means the service's machine, and is replaced by the host of the address `service`.
    """
    url, host = urlsplit(redis_url), urlsplit(service).hostname
    if url.hostname not in LOOPBACK or host is None or host in LOOPBACK:
        return redis_url
    user, at, _ = url.netloc.rpartition("@")
    port = "" if url.port is None else f":{url.port}"
    return url._replace(netloc=f"{user}{at}{f'[{host}]' if ':' in host else host}{port}").geturl()
