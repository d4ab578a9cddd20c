"""Colour: a second small mapping on the same canonical points, its weights from a head behind the frozen encoder.

f_color(x), clipped to [0, 1], is the sRGB colour of the point f^k(x). The head reads what the encoder has seen
and changes nothing in it: a model's geometry is the same with colour and without.
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
START: Final = 0.45  # of each of the three colours in the mix: renders are about that much darker than materials
CELLS: Final = 16  # the image is seen as so many cells each way


def color_spec(geometry: MappingSpec) -> MappingSpec:
    """What a colour's weights mean: 1,795 numbers on three canonical dimensions."""
    return replace(geometry, name="HOF-C", hidden=(HIDDEN,), output_dim=3, activation="relu", k=1)


class ColorHead(nn.Module):
    """What `look` sees -> the weights of f_color = P^T m, a mix m(x) of three colours that are read off the image.

    The three, P, are means over the image's cells, weighted by where the head looks, and a small correction: so
    it need not know by heart what colour an object has. m: R^d -> R^3 is a mapping of f_color's own shape, whose
    last layer P turns. 1.4 million numbers for HOF-1's encoder, 2.8 MB as exported.
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

    def forward(self, seen: Tensor) -> Tensor:
        """(b, inputs) -> (b, spec.size)."""
        cells = seen[:, -3 * CELLS**2 :].reshape(-1, 3, CELLS**2)
        features = self.layers(seen)
        weights = self.where(features).unflatten(1, (3, CELLS**2)).softmax(dim=2)
        colours = weights @ cells.transpose(1, 2)  # (b, 3 colours, red green blue)
        colours = colours + self.correction(features).unflatten(1, (3, 3))
        sizes = [self.spec.size - 3 * HIDDEN - 3, 3 * HIDDEN, 3]
        first, matrix, biases = self.mix(features).split(sizes, dim=1)  # m's first layer; its last
        turn = colours.transpose(1, 2)  # P^T
        matrix = (turn @ matrix.reshape(-1, 3, HIDDEN)).reshape(-1, 3 * HIDDEN)
        biases = (turn @ biases.reshape(-1, 3, 1)).reshape(-1, 3)
        return torch.cat([first, matrix, biases], dim=1)


class ColoredEncoder(nn.Module):
    """An encoder and its colour head: an image -> theta, and the weights of f_color."""

    def __init__(self, encoder: ImageEncoder, head: ColorHead) -> None:
        super().__init__()
        self.encoder = encoder
        self.head = head

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """(b, 3, size, size) in [0, 1] -> (b, spec.size), (b, color_spec.size)."""
        theta, seen = look(self.encoder, image)
        return theta, self.head(seen)


def look(encoder: ImageEncoder, image: Tensor) -> tuple[Tensor, Tensor]:
    """theta of images (b, 3, size, size), and what a colour head reads of them (b, inputs).

    That is the trunk's features and last maps, and the mean colours of CELLS x CELLS cells: training geometry
    under any light has taught the features to forget most of an object's colour.
    """
    maps, features = encoder.look(image)
    cells = nnf.avg_pool2d(image, image.shape[-1] // CELLS)
    return encoder.head(features), torch.cat([features, maps.flatten(1), cells.flatten(1)], dim=1)


def digest(encoder: ImageEncoder) -> str:
    """sha256 of an encoder's weights: tells which one a colour head was trained on."""
    found = hashlib.sha256()
    for value in encoder.state_dict().values():
        found.update(value.contiguous().numpy().tobytes())
    return found.hexdigest()


def save(head: ColorHead, encoder: ImageEncoder, training: dict[str, Any], run: Path) -> Path:
    """Write the head beside the checkpoint that it belongs to; `training` tells steps and minutes."""
    path = run / FILE
    with whole_file(path) as file:
        torch.save({"encoder": digest(encoder), "head": head.state_dict(), "training": training}, file)
    return path


def load(run: Path, encoder: ImageEncoder, geometry: MappingSpec) -> tuple[ColorHead, dict[str, Any]] | None:
    """A run's colour head and how it was trained; None where it has none.

    Raises
    ------
    ValueError : it was trained on another checkpoint than the one that `encoder` comes from.
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
