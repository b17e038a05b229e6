"""Adds the time when a job's film was last checked, and the flag that exempts a job from retention rules."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0010"
down_revision = "0009"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Adds jobs.checked and jobs.pinned; existing films count as unchecked and existing jobs as not pinned."""
    # Not in a batch: a batch recreates the table, and rows that refer to the old table would be deleted with it.
    op.add_column("jobs", sa.Column("checked", sa.Float()))
    op.add_column("jobs", sa.Column("pinned", sa.Boolean(), nullable=False, server_default=sa.false()))
