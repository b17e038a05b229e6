"""Access control: users, keys, projects, quotas and login attempts, combined in the class Access."""

from __future__ import annotations

from service.access.attempts import Attempts
from service.access.audit import Audit
from service.access.keys import Keys
from service.access.oidc import oidc_of
from service.access.projects import Projects
from service.access.rate_limit import RateLimit
from service.access.roles import OWNER, Caller, Role
from service.access.secrets import fingerprint, is_same
from service.access.users import Users
from service.errors import StartupError
from service.settings import Settings
from service.store.database import Sessions

__all__ = ["LINK_S", "SESSION_S", "Access"]

LOCAL_ONLY_TOKEN = "this-machine-only"  # docker-compose.yml's default
SESSION_S = 30 * 86400.0
LINK_S = 86400.0
NOTES_WINDOW_S = 60.0
DENOISING_WINDOW_S = 600.0


class Access:
    """The parts of access control: the keys, users, projects, login attempts, audit log and OpenID provider of this farm.

    Raises StartupError if other machines can reach the service while its token is still the public default.
    """

    def __init__(self, sessions: Sessions, settings: Settings, instance: str) -> None:
        if settings.needs_login and settings.token == LOCAL_ONLY_TOKEN:
            raise StartupError(
                "The farm's token is the one that everybody knows, and other machines reach this service. "
                "Set RAYFARM_TOKEN to one of your own, as of `openssl rand -hex 16`."
            )
        self.needs_login = settings.needs_login
        self.is_open = settings.login == "never"  # no login for any request
        self.is_published = bool(settings.published)  # reached through a container's published port
        self.keys = Keys(sessions)
        self.users = Users(sessions, self.keys)
        self.projects = Projects(sessions)
        self.oidc = oidc_of(settings, sessions)
        self.attempts = Attempts()
        self.note_rate = RateLimit(NOTES_WINDOW_S)
        self.link_denoising_rate = RateLimit(DENOISING_WINDOW_S)
        self.audit = Audit(settings.data)
        self._owner = settings.owner_token
        self._farm = settings.token
        # Cookies are shared between ports: two farms on one machine need different names.
        self.cookie = f"rayfarm-{fingerprint(instance)[:12]}"

    def owner_link(self) -> str:
        """Returns the secret of a new one-time login link for the farm's owner, valid for LINK_S seconds."""
        return self.keys.create("link", OWNER, Role.ADMIN, lasts_s=LINK_S)[0]

    def cached_caller(self, secret: str) -> Caller | None:
        """Returns the caller who owns this secret, from memory only; None if the secret is not cached."""
        if self._farm and is_same(secret, self._farm):
            return Caller("farm", Role.NOBODY, "worker")
        if self._owner and is_same(secret, self._owner):
            return Caller(OWNER, Role.ADMIN, "owner")
        return self.keys.cached_caller(secret)

    def find(self, secret: str) -> Caller | None:
        """Returns the caller who owns this secret, or None if it is invalid. Queries the database. Raises Unavailable."""
        return self.cached_caller(secret) or self.keys.find(secret)
