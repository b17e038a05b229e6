"""Adds strict scenes, which fail on warnings."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0020"
down_revision = "0019"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Adds scenes.strict; existing scenes are not strict."""
    op.add_column("scenes", sa.Column("strict", sa.Boolean(), nullable=False, server_default=sa.false()))
