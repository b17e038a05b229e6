"""Adds the history of a job: its noise over time, and its events."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Adds jobs.history; existing jobs have no history."""
    with op.batch_alter_table("jobs") as jobs:
        jobs.add_column(sa.Column("history", sa.JSON()))
