"""Creates or migrates the database's tables for this release; refuses a database of a newer release."""

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

FIRST = "0001"  # the tables of release 0.1.0, which recorded no revision


@dataclass(frozen=True)
class Standing:
    """The revision of a database (None: release 0.1.0, or empty), and that of this release."""

    current: str | None
    head: str
    is_newer: bool


def standing(engine: Engine) -> Standing:
    """Returns the revision of a database. Changes nothing."""
    head, known = _revisions()
    with engine.connect() as connection:
        current = MigrationContext.configure(connection).get_current_revision()
    return Standing(current, head, current is not None and current not in known)


def refuse_newer(engine: Engine) -> Standing:
    """Returns the revision of a database. Raises CannotStart for one of a newer release. Changes nothing."""
    stands = standing(engine)
    if stands.is_newer:
        raise CannotStart(
            f"The database {engine.url.render_as_string()} is of a newer release of Rayfarm (revision {stands.current}; this "
            f"release knows up to {stands.head}). Start the newer release, or set RAYFARM_DATA to another folder."
        )
    return stands


def upgrade(engine: Engine) -> None:
    """Creates or migrates the tables in one transaction. Raises CannotStart for a database of a newer release."""
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
    """Returns this release's revision and all revisions it knows. Cached, since each comes from its own file."""
    scripts = ScriptDirectory.from_config(_config())
    return str(scripts.get_current_head()), frozenset(script.revision for script in scripts.walk_revisions())


def _config() -> Config:
    config = Config()
    config.set_main_option("script_location", str(Path(__file__).parent / "migrations").replace("%", "%%"))
    config.set_main_option("path_separator", "os")
    return config
