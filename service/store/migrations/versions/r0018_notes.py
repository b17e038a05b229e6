"""Adds notes on jobs, and an index of the jobs with a note for searches."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0018"
down_revision = "0017"
branch_labels = None
depends_on = None

NOTED = sa.text("note IS NOT NULL")


def upgrade() -> None:
    """Adds jobs.note and its partial index; existing jobs have no note."""
    op.add_column("jobs", sa.Column("note", sa.Text()))
    op.create_index("jobs_noted", "jobs", ["id"], sqlite_where=NOTED, postgresql_where=NOTED)
