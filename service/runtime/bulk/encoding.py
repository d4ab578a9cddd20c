"""Encode many photos on several processes, into one Parquet file.

The rows are in the order of the photos, whatever the number of processes. Finished rows are kept in pieces, so a run
that was stopped continues where it was. Memory holds one piece, whatever the number of photos.

Ray Data, which would run on a cluster too, was tried (2.60) and not taken: it repeats a photo that kills its worker for
ever, so one such photo stops the run; it does not continue a run that was stopped; on one machine it starts eight
processes with 537 MiB, and its servers listen on all addresses.
"""

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Final, NamedTuple

from service.errors import InvalidParameter
from service.runtime.bulk.photos import Setup, encode_photos, opened, shown
from service.runtime.bulk.pieces import Pieces
from service.runtime.bulk.sources import chunks
from service.runtime.bulk.workers import encoded
from service.storage.transfer.table import Item, schema_of

PIECE_ROWS: Final = 512


class _Listed(NamedTuple):
    """Photos of a piece, as they were listed at the start."""

    size: int
    digest: str
    is_finished: bool


def encode_many(
    setup: Setup,
    photos: Callable[[], Iterator[str]],
    path: Path,
    processes: int,
    progress: Callable[[int, int], None],
) -> tuple[int, int]:
    """Encode photos and write a table; return how many rows hold an object, and how many do not.

    Parameters
    ----------
    photos : yields the paths, in the same order each time.

    Raises
    ------
    InvalidModel : a model is unusable.
    InvalidParameter : no photos, photos that changed, a table that exists, or a run with other options to finish.
    ConnectionError : photos are in S3, which does not answer or refuses the keys.
    ChildProcessError : the processes die as they start.
    """
    encoder, _ = opened(setup)
    color = encoder.color_spec.size if encoder.color_spec else None
    pieces = Pieces(path, schema_of(encoder.spec.size, color), _run(setup))
    listed = _survey(pieces, photos())
    pieces.begin()
    missing = {number: piece for number, piece in enumerate(listed) if not piece.is_finished}
    total = sum(piece.size for piece in listed)
    done = total - sum(piece.size for piece in missing.values())
    numbered = enumerate(chunks(photos(), PIECE_ROWS))
    sources = (name for number, chunk in numbered if number in missing for name in chunk)
    with closing(encoded(partial(encode_photos, setup), sources, processes)) as rows:
        counted = _counted(rows, done, lambda count: progress(count, total))
        for number, piece in missing.items():
            items = list(islice(counted, piece.size))
            _check_unchanged(piece, items)
            pieces.write(number, items)
    count = pieces.join(len(listed))
    return total - count, count


def _survey(pieces: Pieces, photos: Iterator[str]) -> list[_Listed]:
    """Return the pieces that the photos make. Raises InvalidParameter if there are none."""
    listed: list[_Listed] = []
    for number, chunk in enumerate(chunks(photos, PIECE_ROWS)):
        names = [shown(name) for name in chunk]
        listed.append(_Listed(len(names), _digest(names), pieces.holds(number, names)))
    if not listed:
        raise InvalidParameter("there are no photos: no file has the suffix of an image, or the list is empty")
    return listed


def _counted(rows: Iterable[Item], done: int, progress: Callable[[int], None]) -> Iterator[Item]:
    """Yield rows, and tell how many are done with each."""
    for count, row in enumerate(rows, done + 1):
        progress(count)
        yield row


def _check_unchanged(piece: _Listed, items: Sequence[Item]) -> None:
    """Raise InvalidParameter if rows are not of the photos that were listed."""
    if _digest(item.source for item in items) != piece.digest:
        raise InvalidParameter("the photos changed while they were encoded: run the same command to continue")


def _digest(names: Iterable[str | None]) -> str:
    """Return a digest of the photos' names in this order."""
    return hashlib.sha256(json.dumps(list(names)).encode()).hexdigest()


def _run(setup: Setup) -> dict[str, object]:
    """Return what the rows depend on beside the photos."""
    encoder, matting = opened(setup)
    return {
        "model": encoder.digest,
        "matting_model": matting.digest if matting else None,
        "background": setup.background,
        "foreground_ratio": setup.foreground_ratio,
        "max_image_bytes": setup.max_bytes,
        "max_image_pixels": setup.max_pixels,
    }
