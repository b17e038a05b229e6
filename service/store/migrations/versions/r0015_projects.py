"""Adds projects, their members and contents, the user and key of each upload and job, and quotas."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0015"
down_revision = "0014"
branch_labels = None
depends_on = None

TABLES = ("scenes", "jobs", "environments", "reference_pictures")
LISTED = {
    "jobs_listed": ["created", "id", "state", "scene", "name", "project"],
    "jobs_by_state": ["state", "created", "id", "scene", "name", "project"],
}


def upgrade() -> None:
    """Adds tables and columns; existing rows belong to no project, which all users see, and have unknown owners."""
    op.create_table(
        "projects",
        sa.Column("name", sa.String(64), primary_key=True),
        sa.Column("created", sa.Float(), nullable=False),
    )
    op.create_table(
        "members",
        sa.Column("project", sa.String(64), sa.ForeignKey("projects.name", ondelete="CASCADE"), primary_key=True),
        sa.Column("user", sa.String(64), primary_key=True),
    )
    op.create_index("ix_members_user", "members", ["user"])
    for table in TABLES:
        op.add_column(table, sa.Column("project", sa.String(64), nullable=False, server_default=""))
        if table != "jobs":  # jobs.user exists since 0013
            op.add_column(table, sa.Column("user", sa.String(64)))
        op.add_column(table, sa.Column("key", sa.String(20)))
    op.create_table(
        "quotas",
        sa.Column("whose", sa.String(80), primary_key=True),
        sa.Column("bytes", sa.BigInteger()),
        sa.Column("jobs", sa.Integer()),
        sa.Column("samples_day", sa.BigInteger()),
    )
    op.create_table(
        "spent",
        sa.Column("job", sa.String(40), primary_key=True),
        sa.Column("user", sa.String(64)),
        sa.Column("key", sa.String(20)),
        sa.Column("created", sa.Float(), nullable=False),
        sa.Column("samples", sa.BigInteger(), nullable=False),
    )
    op.create_index("ix_spent_created", "spent", ["created"])
    op.add_column("users", sa.Column("subject", sa.String(512)))
    op.create_index("ix_users_subject", "users", ["subject"])
    op.create_index("jobs_of_user", "jobs", ["user", "state", "created"])
    for index, columns in LISTED.items():
        op.drop_index(index, "jobs")
        op.create_index(index, "jobs", columns)
