"""Train the matte network (`hof-model matte`): pictures made at each step, and which of their pixels are object."""

from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
import torch.nn.functional as nnf
from torch import Tensor, nn

from model.config import MatteConfig
from model.data.manifest import Manifest, Split, piece_files, variant_files
from model.data.rendering.composites import Composites
from model.data.sources.photographs import photograph_files, scenery_files, surface_files
from model.networks.encoder import channels_last
from model.networks.matte import MatteNetwork
from model.training.grounds.learner import Batch, Learner, learn, load_average
from model.training.memory import keep_freed_memory

OWN_VIEWS: Final = 8  # of each object, evenly spread over its ring
VARIANTS: Final = 4  # of each object, its free cameras among them
CHECKED: Final = 256  # pictures of validation objects
OVERLAP_WEIGHT: Final = 0.5  # of the overlap's loss, beside the cross entropy


def train_matte(data: Path, run: Path, config: MatteConfig) -> Path:
    """Train within `config.minutes` and return the path of the checkpoint, `run/last.pt`; an existing run is resumed.

    Raises
    ------
    FileNotFoundError : `data` lacks the objects, `hof-model data vary` or `hof-model data make`.
    """
    run.mkdir(parents=True, exist_ok=True)
    checkpoint = run / "last.pt"
    torch.manual_seed(config.seed)
    network = MatteNetwork() if checkpoint.exists() else MatteNetwork.pretrained()
    learner = Learner(network, _loss, config, checkpoint, {network.trunk: config.pretrained_rate})
    composites = load_composites(data, "train")
    checked = load_composites(data, "val").draw(CHECKED, config.size, np.random.default_rng(config.seed))
    keep_freed_memory()

    def draw(step: int) -> Batch:
        return composites.draw(config.batch, config.size, np.random.default_rng([config.seed, step]))

    def check(average: nn.Module) -> dict[str, float]:
        return {"overlap": overlap(average, checked)}

    return learn(learner, run, draw, check)


def load_matte(checkpoint: Path) -> tuple[MatteNetwork, dict[str, Any]]:
    """Return the averaged network of a checkpoint, in evaluation, and how long it was trained: steps and minutes.

    Raises
    ------
    FileNotFoundError : there is no such file.
    """
    network = MatteNetwork().eval()
    return network, load_average(network, checkpoint)


def load_composites(data: Path, split: Split) -> Composites:
    """Load views of a split's objects; of the training split also those of its variants, and all pieces.

    Raises
    ------
    FileNotFoundError : the data set, its variants or its pieces are missing.
    """
    views = []
    for entry in Manifest.read(data).of(split):
        with np.load(data / entry.file) as arrays:
            ring = arrays["views"]
        views.append(ring[:: max(1, len(ring) // OWN_VIEWS)])
        if split == "train":
            views += [_views(path) for path in variant_files(data, entry)[:VARIANTS]]
    if split == "train":
        views += [_views(path) for path in piece_files(data)]
    return Composites(np.concatenate(views), photograph_files(data), scenery_files(data), surface_files(data))


def _views(path: Path) -> Any:  # noqa: ANN401 - (n, S, S, 4) uint8
    with np.load(path) as arrays:
        return arrays["views"]


def matte_loss(logits: Tensor, mattes: Tensor) -> Tensor:
    """Return the mean cross entropy, and OVERLAP_WEIGHT of what soft masks lack of a whole overlap.

    Parameters
    ----------
    logits, mattes : (b, 1, s, s); mattes in [0, 1].
    """
    soft = logits.sigmoid()
    both, either = (soft * mattes).sum((1, 2, 3)), (soft + mattes - soft * mattes).sum((1, 2, 3))
    lacking = 1 - (both + 1) / (either + 1)
    return nnf.binary_cross_entropy_with_logits(logits, mattes) + OVERLAP_WEIGHT * lacking.mean()


def _loss(network: nn.Module, images: Tensor, mattes: Tensor) -> Tensor:
    return matte_loss(network(channels_last(images)), mattes)


@torch.no_grad()
def overlap(network: nn.Module, checked: Batch) -> float:
    """Return the mean intersection over union of masks and mattes above one half; that of two empty ones is 1."""
    images, mattes = checked
    masks = torch.cat([network(channels_last(part)) for part in images.chunk(max(1, len(images) // 32))]) > 0
    true = mattes > 0.5
    both, either = (masks & true).sum((1, 2, 3)), (masks | true).sum((1, 2, 3))
    return float(((both + 1) / (either + 1)).mean())
