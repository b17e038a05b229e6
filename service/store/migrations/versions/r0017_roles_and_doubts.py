"""What a member may do in a project; and of a job which workers' samples in its film are not believed any more."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0017"
down_revision = "0016"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Those that are members already may do there what they may anywhere; no film is doubted yet."""
    op.add_column("members", sa.Column("role", sa.String(16), nullable=False, server_default="submit"))
    op.add_column("jobs", sa.Column("doubted", sa.JSON()))
