"""Tests of the scheduler of live views without workers."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from service.viewing.first_pictures import FirstPictures
from service.viewing.session import ViewSession
from service.viewing.view_scheduler import AFTER_JOB_S, ViewScheduler


def test_last_picture_of_a_left_view_waits_for_the_job_that_was_started_from_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Denoising that picture would take a slot from the job in its first seconds."""
    scheduler, denoised = ViewScheduler.__new__(ViewScheduler), list[ViewSession]()
    session, board = ViewSession(lambda: None), SimpleNamespace(batches_out=1)
    scheduler._sessions, scheduler._out, scheduler._first_pictures = {session.id: session}, {}, FirstPictures()
    scheduler._board = SimpleNamespace(latest=board)  # type: ignore[assignment]
    monkeypatch.setattr(scheduler, "_send_denoise", denoised.append)
    monkeypatch.setattr(scheduler, "_send_draft", lambda session: None)

    def is_sent(**state: Any) -> bool:
        vars(board).update(state)
        denoised.clear()
        scheduler._send_pieces()
        return denoised == [session]

    assert is_sent(), "a view that is shown precedes jobs"
    session.end_sampling(2.0)
    assert not is_sent()
    assert is_sent(batches_out=0)
    session.left_at -= AFTER_JOB_S
    assert is_sent(batches_out=1), "its poster does not wait for long jobs"
