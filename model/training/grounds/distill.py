"""Distill an exported encoder (`hof-model distill`): it learns to answer with a background as it does over white.

The teacher is the encoder as it was. Its features and maps of a view over white, and the points of its theta, are what
the encoder should answer to the same view in front of a background: to the picture as it is, or as the service frames
it, most often with a mask of a matte network, right or wrong. What reads the features stays as it is: theta's last
layer, the color head, the heads of the estimates.
"""

import copy
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from model.config import DistillConfig, TrainConfig
from model.data.augment import augment
from model.data.dataset import Examples, draw_views, load_examples, plain_images
from model.networks.encoder import ImageEncoder, LiteMaps, channels_last
from model.networks.mapping import power
from model.training.checkpoints import load_encoder
from model.training.grounds.learner import Batch, Learner, learn, load_average
from model.training.memory import keep_freed_memory
from service.encoding.encoder import Encoder
from service.encoding.framing import Framing, frame
from service.encoding.masks import MattingFunction
from service.encoding.pixels import over_white
from service.errors import NoObjectFound
from service.mapping.canonical import canonical_points
from service.mapping.spec import MappingSpec

SHARES: Final = (0.2, 0.07, 0.08, 0.15, 0.7)  # over white; of the others: flat color, gradient, texture, photographs
FRAMED_SHARE: Final = 0.5  # of the images are framed as by the service, most with a mask of the matte network
WHITE: Final = 0.97  # the least level of the first rows of an image over white
POINTS: Final = 300  # canonical points at which the thetas of teacher and student are compared
POINTS_WEIGHT: Final = 10.0  # of the points' mean distance, in sides of the object
FEATURES_WEIGHT: Final = 0.2  # of the features' relative error
MAPS_WEIGHT: Final = 0.06
CHECKED: Final = 4  # batches of validation objects


def distill(data: Path, model: Path, run: Path, config: DistillConfig, matting: MattingFunction) -> Path:
    """Train within `config.minutes` and return the path of the checkpoint, `run/last.pt`; an existing run is resumed.

    Raises
    ------
    FileNotFoundError : `data` lacks the objects, `hof-model data vary` or `hof-model data make`.
    ValueError : `model` is not of `hof-model export`, its trunk is another than lite0, or the run is of another model.
    """
    run.mkdir(parents=True, exist_ok=True)
    teacher, trained, _ = load_encoder(model)
    drawing = replace(trained, batch=config.batch, seed=config.seed, variants=True, made=True)
    student = prepared(teacher)
    teacher.requires_grad_(requires_grad=False).to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    examples = load_examples(data, "train", drawing.framing, variants=True, pieces=True)
    unseen = load_examples(data, "val", drawing.framing)
    keep_freed_memory()

    def draw(step: int, of: Examples = examples) -> Batch:
        images, plain = draw_pairs(of, drawing, step, matting)
        return images, answers(teacher, plain)

    checked = [draw(step, unseen) for step in range(CHECKED)]
    loss = DistillLoss(teacher, trained.spec, torch.cat([expected for _, expected in checked]))
    learner = Learner(student, loss, config, run / "last.pt", origin=Encoder.open(model, threads=1).digest)

    @torch.no_grad()
    def check(average: ImageEncoder) -> dict[str, float]:
        return {"error": float(np.mean([float(loss(average, *batch)) for batch in checked]))}

    return learn(learner, run, draw, check, threads=2)


def load_distilled(model: Path, checkpoint: Path) -> tuple[ImageEncoder, TrainConfig, dict[str, Any]]:
    """Return the averaged encoder of a checkpoint, its config, and how long it was distilled: steps and minutes.

    Raises
    ------
    FileNotFoundError : there is no such file.
    """
    encoder, config, _ = load_encoder(model)
    return encoder, config, load_average(encoder, checkpoint)


def prepared(teacher: ImageEncoder) -> ImageEncoder:
    """Return a copy of an encoder to train: without dropout, theta's last layer frozen.

    Raises
    ------
    ValueError : its trunk is another than lite0.
    """
    student = copy.deepcopy(teacher)
    if not isinstance(student.features, LiteMaps):
        raise ValueError("the model's trunk is not lite0: only such an encoder can be distilled")  # noqa: TRY004
    student.features.dropout = 0.0
    student.head.requires_grad_(requires_grad=False)
    return student


@torch.no_grad()
def answers(encoder: ImageEncoder, images: Tensor) -> Tensor:
    """Return features and maps of images, side by side: (b, 3, s, s) -> (b, width + maps)."""
    return _answers(encoder, images)


def _answers(encoder: ImageEncoder, images: Tensor) -> Tensor:
    maps, features = encoder.look(channels_last(images))
    return torch.cat([features, maps.flatten(1)], dim=1)


class DistillLoss:
    """The errors of features and maps, each over its variance, and the distance between the points of both thetas."""

    def __init__(self, teacher: ImageEncoder, spec: MappingSpec, sample: Tensor) -> None:
        """Take the variances of a teacher's answers (n, width + maps)."""
        self._head, self._spec, self._width = teacher.head, spec, teacher.width
        self._points = torch.from_numpy(canonical_points(spec.domain, POINTS, 0))
        self._parts = [
            (part, weight / sample[:, part].var(dim=0).mean())
            for part, weight in ((slice(self._width), FEATURES_WEIGHT), (slice(self._width, None), MAPS_WEIGHT))
        ]

    def __call__(self, student: ImageEncoder, images: Tensor, expected: Tensor) -> Tensor:
        """Return the loss of images (b, 3, s, s), for which the teacher answers `expected`."""
        answered = _answers(student, images)
        errors = (answered - expected).square()
        drawn, true = (self._drawn(each[:, : self._width]) for each in (answered, expected))
        parts = [scale * errors[:, part].mean() for part, scale in self._parts]
        return torch.stack([POINTS_WEIGHT * (drawn - true).norm(dim=2).mean(), *parts]).sum()

    def _drawn(self, features: Tensor) -> Tensor:
        """Return the points of features (b, width): (b, POINTS, 3)."""
        points = self._points.expand(len(features), -1, -1).contiguous()
        return power(self._spec, self._head(features), points)


def draw_pairs(
    examples: Examples, config: TrainConfig, step: int, matting: MattingFunction | None
) -> tuple[Tensor, Tensor]:
    """Return views in front of backgrounds, and the same views over white: (b, 3, size, size) in [0, 1] each."""
    rng = np.random.default_rng([config.seed, step])
    crops = np.stack([shape.crops[view] for shape, view in draw_views(examples, config, step, rng)])
    views, size = torch.from_numpy(crops), config.framing.size
    images = augment(views.permute(0, 3, 1, 2), size, rng, examples.photographs, shares=SHARES)
    plain = plain_images(views, size)
    if matting:
        for index in np.flatnonzero(rng.random(len(images)) < FRAMED_SHARE):
            images[index] = _matted(images[index], config.framing, matting)
    mirrored = torch.from_numpy(rng.random(len(images)) < 0.5)
    images[mirrored], plain[mirrored] = images[mirrored].flip(3), plain[mirrored].flip(3)
    return images, plain


def _matted(image: Tensor, framing: Framing, matting: MattingFunction) -> Tensor:
    """Return an image (3, s, s) as the service frames it; unchanged if it is over white or has no mask."""
    if float(image[:, :3].min()) > WHITE:
        return image
    picture = Image.fromarray((255 * image.permute(1, 2, 0)).round().to(torch.uint8).numpy())
    try:
        return torch.from_numpy(over_white(frame(picture, framing, "auto", matting).rgba)[0])
    except NoObjectFound:
        return image
