"""Revisions of the database schema (Alembic). Opening a database migrates it to the newest one."""

from alembic import command
from alembic.config import Config
from sqlalchemy import Connection


def upgrade(connection: Connection, unrecorded: str | None = None) -> None:
    """Migrate tables to the newest revision, in the connection's transaction.

    Parameters
    ----------
    unrecorded : the revision that the tables have, if they do not record it.
    """
    config = Config()
    config.set_main_option("script_location", "service.storage:migrations")
    config.attributes["connection"] = connection
    if unrecorded:
        command.stamp(config, unrecorded)
    command.upgrade(config, "head")
