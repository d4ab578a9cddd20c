"""Color: a second small mapping on the same canonical points, its weights from a head behind the frozen encoder.

f_color(x), clipped to [0, 1], is the sRGB color of the point f^k(x). The head reads the encoder's features and
changes nothing in it: a model's geometry is the same with color and without.
"""

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import torch
import torch.nn.functional as nnf
from torch import Tensor, nn

from model.networks.encoder import ImageEncoder, ThetaHead
from service.files import whole_file
from service.mapping.spec import MappingSpec

FILE: Final = "color.pt"  # in the folder of the run that it belongs to
HIDDEN: Final = 256  # units of f_color
WIDTHS: Final = (256, 256)  # of the head
DROPOUT: Final = 0.3
RANK: Final = 128
START: Final = 0.45  # of each of the three colors in the mix, since renders are darker than materials
CELLS: Final = 16  # cells along each side of the image


def color_spec(geometry: MappingSpec) -> MappingSpec:
    """Return the spec of f_color: 1,795 numbers on three canonical dimensions."""
    return replace(geometry, name="HOF-C", hidden=(HIDDEN,), output_dim=3, activation="relu", k=1)


class ColorHead(nn.Module):
    """Inputs of `look` -> the weights of f_color = P^T m, a mix m(x) of three colors taken from the image.

    The three colors P are means over the image's cells, weighted by attention, plus a small correction: the head need
    not remember the colors of objects. m: R^d -> R^3 is a mapping of f_color's own shape, whose last layer P
    multiplies. 1.4 million numbers for HOF-1's encoder, 2.8 MB as exported.
    """

    def __init__(self, spec: MappingSpec, inputs: int) -> None:
        super().__init__()
        self.spec = spec
        layers: list[nn.Module] = [nn.BatchNorm1d(inputs, affine=False)]
        for width in WIDTHS:
            layers += [nn.Linear(inputs, width), nn.ReLU(), nn.Dropout(DROPOUT)]
            inputs = width
        self.layers = nn.Sequential(*layers, nn.Linear(inputs, RANK), nn.LayerNorm(RANK))
        self.mix = ThetaHead(spec, RANK)
        self.mix.theta_0[-3:] += START
        self.where = nn.Linear(RANK, 3 * CELLS**2)
        self.correction = nn.Linear(RANK, 9)
        nn.init.zeros_(self.correction.weight)
        nn.init.zeros_(self.correction.bias)

    def forward(self, head_inputs: Tensor) -> Tensor:
        """Return the color's weights: (b, inputs) -> (b, spec.size)."""
        cells = head_inputs[:, -3 * CELLS**2 :].reshape(-1, 3, CELLS**2)
        features = self.layers(head_inputs)
        weights = self.where(features).unflatten(1, (3, CELLS**2)).softmax(dim=2)
        colors = weights @ cells.transpose(1, 2)  # (b, 3 colors, red green blue)
        colors = colors + self.correction(features).unflatten(1, (3, 3))
        sizes = [self.spec.size - 3 * HIDDEN - 3, 3 * HIDDEN, 3]
        first, matrix, biases = self.mix(features).split(sizes, dim=1)  # m's first layer; its last
        transposed = colors.transpose(1, 2)  # P^T
        matrix = (transposed @ matrix.reshape(-1, 3, HIDDEN)).reshape(-1, 3 * HIDDEN)
        biases = (transposed @ biases.reshape(-1, 3, 1)).reshape(-1, 3)
        return torch.cat([first, matrix, biases], dim=1)


class ColoredEncoder(nn.Module):
    """An encoder and its color head: an image -> theta and the weights of f_color."""

    def __init__(self, encoder: ImageEncoder, head: ColorHead) -> None:
        super().__init__()
        self.encoder = encoder
        self.head = head

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """Return theta and color: (b, 3, size, size) in [0, 1] -> (b, spec.size), (b, color_spec.size)."""
        theta, head_inputs = look(self.encoder, image)
        return theta, self.head(head_inputs)


def look(encoder: ImageEncoder, image: Tensor) -> tuple[Tensor, Tensor]:
    """Return theta of images (b, 3, size, size), and the color head's inputs (b, inputs).

    The inputs are the trunk's features and last maps, and the mean colors of CELLS x CELLS cells: trained for geometry
    under any light, the features keep little of an object's color.
    """
    maps, features = encoder.look(image)
    cells = nnf.avg_pool2d(image, image.shape[-1] // CELLS)
    return encoder.head(features), torch.cat([features, maps.flatten(1), cells.flatten(1)], dim=1)


def digest(encoder: ImageEncoder) -> str:
    """Return the sha256 of an encoder's weights, by which a color head names its encoder."""
    result = hashlib.sha256()
    for value in encoder.state_dict().values():
        result.update(value.contiguous().numpy().tobytes())
    return result.hexdigest()


def save(head: ColorHead, encoder: ImageEncoder, training: dict[str, Any], run: Path) -> Path:
    """Write the head beside its checkpoint and return the path; `training` is for the model card."""
    path = run / FILE
    with whole_file(path) as file:
        torch.save({"encoder": digest(encoder), "head": head.state_dict(), "training": training}, file)
    return path


def load(run: Path, encoder: ImageEncoder, geometry: MappingSpec) -> tuple[ColorHead, dict[str, Any]] | None:
    """Return a run's color head and its training for the card; None where the run has no head.

    Raises
    ------
    ValueError : the head was trained on another encoder than `encoder`.
    """
    path = run / FILE
    if not path.exists():
        return None
    saved = torch.load(path, weights_only=True)
    if saved["encoder"] != digest(encoder):
        raise ValueError(f"{path} belongs to another checkpoint: run `hof-model color --run {run}` again")
    head = ColorHead(color_spec(geometry), len(saved["head"]["layers.0.running_mean"]))
    head.load_state_dict(saved["head"])
    return head.eval(), saved["training"]
