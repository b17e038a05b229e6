"""Adds jobs of several frames."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Adds jobs.shot and the state of frames; existing jobs are stills, whose only frame has the job's state."""
    with op.batch_alter_table("jobs") as jobs:
        jobs.add_column(sa.Column("shot", sa.JSON()))
    with op.batch_alter_table("frames") as frames:
        frames.add_column(sa.Column("state", sa.String(16), nullable=False, server_default="queued"))
        frames.add_column(sa.Column("error", sa.Text()))
        frames.add_column(sa.Column("noise", sa.Float()))
        frames.add_column(sa.Column("spp", sa.Integer()))
        frames.add_column(sa.Column("settings", sa.JSON()))
        frames.add_column(sa.Column("compiled", sa.JSON()))
