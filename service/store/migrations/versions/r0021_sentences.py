"""Lets errors and notes hold sentences with codes (service/store/sentence_columns.py), which releases before show as JSON."""

from __future__ import annotations

revision = "0021"
down_revision = "0020"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Changes no table: the texts of older releases stay as they are."""
