"""`hof store`: whole stores as Parquet files, and copies between databases."""

import argparse
import asyncio
import sys
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, Final, TypeVar

from service.cli.files import settings_of
from service.cli.flags import add_settings
from service.cli.progress import ProgressLine
from service.errors import InvalidParameter, UnusableStore
from service.settings import Settings
from service.storage import database
from service.storage.store import Store
from service.storage.transfer import copying
from service.storage.transfer.content import Tally

R = TypeVar("R")

DIFFERENT: Final = 1  # exit status
MAX_NAMED: Final = 10
NEEDS_BULK: Final = "needs the extra `bulk`: run `pip install '.[bulk]'` in the source folder"


def add_stages(parser: argparse.ArgumentParser) -> None:
    """Add the commands of `hof store`."""
    stages = parser.add_subparsers(required=True, metavar="COMMAND")
    settings = {"database_url", "database_timeout_s"}

    export = stages.add_parser("export", help="write all objects to a Parquet file", description=_export.__doc__)
    export.add_argument("file", type=Path, help="file to write, .parquet")
    add_settings(export, only=settings)
    export.set_defaults(run=_export)

    import_ = stages.add_parser("import", help="read objects from a Parquet file", description=_import.__doc__)
    import_.add_argument("file", type=Path, help="a file of `hof store export` or `hof encode-many`")
    add_settings(import_, only=settings)
    import_.set_defaults(run=_import)

    copy = stages.add_parser("copy", help="copy all objects to another database", description=_copy.__doc__)
    copy.add_argument("source", help="database URL to read: sqlite:///PATH or postgresql://...")
    copy.add_argument("target", help="database URL to write")
    add_settings(copy, only={"database_timeout_s"})
    copy.set_defaults(run=_copy)


def _export(arguments: argparse.Namespace) -> None:
    """Write all objects of the store to a Parquet file, a row each. The service may run meanwhile."""
    check_bulk("hof store export")
    from service.storage.transfer.parquet import export

    async def run(settings: Settings, progress: ProgressLine) -> int:
        async with _opened(settings.database_url, settings, must_exist=True) as store:
            return await export(store, arguments.file, progress)

    print(f"hof: {arguments.file}: {_run(run, arguments)} objects", file=sys.stderr)


def _import(arguments: argparse.Namespace) -> int:
    """Put the objects of a Parquet file into the store; those that it has stay as they are.

    Run it again if it broke off. The exit status is 1 if the store has other content under an id.
    """
    check_bulk("hof store import")
    from service.storage.transfer.parquet import import_file

    async def run(settings: Settings, progress: ProgressLine) -> Tally:
        async with _opened(settings.database_url, settings) as store:
            return await import_file(store, arguments.file, progress)

    return _report(_run(run, arguments))


def _copy(arguments: argparse.Namespace) -> int:
    """Copy all objects of a database to another one, and compare what arrived by digest.

    Run it again if it broke off: what has arrived is compared, not written again. The exit status is 1 if the target
    has other content under an id.
    """

    async def run(settings: Settings, progress: ProgressLine) -> Tally:
        async with (
            _opened(arguments.source, settings, must_exist=True) as source,
            _opened(arguments.target, settings) as target,
        ):
            return await copying.copy(source, target, progress)

    return _report(_run(run, arguments))


def _run(work: Callable[[Settings, ProgressLine], Coroutine[Any, Any, R]], arguments: argparse.Namespace) -> R:
    progress = ProgressLine("objects")
    try:
        return asyncio.run(work(settings_of(arguments), progress))
    finally:
        progress.end()


@asynccontextmanager
async def _opened(url: str, settings: Settings, *, must_exist: bool = False) -> AsyncIterator[Store]:
    """Open a store. Raises UnusableStore, also for a missing SQLite file that `must_exist`."""
    file = database.parse(url).file
    if must_exist and file and not file.exists():
        raise UnusableStore(f"the database file {file} does not exist; check the URL")
    store = await Store.open(url, settings.database_timeout_s, connections=1)
    try:
        yield store
    finally:
        await store.close()


def _report(tally: Tally) -> int:
    print(f"hof: {tally}", file=sys.stderr)
    if not tally.different:
        return 0
    more = f" and {len(tally.different) - MAX_NAMED} more" if len(tally.different) > MAX_NAMED else ""
    print(
        f"hof: {len(tally.different)} objects are there with other content, and stay as they are: "
        f"{', '.join(tally.different[:MAX_NAMED])}{more}",
        file=sys.stderr,
    )
    return DIFFERENT


def check_bulk(command: str) -> None:
    """Raise InvalidParameter unless the extra `bulk` is installed."""
    try:
        import pebble  # noqa: F401
        import pyarrow  # noqa: F401
    except ImportError as error:
        raise InvalidParameter(f"{command} {NEEDS_BULK}") from error
