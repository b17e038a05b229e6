"""Tests of finding jobs by the beginning of their ids."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import pytest

from rayfarm.client import Client, ClientError
from rayfarm.errors import CommandError
from rayfarm.job_lookup import find_job


@dataclass
class Listed:
    id: str


class FarmWith:
    """A substitute farm with jobs of the given ids: finds a job by its full id, or searches for jobs whose id contains a text."""

    def __init__(self, *ids: str) -> None:
        self.ids = ids

    def job(self, id: str) -> Listed:
        if id not in self.ids:
            raise ClientError(f"There is no job {id!r}.", 404)
        return Listed(id)

    def jobs(self, search: str) -> list[Listed]:
        return [Listed(id) for id in self.ids if search in id]


def find(text: str, *ids: str) -> str:
    return find_job(cast(Client, cast(Any, FarmWith(*ids))), text).id


def test_id_or_prefix_finds_job() -> None:
    assert find("7f3a21c0", "7f3a21c0", "7f3a21c0aa") == "7f3a21c0"
    assert find("7f3", "7f3a21c0", "9b7f3a21") == "7f3a21c0"


def test_ambiguous_prefix_lists_candidates() -> None:
    with pytest.raises(CommandError, match="2 jobs have ids that begin with '7f': 7f3a21c0, 7f99"):
        find("7f", "7f3a21c0", "7f99")


def test_unknown_prefix_gives_error_of_farm() -> None:
    with pytest.raises(ClientError, match="no job 'ab'"):
        find("ab", "7f3a21c0")
