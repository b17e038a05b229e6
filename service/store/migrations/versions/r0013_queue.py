"""Adds a job's owner, dependencies, deadline and requirements, the users' shares, and the settings of workers."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0013"
down_revision = "0012"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Adds columns and tables for queueing. Existing jobs have no dependencies, no deadline and an unknown owner."""
    op.add_column("jobs", sa.Column("user", sa.String(64)))
    op.add_column("jobs", sa.Column("max_slots", sa.Integer()))
    op.add_column("jobs", sa.Column("deadline", sa.Float()))
    op.add_column("jobs", sa.Column("late", sa.Float()))
    op.add_column("jobs", sa.Column("needs", sa.JSON(none_as_null=True)))
    op.create_table(
        "waits",
        sa.Column("job", sa.String(40), sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
        sa.Column("other", sa.String(40), primary_key=True),
    )
    op.create_index("ix_waits_other", "waits", ["other"])
    op.create_table(
        "shares",
        sa.Column("name", sa.String(80), primary_key=True),
        sa.Column("weight", sa.Float(), nullable=False),
        sa.Column("max_slots", sa.Integer()),
    )
    op.create_table(
        "worker_terms",
        sa.Column("name", sa.String(255), primary_key=True),
        sa.Column("terms", sa.JSON(), nullable=False),
    )
