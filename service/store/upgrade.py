"""Creates or migrates the database's tables for this release. Rejects a database of a newer release.

Alembic is imported only for migrations: importing it takes a tenth of a service's start, and most starts migrate nothing.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path

from sqlalchemy import Engine, inspect, text

from service.errors import StartupError
from service.store.models import Scene

__all__ = ["FIRST_REVISION", "SchemaState", "refuse_newer", "schema_state", "upgrade"]

MIGRATIONS = Path(__file__).parent / "migrations"
FIRST_REVISION = "0001"  # the tables of release 0.1.0, which recorded no revision


@dataclass(frozen=True)
class SchemaState:
    """The revision of a database (None for release 0.1.0, or if empty), and the revision of this release."""

    current: str | None
    head: str
    is_newer: bool


def schema_state(engine: Engine) -> SchemaState:
    """Returns the revision of a database. Changes nothing."""
    known = _revisions()
    with engine.connect() as connection:
        recorded = inspect(connection).has_table("alembic_version")
        current = connection.scalar(text("SELECT version_num FROM alembic_version")) if recorded else None
    return SchemaState(current, known[-1], current is not None and current not in known)


def refuse_newer(engine: Engine) -> SchemaState:
    """Returns the revision of a database. Changes nothing.

    Raises StartupError if a newer release has created or migrated the database.
    """
    stands = schema_state(engine)
    if stands.is_newer:
        raise StartupError(
            f"The database {engine.url.render_as_string()} is of a newer release of Rayfarm (revision {stands.current}; this "
            f"release knows up to {stands.head}). Start the newer release, or set RAYFARM_DATA to another folder."
        )
    return stands


def upgrade(engine: Engine) -> None:
    """Creates or migrates the tables in one transaction. Raises StartupError for a database of a newer release."""
    stands = refuse_newer(engine)
    if stands.current == stands.head:
        return
    from alembic import command
    from alembic.config import Config

    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS).replace("%", "%%"))
    config.set_main_option("path_separator", "os")
    with engine.execution_options(writes=True).begin() as connection:
        config.attributes["connection"] = connection
        if stands.current is None and inspect(connection).has_table(Scene.__tablename__):
            command.stamp(config, FIRST_REVISION)
        command.upgrade(config, "head")


@functools.cache
def _revisions() -> tuple[str, ...]:
    """Returns the known revisions, oldest first, from the file names of the migrations: r0020_strict.py is revision 0020."""
    return tuple(sorted(path.name[1:5] for path in (MIGRATIONS / "versions").glob("r*.py")))
