"""Adds the hash of a job's picture, by which later jobs find samples to reuse, and a job's record of reused samples."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0014"
down_revision = "0013"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Adds jobs.picture and jobs.taken. Existing jobs have no picture hash, so their samples are not reused."""
    op.add_column("jobs", sa.Column("picture", sa.String(64)))
    op.add_column("jobs", sa.Column("taken", sa.JSON()))
    op.create_index("jobs_by_picture", "jobs", ["picture", "created"])
