"""Adds the material variant of a scene."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Adds scenes.variant; existing scenes get NULL, the materials of their files."""
    with op.batch_alter_table("scenes") as scenes:
        scenes.add_column(sa.Column("variant", sa.Text()))
