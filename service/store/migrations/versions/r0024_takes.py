"""Adds takes: saved cameras and settings of scenes' live views."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0024"
down_revision = "0023"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Adds the table takes."""
    op.create_table(
        "takes",
        sa.Column("id", sa.String(20), primary_key=True),
        sa.Column("scene", sa.String(40), sa.ForeignKey("scenes.id", ondelete="CASCADE"), nullable=False),
        sa.Column("name", sa.String(100), nullable=False),
        sa.Column("author", sa.String(64)),
        sa.Column("created", sa.Float(), nullable=False),
        sa.Column("request", sa.JSON(), nullable=False),
        sa.Column("exposure", sa.Float(), nullable=False),
        sa.Column("tonemap", sa.String(400), nullable=False),
        sa.Column("picture", sa.LargeBinary()),
        sa.Column("has_picture", sa.Boolean(), nullable=False),
    )
    op.create_index("takes_of_scene", "takes", ["scene", "created"])
