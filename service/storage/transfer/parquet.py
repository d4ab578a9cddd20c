"""Parquet files of objects: export a store, import a file."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.parquet as pq

from service.errors import CorruptWeights, HofError
from service.files import whole_file
from service.storage.store import Store
from service.storage.transfer.content import Tally, put_checked
from service.storage.transfer.copying import Progress, batches
from service.storage.transfer.table import Item, items_of, schema_of, table_of

COMPRESSION: Final = "zstd"
REPEATED: Final = ["kind", "model", "spec", "color_spec", "mask"]  # columns of few values
BATCH_ROWS: Final = 128  # read at a time


async def export(store: Store, path: Path, progress: Progress) -> int:
    """Write the objects that a store has at the start to a file, oldest first; return their number.

    Memory holds one batch of the store.
    """
    done, count, last = 0, await store.count(), await store.last_seq()
    specs, color_specs = await store.specs(last)
    schema = schema_of(_only({spec.size for spec in specs}), _only({spec.size for spec in color_specs}))
    with table_writer(path, schema) as writer:
        async for entries in batches(store, last):
            writer.write_table(table_of([Item(entry) for entry in entries], schema))
            done += len(entries)
            progress(done, count)
    return done


async def import_file(store: Store, path: Path, progress: Progress) -> Tally:
    """Put the objects of a file into a store. One that is there already stays as it is.

    An import that broke off is continued by calling this again.

    Raises
    ------
    CorruptWeights, InvalidSpec : the file is damaged, or is no table of objects; the batches before stay imported.
    NotFound : a composed object comes before the objects of its word.
    """
    tally = Tally()
    try:
        with pq.ParquetFile(path) as file:
            count = file.metadata.num_rows
            for batch in file.iter_batches(BATCH_ROWS):
                items = list(items_of(batch))
                entries = [item.entry for item in items if item.entry]
                await put_checked(store, entries, tally)
                tally.skipped += len(items) - len(entries)
                progress(tally.total, count)
    except (pa.ArrowException, UnicodeDecodeError, OSError) as error:
        if isinstance(error, OSError) and error.errno:  # the system's; pyarrow's own have no number
            raise
        raise CorruptWeights(f"{path}: it is not a Parquet file, or it is damaged: {_first_line(error)}") from error
    except HofError as error:
        raise error.prefixed(str(path)) from error
    return tally


@contextmanager
def table_writer(path: Path, schema: pa.Schema) -> Iterator[pq.ParquetWriter]:
    """Open a file for tables; it is there once the block ends. Numbers get no dictionary: theta hardly repeats any."""
    options = {"compression": COMPRESSION, "use_dictionary": REPEATED}
    with whole_file(path) as file, pq.ParquetWriter(file, schema, **options) as writer:
        yield writer


def _only(sizes: set[int]) -> int | None:
    """Return the one size that there is; None if there are several, or none."""
    return sizes.pop() if len(sizes) == 1 else None


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[0]
