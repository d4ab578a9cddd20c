"""Measure encoders of points: parts of surfaces in, whole objects out, along the path of a user's points.

`service.encoding.clouds` normalizes a part and the ONNX file gives theta; the points of its function go back to the
frame of the part, and are compared with the true ones there. Distances are in longest sides of the whole object.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
import torch

from model.data.manifest import Split
from model.data.rendering.partial import fixed_parts
from model.evaluation.evaluate import PREDICTED_POINTS, Case, Evaluation, Floats, cases, draw, measure_objects
from model.metrics import NAMES, compare
from service.encoding.clouds import normalize
from service.encoding.encoder import Encoder

PARTS: Final = 4  # of each object

Part = Callable[[Case, int], Floats]  # an object and the number of the part -> points of it (n, 3), object frame


def complete(encoder: Encoder, part: Floats, n: int = PREDICTED_POINTS) -> Floats:
    """Return n points of the whole object, in the frame and the unit of the part (m, 3)."""
    sent = normalize(part, encoder.count or len(part))
    points = draw(encoder.spec, encoder.encode(sent.tensor)[0].theta, n)
    completed: Floats = (points * sent.scale + np.array(sent.center)).astype(np.float32)
    return completed


def training_part(case: Case, number: int) -> Floats:
    """Return a part as in training: on one side of a plane or seen by a camera, 64 to 2,048 noisy points."""
    parts = fixed_parts(torch.from_numpy(case.points)[None], number)
    points: Floats = (parts.clouds * parts.scale + parts.center)[0].numpy()
    return np.unique(points, axis=0)  # parts repeat their points


def measure_completion(
    encoder: Encoder, data: Path, split: Split, seed: int = 0, part: Part = training_part
) -> Evaluation:
    """Measure an encoder of points on PARTS parts of every object of a split.

    Raises
    ------
    FileNotFoundError : `data` holds no finished data set.
    """

    def figures(case: Case) -> dict[str, float]:
        each = [compare(complete(encoder, part(case, seed + number)), case.points) for number in range(PARTS)]
        return {name: float(np.mean([one[name] for one in each])) for name in NAMES}

    return measure_objects(encoder.name, figures, list(cases(data, split)))
