"""Encode the photos of one object: frame each, encode all together, and average their functions.

Of the ways to make one object of several views, the mean of their thetas is the best one (PAPER.md, experiment 11).
"""

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

from service.encoding.encoder import Encoded, Encoder, merged
from service.encoding.framing import Background, Framed, Framing, preprocess
from service.errors import HofError
from service.mapping.frame import Frame
from service.mapping.spec import mean_of
from service.runtime.frames import with_box
from service.runtime.inputs.photos import photo_id
from service.runtime.parts import Runtime
from service.storage.ids import views_id

MAX_IMAGES: Final = 8  # of one object


@dataclass(frozen=True)
class Photos:
    """The photos of one object, and how to frame them.

    images : bytes of one image or several.
    keep_photo : make a thumbnail of the first one.
    """

    images: Sequence[bytes]
    framing: Framing
    background: Background
    keep_photo: bool = False


async def frame_all(runtime: Runtime, photos: Photos) -> list[Framed]:
    """Frame the photos, one after the other, so that memory holds one decoded image.

    Raises as `preprocess` does; of several photos, the error tells which one.
    """
    return [await _frame(runtime, photos, index) for index in range(len(photos.images))]


async def encode_all(runtime: Runtime, encoder: Encoder, views: Sequence[Framed]) -> tuple[Encoded, Frame]:
    """Return the functions of an object that is seen in one view or several, and the box that they fill."""
    batcher, finish = runtime.batchers[encoder.name], partial(with_box, runtime, encoder.spec)
    if len(views) == 1:
        weights = views[0].weights
        return await batcher.encode_then(views[0].looks, lambda looks: finish(merged(weights, looks)))
    encoded = (batcher.encode_then(view.looks, partial(merged, view.weights)) for view in views)
    return await runtime.run(finish, averaged(await asyncio.gather(*encoded)))


def averaged(views: Sequence[Encoded]) -> Encoded:
    """Return the functions of an object that is seen in one view or several.

    Several views have no estimates: no one camera took them.
    """
    if len(views) == 1:
        return views[0]
    mean = mean_of(views)
    return Encoded(mean.theta, mean.color)


def id_of(runtime: Runtime, encoder: Encoder, photos: Photos, views: Sequence[Framed]) -> str:
    """Return the id of the object in the photos; `views` are the photos, framed."""
    ratio = photos.framing.foreground_ratio
    ids = [
        photo_id(image, view, ratio, encoder, runtime.matting) for image, view in zip(photos.images, views, strict=True)
    ]
    return ids[0] if len(ids) == 1 else views_id(ids)


async def _frame(runtime: Runtime, photos: Photos, index: int) -> Framed:
    args = (photos.images[index], photos.framing, photos.background, runtime.settings.max_image_pixels, runtime.matting)
    thumbnail = photos.keep_photo and index == 0
    try:
        return await runtime.run_stoppable(lambda stop: preprocess(*args, stop, thumbnail=thumbnail))
    except HofError as error:
        if len(photos.images) == 1:
            raise
        raise error.prefixed(f"image {index + 1} of {len(photos.images)}") from error
