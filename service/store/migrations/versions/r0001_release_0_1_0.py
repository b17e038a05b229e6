"""The tables of release 0.1.0."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Creates the tables in an empty database."""
    op.create_table(
        "scenes",
        sa.Column("id", sa.String(40), primary_key=True),
        sa.Column("name", sa.String(255), nullable=False),
        sa.Column("status", sa.String(16), nullable=False),
        sa.Column("error", sa.Text()),
        sa.Column("created", sa.Float(), nullable=False),
        sa.Column("main", sa.Text(), nullable=False),
        sa.Column("environment", sa.Text()),
        sa.Column("files", sa.JSON(), nullable=False),
        sa.Column("bytes", sa.BigInteger(), nullable=False),
        sa.Column("notes", sa.JSON(), nullable=False),
        sa.Column("info", sa.JSON()),
        sa.Column("compiled", sa.JSON(), nullable=False),
    )
    op.create_index("ix_scenes_created", "scenes", ["created"])
    op.create_index("ix_scenes_status", "scenes", ["status"])
    op.create_table(
        "jobs",
        sa.Column("id", sa.String(40), primary_key=True),
        sa.Column("scene", sa.String(40), nullable=False),
        sa.Column("name", sa.String(255), nullable=False),
        sa.Column("state", sa.String(16), nullable=False),
        sa.Column("priority", sa.Integer(), nullable=False),
        sa.Column("created", sa.Float(), nullable=False),
        sa.Column("started", sa.Float()),
        sa.Column("finished", sa.Float()),
        sa.Column("active_s", sa.Float(), nullable=False),
        sa.Column("request", sa.JSON(), nullable=False),
        sa.Column("settings", sa.JSON()),
        sa.Column("tile_size", sa.Integer()),
        sa.Column("spp", sa.Integer()),
        sa.Column("noise", sa.Float()),
        sa.Column("seconds", sa.Float()),
        sa.Column("kind", sa.String(128)),
        sa.Column("error", sa.Text()),
        sa.Column("reproduce", sa.Text()),
        sa.Column("idempotency_key", sa.String(255), unique=True),
    )
    for column in ("created", "scene", "state"):
        op.create_index(f"ix_jobs_{column}", "jobs", [column])
    op.create_table(
        "frames",
        sa.Column("job", sa.String(40), sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
        sa.Column("number", sa.Integer(), primary_key=True, autoincrement=False),
        sa.Column("samples", sa.BigInteger(), nullable=False),
        sa.Column("target", sa.BigInteger(), nullable=False),
        sa.Column("bad_samples", sa.BigInteger(), nullable=False),
        sa.Column("progress", sa.Float(), nullable=False),
    )
    op.create_index("frames_of_job", "frames", ["job"])
