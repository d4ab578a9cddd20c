"""Train g_phi end to end through f_theta, or a method it is compared with: one run, one folder, resumable."""

import copy
import os
import time
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, TextIO

import numpy as np
import numpy.typing as npt
import torch
import torch.nn.functional as nnf
from torch import Tensor, nn
from tqdm import tqdm

from model.config import TrainConfig
from model.data.dataset import Batch, Examples, draw_batch, load_examples, plain_images
from model.metrics import compare
from model.networks.decoders import make_network
from model.networks.lite0 import Lite0, load_imagenet
from model.training.average import update_average
from model.training.checkpoints import chosen_checkpoint, load_network
from model.training.log import cut_log, log_line
from model.training.losses import chamfer, late_chamfer, projection
from model.training.memory import keep_freed_memory
from service.files import whole_file
from service.mapping.canonical import canonical_points

CHECKPOINT_EVERY_S: Final = 600.0
LOG_EVERY: Final = 50  # steps
WARMUP: Final = 0.02  # of the budget
LATE_SCALE: Final = 0.125  # its gradient becomes as large as the squared loss's, which Adam is used to
VALIDATION_VIEWS: Final = (1, 13)  # of 24: from the front, a little to the side, and from behind
VALIDATION_POINTS: Final = 2_000  # predicted
VALIDATION_TARGET_POINTS: Final = 4_000

Weights = dict[str, Tensor]


def train(data: Path, run: Path, config: TrainConfig) -> Path:
    """Train within the budget of `config.minutes` or `config.steps` and return the path of the chosen checkpoint.

    A run folder that holds a checkpoint is resumed with the config stored there; the batches go on where
    they stopped, since each is a function of (seed, step) alone.

    Raises
    ------
    FileNotFoundError : `data` holds no finished data set, or `config.start` is no file.
    ValueError : no budget, or `config.start` holds another kind of network or none.
    """
    if (config.minutes if config.steps is None else config.steps) <= 0:
        raise ValueError("the budget, minutes or steps, must be above 0")
    run.mkdir(parents=True, exist_ok=True)
    state = _State.resume(run, config) if (run / "last.pt").exists() else _State.begin(config)
    examples = load_examples(data, "train", state.config.framing, state.config.variants, state.config.made)
    validation = load_examples(data, "val", state.config.framing, variants=False)
    keep_freed_memory()  # not before: what loading frees lies scattered, and steps in it take a fifth longer
    with (
        _computing(state.parts) as threads,
        _computing(1, threads_each=1) as loader,
        (run / "log.jsonl").open("a", encoding="utf-8") as log,
        tqdm(total=1_000, initial=round(1_000 * state.progress), unit=" thousandths", desc="train") as bar,
    ):
        started, saved = time.monotonic() - state.elapsed_s, time.monotonic()
        coming = loader.submit(draw_batch, examples, _sizes(state.config, state.progress), state.step)
        losses: deque[float] = deque(maxlen=LOG_EVERY)
        while state.progress < 1:
            batch, progress = coming.result(), state.progress
            coming = loader.submit(draw_batch, examples, _sizes(state.config, progress), state.step + 1)
            losses.append(_step(state, batch, progress, threads))
            state.elapsed_s = time.monotonic() - started
            if state.step % LOG_EVERY == 0:
                _tell(log, bar, state, {"loss": sum(losses) / len(losses)})
            if time.monotonic() - saved > CHECKPOINT_EVERY_S or state.progress >= 1:
                figures = validate(state.average, state.config, validation)
                _tell(log, bar, state, figures)
                state.save(run, figures["f@1%"] + figures["f@2%"])
                saved = time.monotonic()
    return chosen_checkpoint(run)


