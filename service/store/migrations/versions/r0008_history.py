"""Adds the rendering history of a job."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Adds jobs.history; existing jobs have none."""
    with op.batch_alter_table("jobs") as jobs:
        jobs.add_column(sa.Column("history", sa.JSON()))
