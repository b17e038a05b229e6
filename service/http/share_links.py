"""The share link of a request, as a dependency of routes."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Request

from renderer.sentences import Sentence
from service.access.keys import Share
from service.access.roles import Role
from service.errors import NotAllowed, NotFound
from service.farm import Farm
from service.http.farm import FarmDependency
from service.http.visit import bearer_token

__all__ = ["ShareDependency", "check_comments", "may_comment"]

LINK_INVALID = Sentence("share-link-invalid", "This link has expired or was withdrawn. Ask for a new one.")


def _share_of(request: Request, farm: FarmDependency) -> Share:
    """Returns the share link of a request. Raises NotFound if the link is invalid, or its creator may no longer see the job."""
    share = farm.access.keys.find_share(bearer_token(request.headers))
    if share is None:
        raise NotFound(LINK_INVALID)
    projects = farm.access.projects
    if not projects.visibility(share.creator).is_visible(projects.project_of("job", share.job)):
        raise NotFound(LINK_INVALID)
    return share


ShareDependency = Annotated[Share, Depends(_share_of)]


def may_comment(share: Share, farm: Farm) -> bool:
    """Returns True if a link allows notes, and its creator may still change the job."""
    projects = farm.access.projects
    return (
        share.comments
        and share.creator.role >= Role.SUBMIT
        and projects.visibility(share.creator).changes(projects.project_of("job", share.job))
    )


def check_comments(share: Share, farm: Farm) -> None:
    """Raises NotAllowed unless a link allows notes, and its creator may still change the job."""
    if not may_comment(share, farm):
        raise NotAllowed(
            Sentence("share-link-without-notes", "This link only shows the picture. Ask for a link that allows notes.")
        )
