"""Adds share links that may comment, notes pinned to pictures, and the state of a job's review."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0023"
down_revision = "0022"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Adds keys.comments, jobs.review and the table review_notes. Existing links show their job, and nothing else."""
    op.add_column("keys", sa.Column("comments", sa.Boolean(), nullable=False, server_default=sa.false()))
    op.add_column("jobs", sa.Column("review", sa.JSON()))
    op.create_table(
        "review_notes",
        sa.Column("id", sa.String(20), primary_key=True),
        sa.Column("job", sa.String(40), sa.ForeignKey("jobs.id", ondelete="CASCADE"), nullable=False),
        sa.Column("reply_to", sa.String(20)),
        sa.Column("frame", sa.Integer(), nullable=False),
        sa.Column("x", sa.Float()),
        sa.Column("y", sa.Float()),
        sa.Column("author", sa.String(64), nullable=False),
        sa.Column("link", sa.String(20)),
        sa.Column("text", sa.Text(), nullable=False),
        sa.Column("created", sa.Float(), nullable=False),
        sa.Column("resolved", sa.Float()),
        sa.Column("resolved_by", sa.String(64)),
    )
    op.create_index("review_notes_of_job", "review_notes", ["job", "created"])
