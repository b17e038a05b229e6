"""Allows errors and notes to be sentences with codes (service/store/sentence_columns.py), which older releases show as JSON."""

from __future__ import annotations

revision = "0021"
down_revision = "0020"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Changes no table, since texts of older releases remain valid."""
