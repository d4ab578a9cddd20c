"""Train the heads of a finished encoder on observations of it (`hof-model heads`).

The members of the confidence are trained on all objects but a share of their own; on these shares together their
answers are calibrated, so that an expected F@2% of 0.5 is right on the mean for objects that nothing was trained on.
"""

from collections.abc import Callable, Iterator
from typing import Final

import numpy as np
import numpy.typing as npt
import torch
import torch.nn.functional as nnf
from torch import Tensor, nn

from model.config import HeadsConfig
from model.networks.estimate_heads import BINS, REST, EstimateHeads, pool
from model.networks.observations import TURNS_DEG, Observations

Rows = npt.NDArray[np.int64]

QUARTERS_DEG: Final = (90, 180, 270)  # turns after which a symmetric object counts as well
KERNEL: Final = 12.0  # sharpness of the azimuth's target: about 17 degrees
CALIBRATION_STEPS: Final = 300


def train_heads(observations: Observations, config: HeadsConfig) -> EstimateHeads:
    """Return heads trained on all observations, in evaluation mode.

    Raises
    ------
    ValueError : no observation has a score or a camera.
    """
    torch.manual_seed(config.seed)
    sizes = {name: array.shape[1:] for name, array in observations.inner.items()}
    heads = EstimateHeads(sizes, config.members)
    tensors = [torch.from_numpy(array.astype(np.float32)) for array in observations.inner.values()]
    inputs = pool(tensors)
    scored = np.flatnonzero(~np.isnan(observations.scores))
    posed = np.flatnonzero(~np.isnan(observations.cameras[:, 1]))
    if not len(scored) or not len(posed):
        raise ValueError("there is nothing to learn from: no object that the encoder was not trained on, or no camera")
    heads.normalize_by(inputs[posed])
    inputs = heads.normalize(inputs)
    _train_confidences(heads, heads.narrow(inputs), observations, scored, config)
    _train_cameras(heads, inputs, observations, posed, config)
    return heads.eval()


def _train_confidences(
    heads: EstimateHeads, inputs: Tensor, observations: Observations, scored: Rows, config: HeadsConfig
) -> None:
    """Train each member without its share of the objects, then calibrate all of them on these shares."""
    scores = torch.from_numpy(observations.scores)
    rng = np.random.default_rng(config.seed)
    shares = rng.integers(config.members, size=len(observations.ids) + 1)[observations.objects]
    strange = observations.objects < 0
    shares[strange] = rng.integers(config.members, size=int(strange.sum()))
    logits = torch.zeros(len(scores))
    for number, member in enumerate(heads.confidences):
        own = shares[scored] == number

        def loss(rows: Tensor, member: nn.Module = member) -> Tensor:
            return nnf.mse_loss(torch.sigmoid(member(inputs[rows])[:, 0]), scores[rows])

        rows = scored if own.all() else scored[~own]
        _train(member, loss, rows, config)
        with torch.no_grad():
            held = torch.from_numpy(scored[own])
            logits[held] = member.eval()(inputs[held])[:, 0]
    rows = torch.from_numpy(scored)
    heads.calibration.copy_(calibrate(logits[rows], scores[rows]))


def calibrate(logits: Tensor, scores: Tensor) -> Tensor:
    """Return (a, b) so that sigmoid(a + b * logit) has the least squared error to scores: (n,), (n,) -> (2,)."""
    parameters = torch.tensor([0.0, 1.0], requires_grad=True)
    optimizer = torch.optim.Adam([parameters], lr=0.05)
    for _ in range(CALIBRATION_STEPS):
        optimizer.zero_grad()
        loss = nnf.mse_loss(torch.sigmoid(parameters[0] + parameters[1] * logits), scores)
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
    return parameters.detach()


def _train_cameras(
    heads: EstimateHeads, inputs: Tensor, observations: Observations, posed: Rows, config: HeadsConfig
) -> None:
    """Train the members of the camera on all images of one object; an azimuth counts where it is known and unique."""
    targets, counts = azimuth_targets(observations)
    cameras = observations.cameras[:, 1:].copy()
    cameras[:, 1] = np.log(cameras[:, 1])
    rest = torch.from_numpy(cameras)
    heads.rest_mean.copy_(rest[posed].mean(dim=0))
    heads.rest_spread.copy_(rest[posed].std(dim=0).clamp(min=1e-2))
    rest = (rest - heads.rest_mean) / heads.rest_spread
    for member in heads.cameras:

        def loss(rows: Tensor, member: nn.Module = member) -> Tensor:
            bins, others = torch.split(member(inputs[rows]), [BINS, REST], dim=1)
            entropy = -(targets[rows] * bins.log_softmax(dim=1)).sum(dim=1)
            total: Tensor = (entropy * counts[rows]).mean() + nnf.smooth_l1_loss(others, rest[rows])
            return total

        _train(member, loss, posed, config)
        member.eval()


def azimuth_targets(observations: Observations) -> tuple[Tensor, Tensor]:
    """Return the target distributions over the azimuth's bins (n, BINS), and 1.0 where they count, else 0.0: (n,).

    An object that is the same after a quarter or half turn has as many azimuths; a round one has none.
    """
    symmetric = observations.symmetric()
    has_azimuth = ~np.isnan(observations.cameras[:, 0])
    azimuths = np.nan_to_num(observations.cameras[:, 0])
    centers = np.arange(BINS) * (360 / BINS)
    targets = np.zeros((len(azimuths), BINS))
    for turn in (0, *QUARTERS_DEG):
        counts = symmetric[:, TURNS_DEG.index(turn)] if turn else np.ones(len(azimuths), bool)
        away = np.radians(azimuths[:, None] + turn - centers)
        targets += counts[:, None] * np.exp(KERNEL * (np.cos(away) - 1))
    targets /= targets.sum(axis=1, keepdims=True)
    counts = has_azimuth & ~symmetric.all(axis=1)
    return torch.from_numpy(targets.astype(np.float32)), torch.from_numpy(counts.astype(np.float32))


def _train(member: nn.Module, loss: Callable[[Tensor], Tensor], rows: Rows, config: HeadsConfig) -> None:
    """Train a member on rows, with one cycle of the learning rate."""
    steps = max(1, round(config.epochs * len(rows) / config.batch))
    optimizer = torch.optim.AdamW(member.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, config.learning_rate, total_steps=steps + 1)
    member.train()
    for batch in _batches(rows, steps, config.batch):
        optimizer.zero_grad()
        loss(batch).backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        schedule.step()


def _batches(rows: Rows, steps: int, batch: int) -> Iterator[Tensor]:
    """Yield random batches of rows."""
    choices = torch.from_numpy(rows)
    for _ in range(steps):
        yield choices[torch.randint(len(choices), (batch,))]
