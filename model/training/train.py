"""Train g_phi end to end through f_theta, or a method it is compared with: one run, one folder, resumable."""

import os
import time
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final, TextIO

import numpy as np
import numpy.typing as npt
import torch
from torch import nn
from tqdm import tqdm

from model.config import TrainConfig
from model.data.dataset import Batch, draw_batch, load_examples
from model.networks.encoder import channels_last
from model.training.average import update_average
from model.training.checkpoints import chosen_checkpoint
from model.training.log import LOG_EVERY, log_line
from model.training.losses import training_loss
from model.training.memory import keep_freed_memory
from model.training.optimization import set_learning_rate
from model.training.state import RunState, open_run, score
from model.training.validation import validate

CHECKPOINT_EVERY_S: Final = 600.0
CHECKPOINTS: Final = 4  # of a run at least, however short: the last quarter shows whether its curve is flat


def train(data: Path, run: Path, config: TrainConfig) -> Path:
    """Train within the budget of `config.minutes` or `config.steps` and return the path of the chosen checkpoint.

    A run folder that holds a checkpoint is resumed with the config stored there. Its batches continue where
    they stopped, since each is a function of (seed, step) alone.

    Raises
    ------
    FileNotFoundError : `data` holds no finished data set, or `config.start` is no file.
    ValueError : no budget, or `config.start` holds another kind of network or none.
    """
    state = open_run(run, config)
    examples = load_examples(data, "train", state.config.framing, state.config.variants, state.config.made)
    validation = load_examples(data, "val", state.config.framing, variants=False)
    parts = batch_parts(state.network, state.config)
    keep_freed_memory()  # not before: what loading frees lies scattered, and steps in it take a fifth longer
    with (
        compute_threads(parts) as threads,
        compute_threads(1, threads_each=1) as loader,
        (run / "log.jsonl").open("a", encoding="utf-8") as log,
        tqdm(
            total=1_000, initial=round(1_000 * state.progress), unit=" thousandths", desc="train", disable=None
        ) as bar,
    ):
        start, last_save = time.monotonic() - state.elapsed_s, time.monotonic()
        following = loader.submit(draw_batch, examples, state.config.at(state.progress), state.step)
        losses: deque[float] = deque(maxlen=LOG_EVERY)
        while state.progress < 1:
            batch, progress = following.result(), state.progress
            following = loader.submit(draw_batch, examples, state.config.at(progress), state.step + 1)
            losses.append(train_step(state, batch, progress, threads, parts))
            state.elapsed_s = time.monotonic() - start
            if state.step % LOG_EVERY == 0:
                _report(log, bar, state, {"loss": sum(losses) / len(losses)})
            if _passes_mark(progress, state.progress) or time.monotonic() - last_save > CHECKPOINT_EVERY_S:
                figures = validate(state.average, state.config, validation)
                _report(log, bar, state, figures)
                state.save(run, score(figures))
                last_save = time.monotonic()
    return chosen_checkpoint(run)


def batch_parts(network: nn.Module, config: TrainConfig) -> int:
    """Return the number of cores that share a batch: one where BatchNorm normalizes its images together."""
    is_normalized = any(isinstance(part, nn.BatchNorm2d) for part in network.modules())
    return 1 if is_normalized else min(os.cpu_count() or 1, config.batch)


def train_step(state: RunState, batch: Batch, progress: float, threads: ThreadPoolExecutor, parts: int = 1) -> float:
    """Take one step with the batch in `parts` parts and return its loss."""
    set_learning_rate(state.optimizer, state.config.learning_rate, progress, state.config.constant_rate)
    state.network.train()
    state.optimizer.zero_grad(set_to_none=True)
    indices = np.array_split(np.arange(len(batch.images)), parts)
    loss = sum(threads.map(lambda part: _add_gradients(state, batch, part, progress), indices))
    torch.nn.utils.clip_grad_norm_(state.network.parameters(), state.config.gradient_clip)
    state.optimizer.step()
    update_average(state.average, state.network, state.step)
    state.step += 1
    return loss


def _add_gradients(state: RunState, batch: Batch, part: npt.NDArray[np.int64], progress: float) -> float:
    """Add the gradients of the images with the indices `part`; return their share of the batch's loss."""
    canonical, true = batch.canonical[part], batch.points[part]
    predicted = state.network(channels_last(batch.images[part]), canonical)
    if batch.scale is not None:
        predicted = predicted * batch.scale[part]
    loss = training_loss(state.config, predicted, canonical, true, progress)
    loss = loss * (len(part) / len(batch.images))
    loss.backward()  # type: ignore[no-untyped-call]
    return float(loss.detach())


def _passes_mark(before: float, after: float) -> bool:
    """Return whether a run's progress, from `before` to `after`, passes one of its CHECKPOINTS marks."""
    return int(CHECKPOINTS * after) > int(CHECKPOINTS * before)


def compute_threads(count: int, threads_each: int | None = None) -> ThreadPoolExecutor:
    """Return a pool of `count` threads; each uses `threads_each` of torch's threads, by default its share of all."""
    each = threads_each or max(1, torch.get_num_threads() // count)
    return ThreadPoolExecutor(count, initializer=torch.set_num_threads, initargs=(each,))


def _report(log: TextIO, bar: Any, state: RunState, figures: dict[str, float]) -> None:  # noqa: ANN401
    """Write the figures to the log and show them on the progress bar."""
    log_line(log, state.step, state.elapsed_s, figures)
    bar.set_postfix({"step": state.step, **{key: f"{value:.4f}" for key, value in figures.items()}}, refresh=False)
    bar.update(min(1_000, round(1_000 * state.progress)) - bar.n)
