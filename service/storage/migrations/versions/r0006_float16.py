"""Functions in float16: an older version would misread them, so it must not start."""

revision = "0006"
down_revision = "0005"


def upgrade() -> None:
    """Change no table: the spec of a row and the length of its theta tell the type, also in older rows."""
