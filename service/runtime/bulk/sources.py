"""Lists of photos: a folder, on disk or in S3, a text file with a path on each line, or a pattern."""

import glob
import os
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Final, NoReturn

from service.errors import InvalidParameter
from service.runtime.bulk import s3

SUFFIXES: Final = (".png", ".jpg", ".jpeg", ".webp", ".avif", ".heic", ".heif")


def photos_of(source: str) -> Iterator[str]:
    """Yield the paths of photos, always in the same order.

    Parameters
    ----------
    source : a folder, searched with its subfolders for files with `SUFFIXES`, hidden ones left out; a text file with a
        path on each line; one photo; or a pattern such as `photos/**/*.jpg`. A folder or a photo, also on a line of
        the text file, may be in S3: `s3://BUCKET/FOLDER`.

    Raises
    ------
    InvalidParameter : there is no such file or folder, and nothing fits the pattern.
    OSError : a folder or the list cannot be read; ConnectionError if it is in S3.
    """
    if s3.is_url(source):
        yield from (url for url in s3.files_of(source) if url.lower().endswith(SUFFIXES))
    elif os.path.isdir(source):
        yield from _in_folder(source)
    elif os.path.isfile(source):
        yield from [source] if source.lower().endswith(SUFFIXES) else _in_list(Path(source))
    else:
        matches = sorted(path for path in glob.iglob(source, recursive=True) if os.path.isfile(path))
        if not matches:
            raise InvalidParameter(f"{source}: no such file or folder, and no file fits this pattern")
        yield from matches


def chunks(names: Iterable[str], size: int) -> Iterator[tuple[str, ...]]:
    """Yield names in tuples of `size`; the last one may be shorter."""
    iterator = iter(names)
    while chunk := tuple(islice(iterator, size)):
        yield chunk


def _in_folder(folder: str) -> Iterator[str]:
    for path, folders, files in os.walk(folder, onerror=_fail):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(files):
            if name.lower().endswith(SUFFIXES) and not name.startswith("."):
                yield os.path.join(path, name)


def _in_list(path: Path) -> Iterator[str]:
    with path.open(encoding="utf-8", errors="surrogateescape") as lines:  # names of files may be any bytes
        for line in lines:
            if name := line.rstrip("\r\n"):
                yield name


def _fail(error: OSError) -> NoReturn:
    raise error
