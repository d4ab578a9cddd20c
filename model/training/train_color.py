"""Train the color head of a trained run (`hof-model color`). The encoder's weights stay unchanged.

Drawing a batch and encoding it costs several times a step of the head. So the latest batches are kept, and each
serves several steps.
"""

import sys
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import torch
from torch import Tensor

from model.config import ON_CPU, ColorConfig, DeviceOptions, TrainConfig
from model.data.augment import WHITE_LIGHT
from model.data.dataset import Batch, draw_batch, load_examples
from model.networks.color_head import ColorHead, color_spec, look, save
from model.networks.encoder import ImageEncoder
from model.networks.mapping import power
from model.networks.ops.dispatch import nearest_index
from model.provenance import provenance
from model.training.checkpoints import chosen_checkpoint, load_encoder
from model.training.device.data import load_data
from model.training.device.draws import Draws, seed_step
from model.training.device.placement import torch_device, uses_device_loop
from model.training.losses import gather
from model.training.memory import keep_freed_memory
from model.training.optimization import set_learning_rate
from service.mapping.spec import MappingSpec

SMOOTHING: Final = 0.01  # share of a step's loss in the displayed loss
SHOW_EVERY: Final = 50  # batches drawn


@dataclass(frozen=True)
class HeadBatch:
    """A batch for the head: inputs (b, i), canonical points (b, n, d), and their colors (b, n, 3) uint8."""

    inputs: Tensor
    canonical: Tensor
    colors: Tensor


def train_color(data: Path, run: Path, config: ColorConfig, options: DeviceOptions = ON_CPU) -> Path:
    """Train a color head for the run's chosen checkpoint, write `run/color.pt` and return its path.

    Raises
    ------
    FileNotFoundError : no data set, or no checkpoint.
    ValueError : the run is not of HOF, the data set has no colors, or there is no such device.
    """
    encoder, run_config, _ = load_encoder(chosen_checkpoint(run))
    drawing = replace(
        run_config,
        seed=config.seed,
        points=config.points,
        target_points=config.target_points,
        variants=False,
        made=False,
    )
    keep_freed_memory()
    torch.manual_seed(config.seed)
    device, side = torch_device(options), drawing.framing.size
    head = ColorHead(color_spec(drawing.spec), look(encoder, torch.zeros(1, 3, side, side))[1].shape[1])
    draw, learner = _drawer(data, drawing, options), _Learner(head.to(device), config)
    encoder.to(device)
    kept = deque[HeadBatch](maxlen=config.kept_batches)
    rng, draws, elapsed_s, budget_s = np.random.default_rng(config.seed), 0, 0.0, 60 * config.minutes
    start = time.monotonic()
    while elapsed_s < budget_s:
        kept.append(observe(encoder, drawing.spec, draw(draws)))
        indices = rng.integers(len(kept), size=config.steps_per_batch - 1)
        for batch in [kept[-1], *(kept[index] for index in indices)]:
            learner.step(batch, min(1.0, elapsed_s / budget_s))
        if draws % SHOW_EVERY == 0:
            print(f"{elapsed_s:7.1f} s  {draws * drawing.batch} images  loss {learner.loss:.4f}", file=sys.stderr)
        draws += 1
        elapsed_s = time.monotonic() - start
    training = {"images": draws * drawing.batch, "minutes": round(elapsed_s / 60, 1), **provenance(config.seed)}
    return save(learner.head.cpu(), encoder.cpu(), training, run)


def _drawer(data: Path, drawing: TrainConfig, options: DeviceOptions) -> Callable[[int], Batch]:
    """Return the function that draws the batch of a step, on the device where the device loop would train."""
    if not uses_device_loop(options):
        examples = load_examples(data, "train", drawing.framing)
        return lambda step: draw_batch(examples, drawing, step, WHITE_LIGHT)
    loaded = load_data(data, drawing, options)
    draws = Draws(loaded.train, loaded.grounds, drawing)

    def draw(step: int) -> Batch:
        seed_step(drawing.seed, step)
        return draws.batch(draws.units(step), drawing.points, drawing.target_points, WHITE_LIGHT)

    return draw


@torch.no_grad()
def observe(encoder: ImageEncoder, spec: MappingSpec, batch: Batch) -> HeadBatch:
    """Encode a batch's images; a canonical point x gets the color of the true point nearest to f^k(x).

    Raises
    ------
    ValueError : the batch has no colors.
    """
    if batch.colors is None:
        raise ValueError("the data set has no colors of its points: build it again with `hof-model data build`")
    theta, inputs = look(encoder, batch.images.contiguous(memory_format=torch.channels_last))
    points = power(spec, theta, batch.canonical)
    return HeadBatch(inputs, batch.canonical, gather(batch.colors, nearest_index(points, batch.points)))


class _Learner:
    """The head, its optimizer, and the smoothed loss: mean absolute error of a channel in [0, 1]."""

    def __init__(self, head: ColorHead, config: ColorConfig) -> None:
        self.head = head.train()
        self._loss = torch.zeros((), device=next(head.parameters()).device)
        self._rate = config.learning_rate
        self._optimizer = torch.optim.AdamW(
            head.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay, fused=True
        )
        self._steps = 0

    def step(self, batch: HeadBatch, progress: float) -> None:
        """Take one step at `progress` in [0, 1] of the budget."""
        set_learning_rate(self._optimizer, self._rate, progress)
        predicted = power(self.head.spec, self.head(batch.inputs), batch.canonical)
        loss = (predicted - batch.colors / 255).abs().mean()  # not clipped: outside [0, 1] there is still a slope
        self._optimizer.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        self._optimizer.step()
        share = max(SMOOTHING, 1 / (self._steps + 1))
        self._loss += share * (loss.detach() - self._loss)
        self._steps += 1

    @property
    def loss(self) -> float:
        """The smoothed loss; reading it waits for the device."""
        return float(self._loss)
