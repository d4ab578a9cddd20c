"""Encode many photos on several processes, into one Parquet file.

The rows are in the order of the photos, whatever the number of processes. Finished rows are kept in pieces, so a run
that was stopped continues where it was. Memory holds one piece, whatever the number of photos.

Ray Data, which would run on a cluster too, was tried (2.60) and not
taken: it repeats a photo that kills its worker for ever, so one such photo stops the run; it does not continue a run
that was stopped; on one machine it starts eight processes with 537 MiB, and its servers listen on all addresses.
"""

from collections.abc import Callable, Iterator
from contextlib import closing
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Final

from service.errors import InvalidParameter
from service.runtime.bulk.photos import Setup, encode_photos, opened, shown
from service.runtime.bulk.pieces import Pieces
from service.runtime.bulk.sources import chunks
from service.runtime.bulk.workers import encoded
from service.storage.transfer.table import schema_of

PIECE_ROWS: Final = 512


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
    InvalidParameter : there are no photos, the table exists already, or a run with other options was not finished.
    ConnectionError : photos are in S3, which does not answer or refuses the keys.
    ChildProcessError : the processes die as they start.
    """
    encoder, _ = opened(setup)
    color = encoder.color_spec.size if encoder.color_spec else None
    pieces = Pieces(path, schema_of(encoder.spec.size, color), _run(setup))
    sizes, missing = _survey(pieces, photos())
    pieces.begin()
    total, wanted = sum(sizes), set(missing)
    done = total - sum(sizes[number] for number in missing)
    listed = enumerate(chunks(photos(), PIECE_ROWS))
    sources = (name for number, chunk in listed if number in wanted for name in chunk)
    with closing(encoded(partial(encode_photos, setup), sources, processes)) as rows:
        for number in missing:
            items = []
            for item in islice(rows, sizes[number]):
                items.append(item)
                done += 1
                progress(done, total)
            pieces.write(number, items)
    count = pieces.join(len(sizes))
    return total - count, count


def _survey(pieces: Pieces, photos: Iterator[str]) -> tuple[list[int], list[int]]:
    """Return the number of photos of each piece, and the numbers of the pieces that are not finished."""
    sizes: list[int] = []
    missing: list[int] = []
    for number, names in enumerate(chunks(photos, PIECE_ROWS)):
        sizes.append(len(names))
        if not pieces.holds(number, [shown(name) for name in names]):
            missing.append(number)
    if not sizes:
        raise InvalidParameter("there are no photos: no file has the suffix of an image, or the list is empty")
    return sizes, missing


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
