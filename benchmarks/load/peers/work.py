"""What every peer does with a photo, by our own modules: decode, frame, infer, make the record."""

from datetime import UTC, datetime
from typing import Any

import numpy as np

from service.api.responses import EncodedObject
from service.encoding.encoder import Encoder
from service.encoding.framing import preprocess
from service.mapping.spec import Functions
from service.settings import SHIPPED_MODEL
from service.storage.ids import encoded_id
from service.storage.store import Record


class Work:
    """The shipped model with one thread."""

    def __init__(self) -> None:
        self.encoder = Encoder.open(SHIPPED_MODEL, threads=1)
        self.encoder.warm_up()

    def encode(self, image: bytes) -> tuple[Record, Functions, dict[str, Any]]:
        """A photo's bytes -> the record, its functions and what is answered."""
        return self.encode_all([image])[0]

    def encode_all(self, images: list[bytes]) -> list[tuple[Record, Functions, dict[str, Any]]]:
        """The same of several photos in one call of the encoder, for those who collect a batch."""
        encoder = self.encoder
        framed = [preprocess(image, encoder.framing) for image in images]
        found = encoder.encode(np.concatenate([one.tensor for one in framed]))
        made = []
        for image, one, functions in zip(images, framed, found, strict=True):
            object_id = encoded_id(image, one.mask, encoder.framing.foreground_ratio, encoder.digest)
            now = datetime.now(UTC)
            record = Record(object_id, "encoded", encoder.name, encoder.spec, now, color_spec=encoder.color_spec)
            answer = EncodedObject.of_image(record, one, None).model_dump(mode="json", by_alias=True, exclude_none=True)
            made.append((record, functions, answer))
        return made
