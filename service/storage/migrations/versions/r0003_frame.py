"""Frame and photo: an object's box, and the report on the photo it was encoded from."""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"


def upgrade() -> None:
    """Add both columns. Boxes of existing objects are measured when they are first read."""
    op.add_column("objects", sa.Column("frame", sa.LargeBinary, nullable=True))
    op.add_column("objects", sa.Column("image", sa.Text, nullable=True))
