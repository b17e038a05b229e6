"""Adds a member's role in a project, and the workers whose samples in a job's film are no longer trusted."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0017"
down_revision = "0016"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Adds members.role and jobs.doubted; existing members get `submit`, limited by the user's own role."""
    op.add_column("members", sa.Column("role", sa.String(16), nullable=False, server_default="submit"))
    op.add_column("jobs", sa.Column("doubted", sa.JSON()))
