"""Which picture a job is of, so that another of the same picture is found; and what it took from one."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0014"
down_revision = "0013"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Of jobs of before nobody knows: nothing is taken from them."""
    op.add_column("jobs", sa.Column("picture", sa.String(64)))
    op.add_column("jobs", sa.Column("taken", sa.JSON()))
    op.create_index("jobs_by_picture", "jobs", ["picture", "created"])
