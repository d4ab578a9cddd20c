"""First release: the objects, and the objects that each word uses."""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None


def upgrade() -> None:
    """Create both tables."""
    op.create_table(
        "objects",
        sa.Column("seq", sa.BigInteger().with_variant(sa.Integer, "sqlite"), primary_key=True, autoincrement=True),
        sa.Column("id", sa.String(64), nullable=False, unique=True),
        sa.Column("kind", sa.String(16), nullable=False),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("model", sa.Text, nullable=False),
        sa.Column("spec", sa.Text, nullable=False),
        sa.Column("members", sa.Text, nullable=False),
        sa.Column("theta", sa.LargeBinary),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "uses",
        sa.Column("composed_id", sa.String(64), sa.ForeignKey("objects.id", ondelete="CASCADE"), primary_key=True),
        sa.Column("member_id", sa.String(64), sa.ForeignKey("objects.id", ondelete="RESTRICT"), primary_key=True),
        sa.Index("uses_member_id", "member_id"),
    )
