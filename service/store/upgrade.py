"""Brings a database to this release's tables: an empty one, one of an older release, never one of a newer."""

from __future__ import annotations

from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Engine, inspect

from service.errors import CannotStart
from service.store.models import Scene

__all__ = ["FIRST", "upgrade"]

FIRST = "0001"  # the tables of release 0.1.0, which wrote no revision down


def upgrade(engine: Engine) -> None:
    """Make or migrate the tables in one transaction. Raises CannotStart for one of a newer release."""
    config = _config()
    scripts = ScriptDirectory.from_config(config)
    with engine.connect() as connection:
        current = MigrationContext.configure(connection).get_current_revision()
    if current == scripts.get_current_head():
        return
    known = {script.revision for script in scripts.walk_revisions()}
    if current is not None and current not in known:
        raise CannotStart(
            f"The database {engine.url.render_as_string()} is of a newer release of Rayfarm (revision {current}; this release "
            f"knows up to {scripts.get_current_head()}). Start the newer release, or set RAYFARM_DATA to another folder."
        )
    with engine.execution_options(writes=True).begin() as connection:
        config.attributes["connection"] = connection
        if current is None and inspect(connection).has_table(Scene.__tablename__):
            command.stamp(config, FIRST)
        command.upgrade(config, "head")


def _config() -> Config:
    config = Config()
    config.set_main_option("script_location", str(Path(__file__).parent / "migrations").replace("%", "%%"))
    config.set_main_option("path_separator", "os")
    return config
