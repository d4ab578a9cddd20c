"""Encode photos in a worker process: each becomes a row, also one that cannot be encoded."""

import hashlib
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Final

from service.encoding.encoder import Encoder
from service.encoding.framing import Background, preprocess
from service.encoding.matting import Matting
from service.errors import HofError, TooLarge
from service.mapping.box import measure
from service.runtime.bulk import s3
from service.runtime.inputs.photos import photo_id, photo_record
from service.storage.rows import Entry
from service.storage.transfer.table import Item

READERS: Final = 4  # photos in S3 that are read at a time: each waits for the network, mostly


@dataclass(frozen=True)
class Setup:
    """Settings of a worker process that encodes photos.

    foreground_ratio : None for the model's.
    max_bytes, max_pixels : largest photo.
    """

    model: Path
    matting_model: Path | None
    background: Background
    foreground_ratio: float | None
    max_bytes: int
    max_pixels: int


def encode_photos(setup: Setup, sources: Sequence[str]) -> list[Item]:
    """Encode photos, one after the other, on one thread; those in S3 are read ahead on others.

    Without photos it only loads the models.

    Raises
    ------
    InvalidModel : a model has become unusable.
    ConnectionError : S3 cannot be used.
    """
    opened(setup)
    read = partial(_read, max_bytes=setup.max_bytes)
    if not any(map(s3.is_url, sources)):
        return [_encode(setup, source, partial(read, source)) for source in sources]
    with ThreadPoolExecutor(READERS) as readers:
        reads = [readers.submit(read, source) for source in sources]
        return [
            _encode(setup, source, partial(_ahead, ahead, reads, partial(read, source)))
            for source, ahead in zip(sources, reads, strict=True)
        ]


def failed(source: str, error: str, sha256: str | None = None) -> Item:
    """Return the row of a photo that cannot be encoded."""
    return Item(None, shown(source), sha256, _escaped(error))


def shown(source: str) -> str:
    """Return a path as it stands in the table: bytes that are not UTF-8 as backslash escapes, and without S3's keys."""
    return _escaped(s3.masked(source) if s3.is_url(source) else source)


def _escaped(text: str) -> str:
    return text.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


@lru_cache(1)
def opened(setup: Setup) -> tuple[Encoder, Matting | None]:
    """Return the models, loaded once in each process. Raises InvalidModel."""
    return Encoder.open(setup.model, threads=1), Matting.of(setup.matting_model, threads=1)


def _encode(setup: Setup, source: str, read: Callable[[], bytes]) -> Item:
    digest = None
    try:
        image = read()
        digest = hashlib.sha256(image).hexdigest()
        return Item(_object(setup, image), shown(source), digest)
    except HofError as error:
        return failed(source, error.detail, digest)
    except ConnectionError:  # no fault of the photo
        raise
    except OSError as error:
        return failed(source, error.strerror or str(error), digest)
    except Exception as error:  # whatever a decoder raises: the other photos are encoded all the same
        return failed(source, f"{type(error).__name__}: {error}", digest)


def _ahead(read: Future[bytes], reads: Sequence[Future[bytes]], again: Callable[[], bytes]) -> bytes:
    """Return what a reader has read, or read it again after the others: S3 is usable if it answers one of them."""
    try:
        return read.result()
    except ConnectionError:
        wait(reads)
        return again()


def _read(source: str, max_bytes: int) -> bytes:
    if s3.is_url(source):
        image = s3.read(source, max_bytes + 1)
    else:
        with open(source, "rb") as file:
            image = file.read(max_bytes + 1)
    if len(image) > max_bytes:
        raise TooLarge(f"the photo has more than {max_bytes} bytes, the limit (--max-image-bytes)")
    return image


def _object(setup: Setup, image: bytes) -> Entry:
    encoder, matting = opened(setup)
    framing = encoder.framing.with_ratio(setup.foreground_ratio)
    framed = preprocess(image, framing, setup.background, setup.max_pixels, matting)
    encoded = encoder.encode_photo(framed)
    object_id = photo_id(image, framed, framing.foreground_ratio, encoder, matting)
    box = measure(encoder.spec, encoded.theta)
    return Entry(0, photo_record(object_id, framed, encoder, encoded, box), encoded)
