"""Settings of the service, read from environment variables RAYFARM_*."""

from __future__ import annotations

import contextlib
import hashlib
import ipaddress
import os
import re
import secrets
import socket
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError, field_validator, model_validator
from pydantic.fields import FieldInfo
from pydantic_settings import BaseSettings, PydanticBaseSettingsSource, SettingsConfigDict, SettingsError

from protocol.redis_tls import with_certificate_authority, with_password, without_local_options
from renderer.variables import FILE, VariableError, value_of
from service.errors import StartupError
from service.hooks.signing import new_secret, secret_bytes
from service.locations import default_data_folder, shipped_folder, sqlite_url
from service.store.atomic_files import PRIVATE_FOLDER, write_atomically, write_if_missing

__all__ = ["OWNER_TOKEN", "Settings", "is_address"]

MIB = 1 << 20
GIB = 1 << 30
OWNER_TOKEN = "owner-token"  # file in the data folder; its content grants the owner's rights
WILDCARD_ADDRESSES = ("0.0.0.0", "::", "")
LOOPBACK = ("127.0.0.1", "localhost", "::1")


class Settings(BaseSettings):
    """The service's settings. Sizes are in bytes, durations in seconds."""

    model_config = SettingsConfigDict(env_prefix="RAYFARM_", extra="ignore")

    data: Path = Field(default_factory=default_data_folder)
    redis_url: str = "redis://127.0.0.1:6379/0"
    redis_password: str = ""  # used if the address has no password
    public_redis_url: str = ""  # address for joining workers, if it differs from the service's
    database_url: str = ""  # empty: SQLite in the data folder
    blobs: str = ""  # s3://bucket/prefix for uploads and compiled scenes; empty: the data folder
    token: str = ""  # the workers' token; empty: generated and stored in the data folder
    owner_token: str = ""  # secret with administrator's rights; empty: generated and stored in the data folder
    host: str = "127.0.0.1"
    published: str = ""  # space-separated public addresses and names, if they differ from `host`: a container's
    port: int = 8000
    published_port: int = Field(default=0, ge=0, le=65535)  # a container's public port; 0: equal to `port`
    health_port: int = Field(default=0, ge=0, le=65535)  # port on which a separate thread serves /healthz; 0: none
    login: Literal["auto", "always", "never"] = "auto"  # auto: if other machines can reach the service
    print_link: bool = False  # whether to print the owner's login link to standard output at the start
    oidc_discovery: str = ""  # https://.../.well-known/openid-configuration of a provider; empty: none
    oidc_client: str = ""  # client id at the provider
    oidc_secret: str = ""  # client secret at the provider
    oidc_name: str = ""  # display name of the provider
    oidc_scopes: str = "openid profile email"
    oidc_name_claim: str = "preferred_username"
    oidc_role_claim: str = "groups"
    oidc_roles: dict[str, str] = Field(default_factory=dict)  # role for each value of the claim
    oidc_role: Literal["", "view", "submit", "admin"] = "view"  # role of users without a mapped value; empty: they are refused
    oidc_logout: bool = True  # whether logging out also ends the session at the provider, if that supports it
    trusted_proxies: str = ""  # space-separated addresses and networks whose X-Forwarded-For and -Proto are trusted
    allowed_hosts: list[str] = Field(default_factory=list)  # further host names of this service, besides loopback
    web: Path = shipped_folder("web")
    examples: Path = shipped_folder("scenes")

    webhooks: list[str] = Field(default_factory=list)  # URLs that are notified when a job ends
    webhook_secret: str = ""  # whsec_...: signs messages; empty: generated and stored in the data folder
    job_hook: str = ""  # program that is run when a job ends
    public_url: str = ""  # URL of the page, for links in messages

    max_upload_bytes: int = GIB
    max_upload_files: int = 4096
    max_unzipped_bytes: int = 8 * GIB
    max_unzip_ratio: float = 200.0
    max_blob_bytes: int = 64 * GIB  # of a blob stored by a worker: compiled scenes
    min_free_bytes: int = 256 * MIB  # disk space kept free

    ocio: str = ""  # OpenColorIO config whose views are offered; empty: cg if opencolorio is installed; off: none

    max_pixels: int = 64 * MIB
    film_cache_bytes: int = 256 * MIB
    picture_bytes: int = 384 * MIB  # memory for all pictures in progress

    reuse_films: bool = True  # whether a job starts with the samples of an earlier job of the same picture

    idle_posters: bool = True  # whether an idle farm renders missing posters: service/viewing/idle_posters.py

    quota_bytes: int | None = Field(default=None, ge=0)  # disk space for one user's uploads and films; empty: no limit
    quota_jobs: int | None = Field(default=None, ge=0)  # unfinished jobs of one user
    quota_samples_day: int | None = Field(default=None, ge=0)  # samples of the jobs that one user submits within a day

    keep_films_days: float | None = Field(default=None, ge=0)  # lifetime of unpinned jobs' films; empty: unlimited
    keep_films_bytes: int | None = Field(default=None, ge=0)  # disk space for films; the oldest are deleted; empty: no limit
    keep_compiled_days: float | None = Field(default=None, ge=0)  # lifetime of unused compiled scenes
    keep_uploads_days: float | None = Field(default=None, ge=0)  # lifetime of unused uploads
    film_check_days: float = Field(
        default=7.0, ge=0
    )  # interval of full checks of idle films, whose missing samples are rendered again; 0: never

    https_workers: bool = True  # whether workers may join over HTTPS alone, without access to Redis
    verify: float = Field(default=0.0, ge=0, le=1)  # share of batches that are rendered twice, by different workers
    batch_seconds: float = 0.5
    batch_seconds_most: float = 10.0  # upper limit with many slots, whose results must not outrun merging
    results_bytes: int = 256 * MIB  # Redis memory for waiting results; beyond it no more batches are sent
    window_per_slot: int = 2
    batch_deadline: float = 30.0
    prepare_deadline: float = 900.0
    frame_scenes_bytes: int = 8 * GIB  # disk space for scenes compiled for single frames of shots
    snapshot_bytes: int = 4 * GIB  # disk space for snapshots of films in progress; 0: none are kept
    live_interval: float = 0.12
    peer_url: str = ""  # URL of this service for other services of this farm; empty: from host and port
    lease_s: float = Field(default=6.0, ge=1.0)  # an owner that does not answer for this long is replaced
    live_bytes: int = 128 * MIB  # memory for tiles in transit to viewers

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,
        file_secret_settings: PydanticBaseSettingsSource,
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Returns the sources of settings in order of precedence: arguments, environment, files named by the environment."""
        return init_settings, env_settings, _Files(settings_cls)

    @classmethod
    def read(cls, **given: Any) -> Settings:
        """Reads the settings from the environment. given: values by field name, which take precedence.

        Raises StartupError if a value is invalid.
        """
        try:
            return cls(**given)
        except VariableError as error:
            raise StartupError(str(error)) from error
        except ValidationError as error:
            first = error.errors()[0]
            name, why = str(first["loc"][0]), first["msg"].removeprefix("Value error, ")
        except SettingsError as error:
            name, why = str(error).partition('"')[2].partition('"')[0], 'it is not JSON; a list is written as ["a", "b"]'
        raise StartupError(f"RAYFARM_{name.upper()} is invalid: {why[:1].lower()}{why[1:]}. Change or unset it.")

    @field_validator("data")
    @classmethod
    def _absolute(cls, value: Path) -> Path:
        return value.expanduser().resolve()

    @field_validator("redis_url")
    @classmethod
    def _over_tls(cls, value: str) -> str:
        return with_certificate_authority(value)

    @model_validator(mode="after")
    def _with_redis_password(self) -> Settings:
        if self.redis_password:
            self.redis_url = with_password(self.redis_url, self.redis_password)
            if self.public_redis_url:
                self.public_redis_url = with_password(self.public_redis_url, self.redis_password)
        return self

    @field_validator("blobs")
    @classmethod
    def _bucket(cls, value: str) -> str:
        if value and not re.fullmatch(r"s3://[^/]+(/.*)?", value):
            raise ValueError(f"{value!r} is not a blob address; give s3://bucket/prefix, or nothing, for the data folder")
        return value

    @field_validator("trusted_proxies")
    @classmethod
    def _networks(cls, value: str) -> str:
        for each in value.split():
            try:
                network = ipaddress.ip_network(each)
            except ValueError as error:
                raise ValueError(
                    f"{error}; give the addresses or networks of your proxies, like 127.0.0.1 172.16.0.0/12"
                ) from None
            if network.prefixlen == 0:
                raise ValueError(f"{each} includes every address, so clients could forge theirs; give your proxies' addresses")
        return value

    @field_validator("webhooks")
    @classmethod
    def _addresses(cls, value: list[str]) -> list[str]:
        for url in value:
            if not re.fullmatch(r"https?://[^/?#\s]+[^\s]*", url):
                raise ValueError(f"{url!r} is not a webhook address; it must begin with http:// or https://")
        return value

    @field_validator("webhook_secret")
    @classmethod
    def _secret(cls, value: str) -> str:
        if value:
            secret_bytes(value)
        return value

    @property
    def database(self) -> str:
        """URL of the database for SQLAlchemy."""
        return self.database_url or sqlite_url(self.data / "rayfarm.sqlite")

    @property
    def worker_redis_url(self) -> str:
        """URL at which workers reach Redis."""
        return without_local_options(self.public_redis_url or self.redis_url)

    @property
    def own_url(self) -> str:
        """URL at which other services of this farm reach this one."""
        if self.peer_url:
            return self.peer_url.rstrip("/")
        host = self.host if self.host not in WILDCARD_ADDRESSES else _own_address()
        return f"http://{f'[{host}]' if ':' in host else host}:{self.port}"

    @property
    def is_loopback(self) -> bool:
        """Returns True if only this machine can reach the service."""
        return self.host in LOOPBACK

    @property
    def published_names(self) -> list[str]:
        """Addresses and host names under which the service's container is published, in lower case."""
        return self.published.lower().split()

    @property
    def page_url(self) -> str:
        """URL at which users open the page, derived from the settings.

        It is RAYFARM_PUBLIC_URL if set; else HTTPS with the first published host name; else HTTP with host and port.
        """
        if self.public_url:
            return self.public_url.rstrip("/")
        named = [name for name in self.published_names if not is_address(name) and name not in LOOPBACK]
        if named:
            return f"https://{named[0]}"
        reached = [name for name in (*self.published_names, self.host) if name not in WILDCARD_ADDRESSES]
        host = reached[0] if reached else socket.gethostname() if not self.published_names else "localhost"
        return f"http://{f'[{host}]' if ':' in host else host}:{self.published_port or self.port}"

    @property
    def needs_login(self) -> bool:
        """Returns True if all requests need a login."""
        if self.login == "auto":
            named = self.published_names or [self.host]
            return bool(self.trusted_proxies.split()) or any(name not in LOOPBACK for name in named)
        return self.login == "always"

    def make_folders(self) -> None:
        """Creates the data folder with its subfolders, and tokens and secrets that are not set. Raises StartupError."""
        try:
            self._make_folders()
        except OSError as error:
            raise StartupError(
                f"The data folder {self.data} cannot be written ({error.strerror or error}). "
                "Make room there, let this user write into it, or choose another folder (RAYFARM_DATA)."
            ) from error

    def _make_folders(self) -> None:
        self.data.mkdir(mode=PRIVATE_FOLDER, parents=True, exist_ok=True)
        with contextlib.suppress(PermissionError):  # another user's folder keeps its mode
            self.data.chmod(PRIVATE_FOLDER)
        for name in ("blobs", "films", "tmp"):
            (self.data / name).mkdir(mode=PRIVATE_FOLDER, exist_ok=True)
        if not self.token:
            self.token = _persistent_id(self.data / "token")
        if not self.owner_token:
            self.owner_token = _persistent_id(self.data / OWNER_TOKEN)
        if self.webhooks and not self.webhook_secret:
            path = self.data / "webhook-secret"
            if not path.exists():
                write_if_missing(path, f"{new_secret()}\n".encode())
            self.webhook_secret = path.read_text().strip()

    def login_key(self) -> bytes:
        """Returns the 32-byte key that encrypts cookies of unfinished OpenID logins.

        All services with the same data folder have the same key.
        """
        return hashlib.sha256(_persistent_id(self.data / "login-key").encode()).digest()

    def instance_id(self) -> str:
        """Returns the random id of this data folder, by which workers recognise it."""
        return _persistent_id(self.data / "instance")


