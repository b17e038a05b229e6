"""Login through an OpenID provider: the authorization code flow with PKCE, state and nonce (OpenID Connect Core 1.0, RFC 7636).

The service stores no state of unfinished logins. State, nonce, PKCE verifier and redirect address are in a browser cookie,
encrypted and authenticated with a key from the data folder (JWE, RFC 7516). So anonymous requests cannot displace a login, and a
login survives a restart of the service.

A user is identified by issuer and subject only: another subject never gets an existing user's name, whatever the provider sends.
"""

from __future__ import annotations

import json
import re
import secrets
import ssl
import time
import warnings
from dataclasses import asdict, dataclass
from functools import cache
from importlib import import_module
from typing import Any, Literal
from urllib.parse import urlencode, urlsplit

from sqlalchemy import select

from service.access.roles import Role
from service.access.secrets import is_same
from service.access.users import NAME, RESERVED_NAMES
from service.errors import StartupError
from service.settings import Settings
from service.store.database import Sessions
from service.store.models import User

__all__ = ["LOGIN_TIMEOUT_S", "LoginRedirect", "Oidc", "OidcLogin", "RefusalReason", "Refused", "oidc_of"]

RefusalReason = Literal["cancelled", "late", "provider", "role", "name"]

LOGIN_TIMEOUT_S = 600  # seconds that a login at the provider may take
ENCRYPTION = {"alg": "dir", "enc": "A256GCM"}
METADATA_TTL_S = 3600.0  # seconds for which the provider's metadata and keys are cached
LEEWAY_S = 60
TIMEOUT_S = 10.0
SIGNATURE_ALGORITHMS = (
    "RS256",
    "RS384",
    "RS512",
    "PS256",
    "PS384",
    "PS512",
    "ES256",
    "ES384",
    "ES512",
    "EdDSA",
)  # asymmetric only
REQUIRED_METADATA = ("issuer", "authorization_endpoint", "token_endpoint", "jwks_uri")


class Refused(Exception):  # noqa: N818 - named as what it says
    """Raised if a login is rejected.

    why: the reason shown on the page; the exception's message is the detail for the service's log.
    """

    def __init__(self, why: RefusalReason, detail: str) -> None:
        super().__init__(detail)
        self.why = why


@dataclass(frozen=True)
class LoginRedirect:
    """The redirect to the provider that starts a login.

    sealed: the encrypted cookie to set, which the browser returns with the result.
    """

    url: str
    state: str
    sealed: str


@dataclass(frozen=True)
class OidcLogin:
    """Result of a successful login through the provider: the user, and the ID token, which is needed to log out there."""

    user: User
    token: str


@dataclass(frozen=True)
class _Pending:
    """State of an unfinished login, as stored in the encrypted cookie."""

    state: str
    nonce: str
    verifier: str
    redirect: str
    expires: int  # Unix time


@cache
def _ssl_context() -> ssl.SSLContext:
    import httpx  # imported only if needed: the import takes a tenth of a second of a starting service

    return httpx.create_ssl_context()  # created once: loading the certificates is slow


def oidc_of(settings: Settings, sessions: Sessions) -> Oidc | None:
    """Returns the OpenID provider from the settings, or None if none is configured.

    Raises StartupError if its settings are invalid.
    """
    if not settings.oidc_discovery:
        return None
    if not settings.oidc_client:
        raise StartupError("RAYFARM_OIDC_DISCOVERY names a provider, but RAYFARM_OIDC_CLIENT no client. Set both.")
    if (unknown := [role for role in settings.oidc_roles.values() if Role.from_name(role) is Role.NOBODY]) != []:
        raise StartupError(f"RAYFARM_OIDC_ROLES gives the role {unknown[0]!r}; there are view, submit and admin.")
    url = urlsplit(settings.oidc_discovery)
    if url.scheme != "https" and url.hostname not in ("127.0.0.1", "localhost", "::1"):
        raise StartupError("RAYFARM_OIDC_DISCOVERY must begin with https://, since answers over plain HTTP can be forged.")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the library warns of future renamings
            import_module("authlib.integrations.httpx_client")
            import_module("joserfc.jwt")
    except ImportError:
        raise StartupError("RAYFARM_OIDC_DISCOVERY needs Authlib. Install it: pip install 'rayfarm[oidc]'.") from None
    return Oidc(settings, settings.oidc_secret, settings.login_key(), sessions)


