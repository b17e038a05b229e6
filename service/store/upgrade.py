"""Brings a database to this release's tables: an empty one, one of an older release, never one of a newer."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Engine, inspect

from service.errors import CannotStart
from service.store.models import Scene

__all__ = ["FIRST", "Standing", "refuse_newer", "standing", "upgrade"]

FIRST = "0001"  # the tables of release 0.1.0, which wrote no revision down


@dataclass(frozen=True)
class Standing:
    """The revision that a database is at (None: of release 0.1.0, or empty), and this release's."""

    current: str | None
    head: str
    is_newer: bool


def standing(engine: Engine) -> Standing:
    """Where a database stands; changes nothing."""
    head, known = _revisions()
    with engine.connect() as connection:
        current = MigrationContext.configure(connection).get_current_revision()
    return Standing(current, head, current is not None and current not in known)


def refuse_newer(engine: Engine) -> Standing:
    """Where a database stands. Raises CannotStart for one of a newer release; changes nothing."""
    stands = standing(engine)
    if stands.is_newer:
        raise CannotStart(
            f"The database {engine.url.render_as_string()} is of a newer release of Rayfarm (revision {stands.current}; this "
            f"release knows up to {stands.head}). Start the newer release, or set RAYFARM_DATA to another folder."
        )
    return stands


def upgrade(engine: Engine) -> None:
    """Make or migrate the tables in one transaction. Raises CannotStart for one of a newer release."""
    config = _config()
    stands = refuse_newer(engine)
    if stands.current == stands.head:
        return
    with engine.execution_options(writes=True).begin() as connection:
        config.attributes["connection"] = connection
        if stands.current is None and inspect(connection).has_table(Scene.__tablename__):
            command.stamp(config, FIRST)
        command.upgrade(config, "head")


@functools.cache
def _revisions() -> tuple[str, frozenset[str]]:
    """This release's revision, and all that it knows: read once from a file each."""
    scripts = ScriptDirectory.from_config(_config())
    return str(scripts.get_current_head()), frozenset(script.revision for script in scripts.walk_revisions())


def _config() -> Config:
    config = Config()
    config.set_main_option("script_location", str(Path(__file__).parent / "migrations").replace("%", "%%"))
    config.set_main_option("path_separator", "os")
    return config
