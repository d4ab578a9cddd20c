"""Schema of a database: its revision, its creation, and its migration to this version's revision.

A new database gets the tables as they are declared now, and the newest revision. Only older tables need Alembic, whose
import takes a tenth of a second.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from sqlalchemy import Column, Connection, MetaData, PrimaryKeyConstraint, String, Table, inspect, select

from service.errors import UnusableStore

FIRST: Final = "0001"
REVISIONS: Final = Path(__file__).parent / "migrations" / "versions"  # files: r0001_first_release.py, ...
ADVISORY_LOCK: Final = 0x686F66  # "hof": PostgreSQL's locks go by number

# The first release's tables; databases of that release do not record their revision.
FIRST_COLUMNS: Final = {
    "objects": {"seq", "id", "kind", "created_at", "model", "spec", "members", "theta"},
    "uses": {"composed_id", "member_id"},
}
# Alembic's own table, as Alembic declares it.
VERSION: Final = Table(
    "alembic_version",
    MetaData(),
    Column("version_num", String(32), nullable=False),
    PrimaryKeyConstraint("version_num", name="alembic_version_pkc"),
)


@dataclass(frozen=True)
class Schema:
    """The schema of a database: its revision, and the newest one.

    revision : None without tables, and for the first release's tables (`is_first_release`).
    """

    revision: str | None
    newest: str
    is_first_release: bool

    @property
    def is_empty(self) -> bool:
        """Return whether the tables are still to be created."""
        return self.revision is None and not self.is_first_release

    @property
    def is_older(self) -> bool:
        """Return whether the tables are still to be migrated."""
        return not self.is_empty and self.revision != self.newest


def migrate(connection: Connection, tables: MetaData) -> None:
    """Create the tables of an empty database, or migrate older ones, in the connection's transaction.

    If several processes start at once, one migrates and the others wait. A failed revision leaves the database as it
    was.

    Raises
    ------
    UnusableStore : a newer version of hof, or another program, created the tables.
    """
    _lock(connection)
    schema = read_schema(connection)
    if schema.is_empty:
        tables.create_all(connection)
        VERSION.create(connection, checkfirst=True)  # a failed first migration may have left it, without a row
        connection.execute(VERSION.insert(), {"version_num": schema.newest})
    elif schema.is_older:
        from service.storage.migrations import upgrade

        upgrade(connection, FIRST if schema.is_first_release else None)


def read_schema(connection: Connection) -> Schema:
    """Return the schema of a database, and change nothing.

    Raises
    ------
    UnusableStore : a newer version of hof, or another program, created the tables.
    """
    all_revisions, revision = revisions(), _revision(connection)
    newest = all_revisions[-1]
    if revision is not None and revision not in all_revisions:
        raise UnusableStore(
            f"its schema has revision {revision}, newer than {newest}, the newest that this version of hof supports; "
            "start the version of hof that wrote it, or restore an older backup"
        )
    return Schema(revision, newest, revision is None and _is_first_release(connection))


def revisions() -> list[str]:
    """Return this version's revisions, oldest first, by the names of their files."""
    return sorted(path.stem[1:5] for path in REVISIONS.glob("r*.py"))


def _revision(connection: Connection) -> str | None:
    if not inspect(connection).has_table(VERSION.name):
        return None
    revision: str | None = connection.execute(select(VERSION.c.version_num)).scalar()
    return revision


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
