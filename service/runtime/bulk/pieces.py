"""Finished pieces of a table: a folder beside the file that they become, so that a run can be continued."""

import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.parquet as pq

from service.errors import InvalidParameter
from service.files import whole_file
from service.storage.transfer.parquet import table_writer
from service.storage.transfer.table import Item, table_of

SUFFIX: Final = ".pieces"
RUN: Final = "run.json"


class Pieces:
    """The pieces of the table in `path`, numbered from 0.

    run : what the rows depend on beside the photos; a run can be continued only with the same.
    """

    def __init__(self, path: Path, schema: pa.Schema, run: Mapping[str, object]) -> None:
        self._path = path
        self._folder = path.with_name(path.name + SUFFIX)
        self._schema = schema
        self._run = json.dumps(run, indent=1, sort_keys=True)

    def begin(self) -> None:
        """Create the folder, or continue the run that it holds.

        Raises
        ------
        InvalidParameter : the table exists already, or the folder holds pieces of a run with other options.
        """
        if self._path.exists():
            raise InvalidParameter(f"{self._path} exists already: name another file, or remove it")
        self._folder.mkdir(exist_ok=True)
        run = self._folder / RUN
        if not run.exists():
            with whole_file(run) as file:
                file.write(self._run.encode())
        elif run.read_text("utf-8") != self._run:
            raise InvalidParameter(
                f"{self._folder} holds a run that broke off, with another model or other options: continue it with "
                "those, or remove the folder"
            )

    def holds(self, number: int, sources: Sequence[str]) -> bool:
        """Return whether a piece is finished, with rows of these photos in this order."""
        try:
            column = pq.read_table(self._piece(number), columns=["source"])["source"]
        except (OSError, pa.ArrowException):  # missing or damaged: it is written again
            return False
        return bool(column.to_pylist() == list(sources))

    def write(self, number: int, items: Sequence[Item]) -> None:
        """Write a piece."""
        with table_writer(self._piece(number), self._schema) as writer:
            writer.write_table(table_of(items, self._schema))

    def join(self, count: int) -> int:
        """Write the table from its `count` pieces, remove them, and return how many rows hold no object."""
        failed = 0
        with table_writer(self._path, self._schema) as writer:
            for number in range(count):
                table = pq.read_table(self._piece(number))
                failed += table["id"].null_count
                writer.write_table(table)
        shutil.rmtree(self._folder)
        return failed

    def _piece(self, number: int) -> Path:
        return self._folder / f"{number:08}.parquet"
