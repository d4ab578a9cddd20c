"""Revisions of the database schema (Alembic). Opening a database migrates it to the newest one."""

from typing import Final

from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, inspect

from service.errors import UnusableStore

FIRST: Final = "0001"
ADVISORY_LOCK: Final = 0x686F66  # "hof": PostgreSQL's locks go by number

# The first release's tables; databases of that release do not record their revision.
FIRST_COLUMNS: Final = {
    "objects": {"seq", "id", "kind", "created_at", "model", "spec", "members", "theta"},
    "uses": {"composed_id", "member_id"},
}


def migrate(connection: Connection) -> None:
    """Migrate the schema to this version's revision, in the connection's transaction.

    If several processes start at once, one migrates and the others wait. A failed revision leaves the database as it
    was.

    Raises
    ------
    UnusableStore : a newer version of hof, or another program, created the tables.
    """
    _lock(connection)
    config = Config()
    config.set_main_option("script_location", "service.storage:migrations")
    config.attributes["connection"] = connection
    scripts = ScriptDirectory.from_config(config)
    newest = scripts.get_current_head()
    current = MigrationContext.configure(connection).get_current_revision()
    if current == newest:
        return
    if current is None and _is_first_release(connection):
        command.stamp(config, FIRST)
    elif current is not None and current not in {script.revision for script in scripts.walk_revisions()}:
        raise UnusableStore(
            f"its schema has revision {current}, newer than {newest}, the newest that this version of hof supports; "
            "start the version of hof that wrote it, or restore an older backup"
        )
    command.upgrade(config, "head")


def _lock(connection: Connection) -> None:
    """Keep other processes from migrating until the transaction ends."""
    if connection.dialect.name == "sqlite":
        connection.exec_driver_sql("BEGIN IMMEDIATE")
    elif connection.dialect.name == "postgresql":
        connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({ADVISORY_LOCK})")


def _is_first_release(connection: Connection) -> bool:
    """Return whether the first release's tables exist. Raises UnusableStore if tables of these names differ."""
    inspector = inspect(connection)
    existing = [table for table in FIRST_COLUMNS if inspector.has_table(table)]
    for table in FIRST_COLUMNS if existing else ():
        columns = {column["name"] for column in inspector.get_columns(table)} if table in existing else set()
        wrong = sorted(columns ^ FIRST_COLUMNS[table])
        if wrong:
            raise UnusableStore(
                f"its table {table!r} does not belong to hof (different columns: {', '.join(wrong)}); "
                "name another database"
            )
    return bool(existing)