class _Files(PydanticBaseSettingsSource):
    """Source of settings from files: the variable RAYFARM_NAME_FILE has the path of the file with the value of RAYFARM_NAME.

    Raises VariableError if a file cannot be read.
    """

    def get_field_value(self, field: FieldInfo, field_name: str) -> tuple[Any, str, bool]:
        """Returns the three values that Pydantic expects: the setting's value, its name, and whether the value is JSON.

        The value is the content of the setting's file, or None without a file, and never JSON.
        """
        name = f"RAYFARM_{field_name.upper()}"
        return (value_of(name) or None) if os.environ.get(name + FILE) else None, field_name, False

    def __call__(self) -> dict[str, Any]:
        """Returns the values of all settings that have a file, by field name."""
        values: dict[str, Any] = {}
        for name, field in self.settings_cls.model_fields.items():
            value, key, is_complex = self.get_field_value(field, name)
            if value is not None:
                values[key] = self.prepare_field_value(name, field, value, is_complex)
        return values


def is_address(name: str) -> bool:
    """Returns True if a host name is an IP address."""
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _own_address() -> str:
    """Returns the IP address of this machine or container in its network."""
    try:
        return socket.gethostbyname(socket.gethostname())
    except OSError:
        return "127.0.0.1"


def _persistent_id(path: Path) -> str:
    """Returns the random id that is stored in a private file at this path.

    Creates the file if it does not exist; safe if several services start at once.
    """
    made = f"{secrets.token_hex(16)}\n".encode()
    if not path.exists():
        write_if_missing(path, made)
    elif not path.read_text().strip():
        write_atomically(path, made)
    return path.read_text().strip()
