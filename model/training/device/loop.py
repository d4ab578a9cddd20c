"""Train on one device: the loop of `model.training.train` with nothing for the host to do but to keep the log."""

import sys
import time
from pathlib import Path
from typing import Final, TextIO

from model.config import DeviceOptions, TrainConfig
from model.data.packed.options import IMAGENET
from model.data.packed.tensors import Tensors
from model.training.checkpoints import chosen_checkpoint
from model.training.device.data import load_data, load_validation
from model.training.device.draws import Draws
from model.training.device.placement import torch_device
from model.training.device.steps import Steps
from model.training.device.validation import validate
from model.training.log import LOG_EVERY, log_line
from model.training.state import RunState, open_run, score

CHECKPOINT_EVERY_S: Final = 60.0


def train_on_device(data: Path, run: Path, config: TrainConfig, options: DeviceOptions) -> Path:
    """Train within the budget of the config and return the path of the chosen checkpoint.

    A run folder that holds a checkpoint is resumed with the config stored there. With `options.stop_after` the call
    ends earlier, with a checkpoint that the next call resumes.

    Raises
    ------
    FileNotFoundError : there is no such data set, or `config.start` is no file.
    ValueError : no budget, no CUDA device where one is asked for, an unreadable shard, or a start of another kind.
    FloatingPointError : the loss is not finite any more.
    """
    call = time.monotonic()
    imagenet = Path(options.packed) / IMAGENET if options.packed else None
    state = open_run(run, config, torch_device(options), imagenet)
    loaded, validation = load_data(data, state.config, options), load_validation(data, state.config, options)
    print(
        f"{torch_device(options)}: {len(loaded.train.images):,} views of {len(loaded.train.counts):,} shapes, "
        f"{loaded.train.gigabytes:.1f} GB, loaded in {time.monotonic() - call:.1f} s",
        file=sys.stderr,
    )
    draws = Draws(loaded.train, loaded.grounds, state.config, options.compile)
    steps = Steps(state, draws, options.graphs, options.compile)
    stop_s = 60 * options.stop_after if options.stop_after else float("inf")
    with (run / "log.jsonl").open("a", encoding="utf-8") as log:
        _take_steps(steps, validation, run, options.checkpoint_parts, log, call + stop_s)
    return chosen_checkpoint(run)


def _take_steps(steps: Steps, validation: Tensors, run: Path, in_parts: bool, log: TextIO, stop_at: float) -> None:
    """Step, log, validate and save until the budget or the time of this call is spent."""
    state = steps.state
    start, last_save, last_log = time.monotonic() - state.elapsed_s, time.monotonic(), time.monotonic()
    is_last = state.progress >= 1
    while not is_last:
        steps.take()
        now = time.monotonic()
        state.elapsed_s = now - start
        is_last = state.progress >= 1 or now >= stop_at
        if state.step % LOG_EVERY == 0 or is_last:
            loss, count = steps.mean_loss()
            rate = count * state.config.batch / (time.monotonic() - last_log)
            _report(log, state, {"loss": loss, "images_per_s": round(rate)})
            last_log = time.monotonic()
        if is_last or now - last_save > CHECKPOINT_EVERY_S:
            figures = validate(state.average, state.config, validation)
            _report(log, state, figures)
            state.save(run, score(figures), in_parts)
            last_save = last_log = time.monotonic()


def _report(log: TextIO, state: RunState, figures: dict[str, float]) -> None:
    """Write figures to the log and to standard error."""
    log_line(log, state.step, state.elapsed_s, figures)
    shown = "  ".join(f"{name} {value:.5g}" for name, value in figures.items())
    print(f"{state.elapsed_s:7.1f} s  {state.progress:6.1%}  step {state.step}  {shown}", file=sys.stderr)
