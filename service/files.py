"""Files that are written whole or not at all."""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """Open a temporary file for writing, in the folder of `path`; it replaces `path` when the block ends.

    On any error the temporary file is removed and `path` stays as it was. Two writers of one path do not meet: each
    has a temporary file of its own, and the one that ends last wins.

    Raises
    ------
    OSError : the temporary file cannot be created or renamed; the error names `path`.
    """
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(8)}.part")
    try:
        with _naming(path):
            file = temporary.open("xb")
        with file:
            yield file
        with _naming(path):
            os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Name `path`, not the temporary file, in an OSError: it is what the user asked for."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
