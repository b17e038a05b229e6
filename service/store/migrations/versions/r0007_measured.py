"""Adds the cost and noise of a scene, as measured by its latest job."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Adds scenes.measured; existing scenes have no measurements until they are rendered again."""
    with op.batch_alter_table("scenes") as scenes:
        scenes.add_column(sa.Column("measured", sa.JSON()))
