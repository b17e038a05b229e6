"""Adds covering indexes for long job lists."""

from __future__ import annotations

from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Replaces two single-column indexes by two that cover all columns used for filtering and sorting."""
    op.create_index("jobs_listed", "jobs", ["created", "id", "state", "scene", "name"])
    op.create_index("jobs_by_state", "jobs", ["state", "created", "id", "scene", "name"])
    for column in ("created", "state"):
        op.drop_index(f"ix_jobs_{column}", "jobs")
