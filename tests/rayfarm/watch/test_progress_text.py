"""Tests of the line that `rayfarm watch` prints for a job."""

from __future__ import annotations

from rayfarm.responses import Job
from rayfarm.watch.words import progress_text


def test_time_of_an_ended_job_includes_its_denoised_picture() -> None:
    ended = {"id": "j", "scene": "s", "state": "finished", "progress": 1.0, "samples": 9, "created": 0.0, "active_s": 13.2}
    assert progress_text(Job(**ended, elapsed_s=20.4)).endswith(" · 0:20")
    assert progress_text(Job(**ended)).endswith(" · 0:13"), "a service of an earlier release does not tell"
