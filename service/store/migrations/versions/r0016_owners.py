"""Adds the table with the service process that owns the farm."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0016"
down_revision = "0015"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Creates the table `owners` without rows."""
    op.create_table(
        "owners",
        sa.Column("what", sa.String(40), primary_key=True),
        sa.Column("epoch", sa.BigInteger(), nullable=False),
        sa.Column("owner", sa.String(40)),
        sa.Column("place", sa.String(300), nullable=False),
        sa.Column("url", sa.String(300), nullable=False),
        sa.Column("folder", sa.String(64), nullable=False),
        sa.Column("process", sa.JSON()),
        sa.Column("locked", sa.Boolean(), nullable=False),
        sa.Column("since", sa.Float(), nullable=False),
        sa.Column("takeovers", sa.Integer(), nullable=False),
        sa.Column("asked", sa.BigInteger(), nullable=False),
        sa.Column("answered", sa.BigInteger(), nullable=False),
        sa.Column("asked_by", sa.String(300)),
        sa.Column("asked_at", sa.Float()),
    )
