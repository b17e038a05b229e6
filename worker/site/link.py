"""A worker's connection to its site's reducer.

If the reducer is unreachable, slow or rejects sums, the worker sends them to the service directly.
"""

from __future__ import annotations

import http.client
import logging
import time
from typing import Any, NamedTuple

import redis

from protocol.contract import Result
from protocol.joint import Run
from protocol.result_bytes import result_bytes
from protocol.site import (
    ANNOUNCED_HEADER,
    SIGNATURE_HEADER,
    SUMS_PATH,
    SiteReport,
    secret_key,
    signature,
    site_key,
    size_signature,
)

__all__ = ["SiteLink"]

PATIENCE_S = 5.0  # timeout of an answer, for which a slot waits
ADDRESS_TTL_S = 10.0  # validity of the reducer's address
RETRY_AFTER_S = 5.0  # pause after a failed connection

log = logging.getLogger(__name__)


class _ReducerAddress(NamedTuple):
    address: str
    port: int
    secret: bytes


class SiteLink:
    """A process's connection to the reducers of sites, whose addresses it reads from Redis."""

    def __init__(self, redis_url: str) -> None:
        self._redis = redis.Redis.from_url(redis_url, socket_timeout=2, socket_connect_timeout=2)
        self._known: dict[str, tuple[float, _ReducerAddress | None]] = {}  # until when, and where

    def send(self, result: Result) -> bool:
        """Sends a result to the reducer of its site. Returns False if the caller must send it to the service instead."""
        run = Run.of(result.event.get("run"))
        if run is None or result.sums is None:
            return False
        where = self._reducer_of(run.site)
        if where is None:
            return False
        try:
            status = _post(where, result)
            if status == http.HTTPStatus.FORBIDDEN and (where := self._reducer_of(run.site, anew=True)) is not None:
                status = _post(where, result)  # it has another secret by now
        except (OSError, http.client.HTTPException) as error:
            self._suspend_reducer(run.site, error)
            return False
        if status == http.HTTPStatus.NO_CONTENT:
            return True
        if status != http.HTTPStatus.CONFLICT:  # that is about these sums alone
            self._suspend_reducer(run.site, f"it answers {status}")
        return False

    def _suspend_reducer(self, site: str, why: Any) -> None:
        log.warning("sums are sent to the service instead of the reducer of site %s: %s", site, why)
        self._known[site] = time.monotonic() + RETRY_AFTER_S, None

    def _reducer_of(self, site: str, anew: bool = False) -> _ReducerAddress | None:
        until, where = self._known.get(site, (0.0, None))
        if time.monotonic() < until and not anew:
            return where
        where = None
        try:
            report, secret = list[Any](self._redis.mget([site_key(site), secret_key(site)]))
            if report is not None and secret is not None:
                said = SiteReport.from_bytes(report)
                where = _ReducerAddress(said.address, said.port, secret)
        except (redis.RedisError, ValueError) as error:
            log.debug("the reducer of site %s cannot be found: %s", site, error)
        self._known[site] = time.monotonic() + (RETRY_AFTER_S if where is None else ADDRESS_TTL_S), where
        return where


def _post(where: _ReducerAddress, result: Result) -> int:
    body = result_bytes(result)
    connection = http.client.HTTPConnection(where.address, where.port, timeout=PATIENCE_S)
    try:
        signed = {SIGNATURE_HEADER: signature(where.secret, body), ANNOUNCED_HEADER: size_signature(where.secret, len(body))}
        connection.request("POST", SUMS_PATH, body, signed)
        answer = connection.getresponse()
        answer.read()
        return answer.status
    finally:
        connection.close()
