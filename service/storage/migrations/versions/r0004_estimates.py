"""Estimates: how well an encoded object's shape fits, and the camera that took its photo."""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"


def upgrade() -> None:
    """Add the column; existing objects have no estimates."""
    op.add_column("objects", sa.Column("estimates", sa.Text, nullable=True))
