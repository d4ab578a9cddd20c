"""The schema of the database, revision by revision (Alembic). Whoever opens a database first brings it up to date."""

from typing import Final

from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, inspect

from service.errors import UnusableStore

FIRST: Final = "0001"
ADVISORY_LOCK: Final = 0x686F66  # "hof": PostgreSQL's locks go by number

# The first release's tables; a database of that time does not tell its revision.
FIRST_COLUMNS: Final = {
    "objects": {"seq", "id", "kind", "created_at", "model", "spec", "members", "theta"},
    "uses": {"composed_id", "member_id"},
}


def migrate(connection: Connection) -> None:
    """Bring the schema to this version's revision, within the transaction that the connection begins or is in.

    Of several processes that start at once, one migrates and the others wait for it. A revision that fails leaves
    the database as it was.

    Raises
    ------
    UnusableStore : a newer version of hof made the database, or something else did.
    """
    _lock(connection)
    config = Config()
    config.set_main_option("script_location", "service.storage:migrations")
    config.attributes["connection"] = connection
    scripts = ScriptDirectory.from_config(config)
    newest = scripts.get_current_head()
    found = MigrationContext.configure(connection).get_current_revision()
    if found == newest:
        return
    if found is None and _is_first_release(connection):
        command.stamp(config, FIRST)
    elif found is not None and found not in {script.revision for script in scripts.walk_revisions()}:
        raise UnusableStore(
            f"its schema is of revision {found}, newer than {newest}, the newest that this version of hof knows; "
            "start the version that made it, or restore a backup from before"
        )
    command.upgrade(config, "head")


def _lock(connection: Connection) -> None:
    """Until the transaction ends, nobody else migrates."""
    if connection.dialect.name == "sqlite":
        connection.exec_driver_sql("BEGIN IMMEDIATE")
    elif connection.dialect.name == "postgresql":
        connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({ADVISORY_LOCK})")


def _is_first_release(connection: Connection) -> bool:
    """Whether the first release's tables are there; False in an empty database. Refuses other tables of those names."""
    inspector = inspect(connection)
    there = [table for table in FIRST_COLUMNS if inspector.has_table(table)]
    for table in FIRST_COLUMNS if there else ():
        found = {column["name"] for column in inspector.get_columns(table)} if table in there else set()
        wrong = sorted(found ^ FIRST_COLUMNS[table])
        if wrong:
            raise UnusableStore(
                f"its table {table!r} is none of hof's (it differs in {', '.join(wrong)}); name another database"
            )
    return bool(there)
