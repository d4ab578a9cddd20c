"""Label and photo: a name that people give an object, and a small picture of its photo."""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"


def upgrade() -> None:
    """Add both columns; existing objects have neither."""
    op.add_column("objects", sa.Column("label", sa.Text, nullable=True))
    op.add_column("objects", sa.Column("photo", sa.LargeBinary, nullable=True))
