"""What somebody wrote about a job; an index of those that have such a note, so that a search reads these alone."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0018"
down_revision = "0017"
branch_labels = None
depends_on = None

NOTED = sa.text("note IS NOT NULL")


def upgrade() -> None:
    """No job has a note yet."""
    op.add_column("jobs", sa.Column("note", sa.Text()))
    op.create_index("jobs_noted", "jobs", ["id"], sqlite_where=NOTED, postgresql_where=NOTED)