class _State:
    """What a run carries from step to step, and to its checkpoint.

    average : the network with the exponential moving average of all weights and buffers: what is
        validated and exported.
    parts : how many cores share a batch, each with a part of it; one where its images are normalised together.
    before : steps and seconds of the runs that this one started from.
    best : the highest sum of F@1% and F@2% on the validation split so far.
    """

    def __init__(self, config: TrainConfig) -> None:
        torch.manual_seed(config.seed)
        self.config = config
        self.step = 0
        self.elapsed_s = 0.0
        self.before = {"step": 0, "elapsed_s": 0.0}
        self.best = -1.0
        self.network = make_network(config)
        self.network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        normalised = any(isinstance(part, nn.BatchNorm2d) for part in self.network.modules())
        self.parts = 1 if normalised else min(os.cpu_count() or 1, config.batch)
        self.average = copy.deepcopy(self.network).eval()
        self.optimizer = torch.optim.AdamW(
            _groups(self.network, config.pretrained_rate), weight_decay=config.weight_decay, fused=True
        )

    @property
    def progress(self) -> float:
        """Share of the run's budget that is spent."""
        if self.config.steps is not None:
            return self.step / self.config.steps
        return self.elapsed_s / (60 * self.config.minutes)

    @classmethod
    def begin(cls, config: TrainConfig) -> "_State":
        """A new run: from ImageNet's weights where its trunk has them, and from what `config.start` shares with it."""
        state = cls(config)
        for part in _pretrained(state.network):
            load_imagenet(part)
        if config.start:
            network, started, state.before = load_network(Path(config.start))
            weights = _shared(network.state_dict(), started, state.network.state_dict(), config)
            state.network.load_state_dict(weights)
        state.average.load_state_dict(state.network.state_dict())
        return state

    @classmethod
    def resume(cls, run: Path, asked: TrainConfig) -> "_State":
        """A run as its last checkpoint left it, its log too; says so where its config is not what is `asked`."""
        saved = torch.load(run / "last.pt", weights_only=True)
        state = cls(TrainConfig.from_dict(saved["config"]))
        state.network.load_state_dict(saved["network"])
        state.average.load_state_dict(saved["average"])
        state.optimizer.load_state_dict(saved["optimizer"])
        for key in ("step", "elapsed_s", "before", "best"):
            setattr(state, key, saved[key])
        if asked != state.config:
            tqdm.write(f"{run} goes on from step {state.step} with the options that it was begun with")
        cut_log(run / "log.jsonl", state.step)
        return state

    def save(self, run: Path, score: float) -> None:
        """Write last.pt, and best.pt where `score` is the highest so far."""
        paths = [run / "last.pt", run / "best.pt"] if score > self.best else [run / "last.pt"]
        self.best = max(self.best, score)
        saved = {
            "config": self.config.to_dict(),
            "network": self.network.state_dict(),
            "average": self.average.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            **{key: getattr(self, key) for key in ("step", "elapsed_s", "before", "best")},
        }
        for path in paths:
            with whole_file(path) as file:
                torch.save(saved, file)


def _groups(network: nn.Module, pretrained_rate: float) -> list[dict[str, Any]]:
    """What is trained, in two groups: `rate` is their share of the learning rate."""
    pretrained = {weight for part in _pretrained(network) for weight in part.parameters()}
    trained = [weight for weight in network.parameters() if weight.requires_grad]
    groups = [
        {"params": [weight for weight in trained if (weight in pretrained) == known], "rate": rate}
        for known, rate in ((False, 1.0), (True, pretrained_rate))
    ]
    return [group for group in groups if group["params"]]


def _pretrained(network: nn.Module) -> list[Lite0]:
    return [part for part in network.modules() if isinstance(part, Lite0)]


def _shared(theirs: Weights, started: TrainConfig, own: Weights, config: TrainConfig) -> Weights:
    """The weights to begin with: theirs, but of a run with another trunk the head's, with another spec the trunk's.

    A trunk that has finer maps besides is the same trunk: what reads them starts at zero.
    """
    for what, was, is_now in (
        ("method", started.method, config.method),
        ("rank", started.encoder.rank, config.encoder.rank),
    ):
        if was != is_now:
            raise ValueError(f"{config.start} was trained with another {what}: {was}")
    coarse = replace(config.encoder, fine_maps=0)
    same_trunk = started.encoder in (config.encoder, coarse) and started.framing == config.framing
    same_head = started.spec == config.spec
    kept = {name for name in own if (same_head if ".head." in name else same_trunk and name in theirs)}
    if not kept:
        raise ValueError(
            f"{config.start} was trained with another trunk and another spec: it has nothing to start from"
        )
    return own | {name: _widened(theirs[name], own[name].shape) for name in kept}


