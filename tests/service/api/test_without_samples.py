"""Tests of pictures of frames without samples: 409 with an error message, never an empty file."""

from __future__ import annotations

from service.store.models import Frame, Job
from tests.grids import grid
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker

FILES = (
    *(f"frames/0/image.{extension}" for extension in ("png", "jpg", "exr", "hdr", "rgb9e5")),
    *("frames/0/image.png?width=64", "frames/0/image.exr?aov=all", "frames/0/pixel?x=1&y=1", "frames/0/digest"),
    *("frames.zip?which=all", "movie.mp4"),
)


@grid("state", ["waits", "gone", "gone and noted", "cancelled"], ordinary=("gone",))
def test_picture_without_samples_is_409(service: Service, worker: PeerWorker, state: str) -> None:
    scene = service.ready_scene()
    if state in ("waits", "cancelled"):
        worker.on_batch = lambda batch: False  # the batch is never answered
        job = service.submit(scene)
        until(lambda: service.job(job)["state"] == "running", "it begins")
        if state == "cancelled":
            service.patch(job, state="cancelled")
    else:
        job = service.submit(scene)
        service.wait_for(job, "finished")
        service.farm.scrubber.check_first = lambda job: None  # type: ignore[method-assign]  # else it is rendered again at once
        service.farm.films.quarantine(job)
        if state == "gone and noted":
            with service.farm.sessions.begin() as session:
                frame, row = session.get(Frame, (job, 0)), session.get(Job, job)
                assert frame is not None
                assert row is not None
                frame.samples = 0
    film = service.http.get(f"/api/jobs/{job}/frames/0/film")
    assert film.status_code == (200 if state == "waits" else 409), "the page begins with it, and shows why there is none"
    for file in FILES:
        answer = service.http.get(f"/api/jobs/{job}/{file}")
        assert answer.status_code == 409, (file, answer.text[:200])
        assert answer.headers["content-type"].startswith("application/problem+json")
        said = answer.json()["detail"]
        if file.startswith("frames/"):
            assert ("The film of this job is" in said and "Set the job to running" in said) == state.startswith("gone")
        if file not in ("frames.zip?which=all", "movie.mp4"):
            assert {"waits": "no samples yet", "cancelled": "ended without"}.get(state, "") in said
        assert said.endswith(".")
        assert service.http.head(f"/api/jobs/{job}/{file}").status_code == 409 or "pixel" in file or "digest" in file
