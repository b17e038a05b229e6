"""Lists of very many jobs."""

from __future__ import annotations

from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Two indexes hold all that a list is chosen and ordered by, in place of two that hold a column each."""
    op.create_index("jobs_listed", "jobs", ["created", "id", "state", "scene", "name"])
    op.create_index("jobs_by_state", "jobs", ["state", "created", "id", "scene", "name"])
    for column in ("created", "state"):
        op.drop_index(f"ix_jobs_{column}", "jobs")
