"""Revisions of the database schema (Alembic). Opening a database migrates it to the newest one."""

from dataclasses import dataclass
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
    schema = read_schema(connection)
    if schema.revision == schema.newest:
        return
    config = _config()
    config.attributes["connection"] = connection
    if schema.is_first_release:
        command.stamp(config, FIRST)
    command.upgrade(config, "head")


@dataclass(frozen=True)
class Schema:
    """The schema of a database: its revision, and the newest one.

    revision : None without tables, and for the first release's tables (`is_first_release`).
    """

    revision: str | None
    newest: str | None
    is_first_release: bool

    @property
    def is_empty(self) -> bool:
        """Return whether the tables are still to be created."""
        return self.revision is None and not self.is_first_release

    @property
    def is_older(self) -> bool:
        """Return whether the tables are still to be migrated."""
        return not self.is_empty and self.revision != self.newest


def read_schema(connection: Connection) -> Schema:
    """Return the schema of a database, and change nothing.

    Raises
    ------
    UnusableStore : a newer version of hof, or another program, created the tables.
    """
    scripts = ScriptDirectory.from_config(_config())
    newest = scripts.get_current_head()
    revision = MigrationContext.configure(connection).get_current_revision()
    if revision is not None and revision not in {script.revision for script in scripts.walk_revisions()}:
        raise UnusableStore(
            f"its schema has revision {revision}, newer than {newest}, the newest that this version of hof supports; "
            "start the version of hof that wrote it, or restore an older backup"
        )
    return Schema(revision, newest, revision is None and _is_first_release(connection))


def _config() -> Config:
    config = Config()
    config.set_main_option("script_location", "service.storage:migrations")
    return config


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
