"""Work of every peer on a photo, by the service's modules: decode, frame, infer, measure the box, make the record."""

from typing import Any

import numpy as np

from service.api.responses.objects import EncodedObject
from service.encoding.encoder import Encoder
from service.encoding.framing import preprocess
from service.encoding.report import ImageReport
from service.mapping.box import examine
from service.mapping.sampler import hold_blas_to_one_thread
from service.mapping.spec import Functions
from service.runtime.inputs.photos import photo_id, photo_record
from service.settings import SHIPPED_MODEL
from service.storage.rows import Record


class Work:
    """The shipped model on one thread."""

    def __init__(self) -> None:
        self.encoder = Encoder.open(SHIPPED_MODEL, threads=1)
        self.encoder.warm_up()
        hold_blas_to_one_thread()

    def encode(self, image: bytes) -> tuple[Record, Functions, dict[str, Any]]:
        """Return the record, the functions and the answer for a photo's bytes."""
        return self.encode_all([image])[0]

    def encode_all(self, images: list[bytes]) -> list[tuple[Record, Functions, dict[str, Any]]]:
        """Encode several photos in one call; record, functions and answer of each."""
        encoder = self.encoder
        framed = [preprocess(image, encoder.framing) for image in images]
        functions_of_each = encoder.encode(np.concatenate([one.tensor for one in framed]))
        objects: list[tuple[Record, Functions, dict[str, Any]]] = []
        for image, one, functions in zip(images, framed, functions_of_each, strict=True):
            object_id = photo_id(image, one, encoder.framing.foreground_ratio, encoder, None)
            record = photo_record(object_id, one, encoder, functions, examine(encoder.spec, functions))
            answer = EncodedObject.of_image(record, [ImageReport.of(one)], None)
            fields = answer.model_dump(mode="json", by_alias=True, exclude_none=True)
            objects.append((record, functions, fields))
        return objects
