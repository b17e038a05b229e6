"""Adds a member's role in a project (`members.role`), and a job's list of distrusted workers (`jobs.doubted`)."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0017"
down_revision = "0016"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Adds the columns members.role, "submit" for existing members, and jobs.doubted, NULL for existing jobs.

    members.role limits what a user may do in a project. jobs.doubted has the names of workers whose samples are in the job's
    film and are no longer trusted.
    """
    op.add_column("members", sa.Column("role", sa.String(16), nullable=False, server_default="submit"))
    op.add_column("jobs", sa.Column("doubted", sa.JSON()))
