"""Adds whether a guest of a share link resolved a note."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0025"
down_revision = "0024"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Adds review_notes.resolved_guest. Existing notes get NULL: who resolved them is shown as a user."""
    op.add_column("review_notes", sa.Column("resolved_guest", sa.Boolean()))
