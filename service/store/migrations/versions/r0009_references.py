"""Adds reference pictures for comparisons."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0008"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Creates the reference_pictures table."""
    op.create_table(
        "reference_pictures",
        sa.Column("id", sa.String(40), primary_key=True),
        sa.Column("name", sa.String(255), nullable=False),
        sa.Column("created", sa.Float(), nullable=False),
        sa.Column("file", sa.JSON(), nullable=False),
        sa.Column("film", sa.JSON(), nullable=False),
        sa.Column("width", sa.Integer(), nullable=False),
        sa.Column("height", sa.Integer(), nullable=False),
        sa.Column("is_display", sa.Boolean(), nullable=False),
        sa.Column("clipped", sa.Integer(), nullable=False),
    )
    op.create_index("ix_reference_pictures_created", "reference_pictures", ["created"])