def _widened(weight: Tensor, shape: torch.Size) -> Tensor:
    """The weight, with zeros for the inputs that it lacks."""
    return weight if weight.shape == shape else nnf.pad(weight, (0, shape[1] - weight.shape[1]))


def _sizes(config: TrainConfig, progress: float) -> TrainConfig:
    """The config that a batch is drawn by at `progress` in [0, 1]: more points late."""
    if progress < config.late_from:
        return config
    return replace(config, points=config.late_points, target_points=config.late_target_points)


def _step(state: _State, batch: Batch, progress: float, threads: ThreadPoolExecutor) -> float:
    for group in state.optimizer.param_groups:
        group["lr"] = group["rate"] * state.config.learning_rate * schedule(progress)
    state.network.train()
    state.optimizer.zero_grad(set_to_none=True)
    parts = np.array_split(np.arange(len(batch.images)), state.parts)
    loss = sum(threads.map(lambda part: _add_gradients(state, batch, part, progress), parts))
    torch.nn.utils.clip_grad_norm_(state.network.parameters(), state.config.gradient_clip)
    state.optimizer.step()
    update_average(state.average, state.network, state.step)
    state.step += 1
    return loss


def _add_gradients(state: _State, batch: Batch, part: npt.NDArray[np.int64], progress: float) -> float:
    """Add to the gradients what the images with the indices `part` say; return their share of the batch's loss."""
    images = batch.images[part].contiguous(memory_format=torch.channels_last)
    canonical, true = batch.canonical[part], batch.points[part]
    predicted = state.network(images, canonical)
    is_late = progress >= state.config.late_from
    loss = LATE_SCALE * late_chamfer(predicted, true) if is_late else chamfer(predicted, true)
    if state.config.projection:
        loss = loss + state.config.projection * projection(predicted, canonical)
    loss = loss * (len(part) / len(batch.images))
    loss.backward()  # type: ignore[no-untyped-call]
    return float(loss.detach())


def _computing(parts: int, threads_each: int | None = None) -> ThreadPoolExecutor:
    """Threads of Python that compute side by side, each with its share of torch's own threads if it isn't told."""
    each = threads_each or max(1, torch.get_num_threads() // parts)
    return ThreadPoolExecutor(parts, initializer=torch.set_num_threads, initargs=(each,))


def schedule(progress: float) -> float:
    """Share of the learning rate at `progress` in [0, 1]: linear warm-up, then a cosine to 0."""
    if progress < WARMUP:
        return max(progress / WARMUP, 1e-3)
    return 0.5 * (1 + float(torch.cos(torch.tensor(torch.pi * progress))))


@torch.no_grad()
def validate(network: nn.Module, config: TrainConfig, validation: Examples) -> dict[str, float]:
    """Mean over the validation objects and VALIDATION_VIEWS, on white: `val`, cd_sq / 100; `f@1%`, `f@2%`."""
    canonical = torch.from_numpy(canonical_points(config.spec.domain, VALIDATION_POINTS, config.seed))
    found = []
    for view in VALIDATION_VIEWS:
        crops, points = validation.built(view)
        for start in range(0, len(crops), config.batch):
            images = plain_images(crops[start : start + config.batch], config.framing.size)
            images = images.contiguous(memory_format=torch.channels_last)
            predicted: Tensor = network(images, canonical.expand(len(images), -1, -1))
            true = points[start : start + config.batch, :VALIDATION_TARGET_POINTS]
            found += [compare(*clouds) for clouds in zip(predicted.numpy(), true, strict=True)]
    means = {name: float(np.mean([figures[name] for figures in found])) for name in ("cd_sq", "f@1%", "f@2%")}
    return {"val": means.pop("cd_sq") / 100, **means}


def _tell(log: TextIO, bar: Any, state: _State, figures: dict[str, float]) -> None:  # noqa: ANN401
    log_line(log, state.step, state.elapsed_s, figures)
    bar.set_postfix({"step": state.step, **{key: f"{value:.4f}" for key, value in figures.items()}}, refresh=False)
    bar.update(min(1_000, round(1_000 * state.progress)) - bar.n)
