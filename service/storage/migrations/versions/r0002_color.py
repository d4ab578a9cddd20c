"""Color: a second mapping function beside theta, with its own spec."""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"


def upgrade() -> None:
    """Add both columns; existing objects have no color."""
    op.add_column("objects", sa.Column("color", sa.LargeBinary, nullable=True))
    op.add_column("objects", sa.Column("color_spec", sa.Text, nullable=True))