class Oidc:
    """Client of one OpenID provider.

    Fetches its metadata and keys at the first login, and caches them for METADATA_TTL_S seconds.
    """

    def __init__(self, settings: Settings, secret: str, login_key: bytes, sessions: Sessions) -> None:
        from joserfc.jwk import OctKey

        self.name = settings.oidc_name or urlsplit(settings.oidc_discovery).hostname or "OpenID"
        self._discovery = settings.oidc_discovery
        self._client = settings.oidc_client, secret
        self._scopes = settings.oidc_scopes
        self._name_claim = settings.oidc_name_claim
        self._role_claim = settings.oidc_role_claim
        self._roles = settings.oidc_roles
        self._usual = Role.from_name(settings.oidc_role)
        self._logs_out = settings.oidc_logout
        self._sessions = sessions
        self._key = OctKey.import_key(login_key)
        self._known: tuple[float, dict[str, Any], Any] | None = None

    def begin(self, redirect: str) -> LoginRedirect:
        """Starts a login. redirect: the URL to which the provider sends the browser afterwards. Raises Refused."""
        about, _ = self._provider()
        state, nonce, verifier = (secrets.token_urlsafe(32) for _ in range(3))
        with self._oauth_client(redirect) as client:
            url, _ = client.create_authorization_url(
                about["authorization_endpoint"], state=state, nonce=nonce, code_verifier=verifier
            )
        return LoginRedirect(
            url, state, self._encrypted(_Pending(state, nonce, verifier, redirect, int(time.time()) + LOGIN_TIMEOUT_S))
        )

    def finish(self, state: str, code: str, error: str, sealed: str) -> OidcLogin:
        """Completes a login with the query parameters of the provider's redirect. Raises Refused.

        The provider accepts each code once, so a redirect cannot be replayed. sealed: the cookie set by `begin`; empty if the
        browser sent none.
        """
        pending = self._decrypted(sealed)
        if pending is None or not is_same(state, pending.state):
            raise Refused("late", "the answer does not belong to a login started by this browser")
        if pending.expires < time.time():
            raise Refused("late", f"the login was started more than {LOGIN_TIMEOUT_S // 60} minutes ago")
        if error or not code:
            raise Refused("cancelled", f"the provider says {error[:200] or 'nothing'}")
        claims, token = self._claims(code, pending)
        return OidcLogin(self._user(claims), token)

    def _encrypted(self, pending: _Pending) -> str:
        from joserfc import jwe

        return jwe.encrypt_compact(ENCRYPTION, json.dumps(asdict(pending), separators=(",", ":")), self._key)

    def _decrypted(self, sealed: str) -> _Pending | None:
        """Returns the state of a login from its encrypted cookie; None if the cookie was not encrypted with this farm's key."""
        from joserfc import jwe
        from joserfc.errors import JoseError

        try:
            decrypted = jwe.decrypt_compact(sealed, self._key, algorithms=list(ENCRYPTION.values()))
            return _Pending(**json.loads(decrypted.plaintext or b""))
        except (JoseError, ValueError, TypeError, RecursionError):
            return None

    def logout_url(self, token: str, back: str) -> str | None:
        """Returns the URL that ends the browser's session at the provider (RP-Initiated Logout 1.0), or None if not possible.

        token: the ID token of the login; empty if unknown. back: the URL to which the provider sends the browser afterwards.
        """
        if not self._logs_out:
            return None
        try:
            about, _ = self._provider()
        except Refused:
            return None
        end = about.get("end_session_endpoint")
        if not isinstance(end, str) or urlsplit(end).scheme not in ("https", urlsplit(self._discovery).scheme):
            return None
        asked = {"client_id": self._client[0], "post_logout_redirect_uri": back, "state": secrets.token_urlsafe(16)}
        asked |= {"id_token_hint": token} if token else {}
        return f"{end}{'&' if '?' in end else '?'}{urlencode(asked)}"

    def _claims(self, code: str, pending: _Pending) -> tuple[dict[str, Any], str]:
        import httpx
        from authlib.common.errors import AuthlibBaseError
        from authlib.oidc.core import CodeIDToken
        from joserfc.errors import JoseError

        about, _ = self._provider()
        try:
            with self._oauth_client(pending.redirect) as client:
                token = client.fetch_token(about["token_endpoint"], code=code, code_verifier=pending.verifier)
            shown = str(token.get("id_token") or "")
            read = self._decoded_token(shown)
            options = {
                "iss": {"essential": True, "values": [about["issuer"]]},
                "aud": {"essential": True, "value": self._client[0]},
            }
            params = {"nonce": pending.nonce, "client_id": self._client[0], "access_token": token.get("access_token")}
            claims = CodeIDToken(read.claims, read.header, options, params)
            claims.validate(leeway=LEEWAY_S)
            found = dict(claims)
            if about.get("userinfo_endpoint") and not {self._name_claim, self._role_claim} <= found.keys():
                found |= self._userinfo_claims(about["userinfo_endpoint"], str(token.get("access_token") or ""), found["sub"])
        except (AuthlibBaseError, JoseError, httpx.HTTPError, ValueError, KeyError, TypeError) as error:
            raise Refused("provider", f"the provider's answer is invalid ({type(error).__name__}: {error})") from None
        return found, shown

    def _userinfo_claims(self, url: str, token: str, subject: str) -> dict[str, Any]:
        """Returns the name and role claims from the provider's userinfo endpoint. Raises httpx.HTTPError and ValueError."""
        import httpx

        answer = httpx.get(url, headers={"Authorization": f"Bearer {token}"}, timeout=TIMEOUT_S, verify=_ssl_context())
        answer.raise_for_status()
        claims = answer.json()
        if not isinstance(claims, dict) or claims.get("sub") != subject:
            raise ValueError("it belongs to another subject")
        return {name: claims[name] for name in (self._name_claim, self._role_claim) if name in claims}

    def _decoded_token(self, token: str) -> Any:
        from joserfc import jwt
        from joserfc.errors import InvalidKeyIdError

        about, keys = self._provider()
        signed_by = [
            name for name in about.get("id_token_signing_alg_values_supported") or ["RS256"] if name in SIGNATURE_ALGORITHMS
        ]
        try:
            return jwt.decode(token, keys, algorithms=signed_by)
        except (InvalidKeyIdError, ValueError):  # the provider may have new keys
            return jwt.decode(token, self._provider(anew=True)[1], algorithms=signed_by)

    def _provider(self, anew: bool = False) -> tuple[dict[str, Any], Any]:
        """Returns the provider's metadata and keys. anew: fetch them even if they are cached. Raises Refused."""
        import httpx
        from joserfc.jwk import KeySet

        known = self._known
        if known is not None and not anew and time.monotonic() - known[0] < METADATA_TTL_S:
            return known[1], known[2]
        try:
            about = (
                httpx.get(self._discovery, timeout=TIMEOUT_S, verify=_ssl_context(), follow_redirects=True)
                .raise_for_status()
                .json()
            )
            if not isinstance(about, dict) or any(not isinstance(about.get(name), str) for name in REQUIRED_METADATA):
                raise ValueError("it is not an OpenID provider's discovery document")
            keys = KeySet.import_key_set(
                httpx.get(about["jwks_uri"], timeout=TIMEOUT_S, verify=_ssl_context()).raise_for_status().json()
            )
        except (httpx.HTTPError, httpx.InvalidURL, ValueError, KeyError, TypeError) as error:
            raise Refused("provider", f"{self._discovery} lacks required fields ({error})") from None
        self._known = time.monotonic(), about, keys
        return about, keys

    def _oauth_client(self, redirect: str) -> Any:
        from authlib.integrations.httpx_client import OAuth2Client

        id, secret = self._client
        return OAuth2Client(
            *(id, secret or None),
            scope=self._scopes,
            redirect_uri=redirect,
            code_challenge_method="S256",
            token_endpoint_auth_method="client_secret_basic" if secret else "none",
            timeout=TIMEOUT_S,
            verify=_ssl_context(),
        )

    def _user(self, claims: dict[str, Any]) -> User:
        """Returns the user identified by these claims, with the role from the claims; creates the user if new. Raises Refused."""
        role = self._role(claims)
        subject = f"{claims['iss']} {claims['sub']}"
        if role is Role.NOBODY:
            raise Refused("role", f"{subject} has no role: {self._role_claim} is {str(claims.get(self._role_claim))[:200]}")
        name = re.sub(r"[^a-z0-9._@-]", "-", str(claims.get(self._name_claim) or claims["sub"]).lower())[:63]
        with self._sessions.begin() as session:
            user = session.scalar(select(User).where(User.subject == subject))
            if user is None:
                if not NAME.fullmatch(name) or name in RESERVED_NAMES or session.get(User, name) is not None:
                    raise Refused("name", f"{subject} is called {name!r}, which cannot be a name here or is another's")
                user = User(name=name, role=role.api_name, password=None, created=time.time(), subject=subject)
                session.add(user)
            user.role = role.api_name
        return user

    def _role(self, claims: dict[str, Any]) -> Role:
        """Returns the highest role that the role claim maps to; the default role if it maps to none."""
        roles = claims.get(self._role_claim)
        values = roles if isinstance(roles, list) else str(roles or "").split()
        return max(
            (Role.from_name(self._roles[value]) for value in values if isinstance(value, str) and value in self._roles),
            default=self._usual,
        )
