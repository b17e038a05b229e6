"""What is kept: when a job's film was last read as a whole, and whether it is to stay whatever its age."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0010"
down_revision = "0009"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """No film of before was looked at, and nobody has pinned anything."""
    # Not in a batch: that makes the table anew for a column with a default, and what refers to its rows goes with the old one.
    op.add_column("jobs", sa.Column("checked", sa.Float()))
    op.add_column("jobs", sa.Column("pinned", sa.Boolean(), nullable=False, server_default=sa.false()))
