"""Objects of photos: ids and records, the same for the API and for `hof encode-many`, and recent photos."""

import hashlib
from collections import OrderedDict
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Final, NamedTuple

from service.encoding.encoder import Encoded, Encoder
from service.encoding.framing import Background, Framed
from service.encoding.matting import Matting
from service.encoding.report import ImageReport
from service.mapping.frame import Frame
from service.storage.ids import encoded_id
from service.storage.rows import Record

RECENT_PHOTOS: Final = 4096  # about 700 bytes each, and 350 for each further view

PhotoKey = tuple[bytes, str, Background, float]


def photo_id(image: bytes, framed: Framed, foreground_ratio: float, encoder: Encoder, matting: Matting | None) -> str:
    """Return the id of the object of a photo: a digest of its bytes, its framing, and the models that it needed."""
    models = [encoder.digest]
    if framed.mask == "matting" and matting:
        models.append(matting.digest)
    return encoded_id(image, framed.mask, foreground_ratio, *models)


def photo_record(
    object_id: str, framed: Framed, encoder: Encoder, encoded: Encoded, box: Frame, label: str | None = None
) -> Record:
    """Return the record of the object of a photo, created now."""
    return Record(
        object_id,
        "encoded",
        encoder.name,
        encoder.spec,
        datetime.now(UTC),
        color_spec=encoder.color_spec,
        frame=box,
        image=ImageReport.of(framed),
        estimates=encoded.estimates.rounded() if encoded.estimates else None,
        label=label,
        has_photo=framed.thumbnail is not None,
    )


def photo_key(images: Sequence[bytes], encoder: Encoder, background: Background, foreground_ratio: float) -> PhotoKey:
    """Return what decides on the object of photos in one process: their bytes, the model and the options."""
    digests = b"".join(hashlib.sha256(image).digest() for image in images)
    return digests, encoder.digest, background, foreground_ratio


class RecentPhoto(NamedTuple):
    """The object of a photo, or of several views of one object, and the report on each."""

    object_id: str
    reports: tuple[ImageReport, ...]


class RecentPhotos:
    """Objects of recent photos, so that a repeat needs no decoding. The longest unused one is dropped."""

    def __init__(self, size: int = RECENT_PHOTOS) -> None:
        self._size = size
        self._photos: OrderedDict[PhotoKey, RecentPhoto] = OrderedDict()

    def __len__(self) -> int:
        return len(self._photos)

    def find(self, key: PhotoKey) -> RecentPhoto | None:
        """Return a photo's object, which may have been deleted since; None for an unknown photo."""
        photo = self._photos.get(key)
        if photo is not None:
            self._photos.move_to_end(key)
        return photo

    def keep(self, key: PhotoKey, photo: RecentPhoto) -> None:
        """Remember the object of a photo."""
        self._photos[key] = photo
        self._photos.move_to_end(key)
        if len(self._photos) > self._size:
            self._photos.popitem(last=False)
