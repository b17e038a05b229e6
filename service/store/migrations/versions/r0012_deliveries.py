"""Adds webhook deliveries about the end of jobs."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0012"
down_revision = "0011"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Creates the deliveries table and an index of jobs by end time."""
    op.create_table(
        "deliveries",
        sa.Column("id", sa.String(40), primary_key=True),
        sa.Column("hook", sa.String(2048), nullable=False),
        sa.Column("job", sa.String(40), nullable=False),
        sa.Column("ended", sa.Float(), nullable=False),
        sa.Column("message", sa.JSON(), nullable=False),
        sa.Column("attempts", sa.Integer(), nullable=False),
        sa.Column("due", sa.Float()),
        sa.Column("done", sa.Float()),
        sa.Column("error", sa.Text()),
        sa.UniqueConstraint("hook", "job", "ended", name="deliveries_once"),
    )
    op.create_index("deliveries_due", "deliveries", ["due"])
    op.create_index("jobs_ended", "jobs", ["finished", "id"])
