"""Makes lighting part of a job's request, and stores uploaded environments separately."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Creates the environments table and the lighting columns; existing jobs keep the scenes derived for their lighting."""
    op.create_table(
        "environments",
        sa.Column("id", sa.String(40), primary_key=True),
        sa.Column("name", sa.String(255), nullable=False),
        sa.Column("created", sa.Float(), nullable=False),
        sa.Column("file", sa.JSON(), nullable=False),
        sa.Column("thumbnail", sa.String(64), nullable=False),
    )
    op.create_index("ix_environments_created", "environments", ["created"])
    with op.batch_alter_table("scenes") as scenes:
        scenes.add_column(sa.Column("of", sa.String(40)))
        scenes.create_index("ix_scenes_of", ["of"])
    with op.batch_alter_table("jobs") as jobs:
        jobs.add_column(sa.Column("lit", sa.String(40)))
        jobs.add_column(sa.Column("light", sa.Text()))
        jobs.create_index("ix_jobs_lit", ["lit"])
