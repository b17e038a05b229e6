"""Adds the focus of a job: a rectangle that is rendered first."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Adds jobs.focus; existing jobs have no focus."""
    with op.batch_alter_table("jobs") as jobs:
        jobs.add_column(sa.Column("focus", sa.JSON()))
