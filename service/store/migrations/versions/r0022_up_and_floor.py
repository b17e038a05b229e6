"""Adds the up axis of a scene, and the floor of its studio lighting."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0022"
down_revision = "0021"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Adds scenes.up and scenes.floor. Existing scenes get NULL: their up axis is guessed, and they have no floor."""
    op.add_column("scenes", sa.Column("up", sa.String(2)))
    op.add_column("scenes", sa.Column("floor", sa.String(8)))
