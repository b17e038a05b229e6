"""The service's errors in the words of the command line: advice to send a request becomes the command that does the same."""

from __future__ import annotations

from typing import TYPE_CHECKING

from renderer.errors import RayfarmError

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["SENTENCES", "sentence"]

# By the error's code. {name}: a value of the error, as the service sends it.
SENTENCES: Mapping[str, str] = {
    "environment-id-unknown": "There is no environment image {id}. It may have been deleted; --env FILE uploads it again.",
    "environment-not-found": "There is no environment {id}.",
    "example-not-found": "There is no example {name}. The page of the farm shows the examples.",
    "job-frame-not-found": "The job has no frame {frame}. `rayfarm jobs JOB --json` has its frames.",
    "job-not-found": "There is no job {id}. `rayfarm jobs` lists the jobs.",
    "project-not-found": "There is no project {name}, or you are not a member of it. `rayfarm project list` lists yours.",
    "reference-not-found": "There is no reference picture {id}.",
    "retention-already-running": "A cleanup is already running. Try again when it has ended.",
    "retention-never-run": "No cleanup was started since the service started. `rayfarm gc` starts one.",
    "scene-id-unknown": "There is no scene {id}. It may have been deleted; `rayfarm submit FILE` uploads it again.",
    "scene-not-found": "There is no scene {id}. `rayfarm submit FILE` uploads one.",
    "snapshot-not-found": "This picture has no snapshot at {spp} samples.",
    "template-environment-file": "--env names a file. `rayfarm submit --env FILE` uploads it.",
    "token-not-found": "There is no token {id}. `rayfarm token list` lists the tokens.",
    "user-not-found": "There is no user {name}. `rayfarm user list` lists the users.",
    "worker-not-found": "There is no worker {name}. `rayfarm workers` lists those that are connected.",
}

# By codes of the client itself (rayfarm.client.NO_FARM).
_OF_CLIENT: Mapping[str, str] = {
    "farm-not-answering": "No farm answers at {url}. Start one with `rayfarm up`, or give its address by --server URL.",
}


def sentence(error: RayfarmError) -> str:
    """Returns an error's message, for a command's standard error."""
    code = getattr(error, "code", "")
    template = SENTENCES.get(code) or _OF_CLIENT.get(code)
    try:
        return template.format(**error.params) if template else str(error)  # type: ignore[attr-defined]
    except (KeyError, IndexError):  # a service of another release
        return str(error)
