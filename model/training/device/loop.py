"""Train on one device: the loop of `model.training.train` with nothing for the host to do but to keep the log."""

import time
from pathlib import Path
from typing import Final, TextIO

from model.config import DeviceOptions, TrainConfig
from model.data.packed.options import IMAGENET
from model.training.checkpoints import chosen_checkpoint
from model.training.device.data import DeviceData, load_data
from model.training.device.draws import Draws
from model.training.device.placement import torch_device
from model.training.device.steps import Steps
from model.training.device.validation import validate
from model.training.log import log_line
from model.training.state import RunState, open_run, score

LOG_EVERY: Final = 50  # steps; the host waits for the device there
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
    loaded = load_data(data, state.config, options)
    print(
        f"{torch_device(options)}: {len(loaded.train.images):,} views of {len(loaded.train.counts):,} shapes, "
        f"{loaded.train.gigabytes:.1f} GB, loaded in {time.monotonic() - call:.1f} s",
        flush=True,
    )
    stop_s = 60 * options.stop_after if options.stop_after else float("inf")
    with (run / "log.jsonl").open("a", encoding="utf-8") as log:
        _take_steps(state, loaded, run, options, log, call + stop_s)
    return chosen_checkpoint(run)


def _take_steps(
    state: RunState, data: DeviceData, run: Path, options: DeviceOptions, log: TextIO, stop_at: float
) -> None:
    """Step, log, validate and save until the budget or the time of this call is spent."""
    draws = Draws(data.train, data.grounds, state.config, options.compile)
    steps = Steps(state, draws, options.graphs, options.compile)
    start, last_save, last_log = time.monotonic() - state.elapsed_s, time.monotonic(), time.monotonic()
    while state.progress < 1:
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
            figures = validate(state.average, state.config, data.validation)
            _report(log, state, figures)
            state.save(run, score(figures), options.checkpoint_parts)
            last_save = time.monotonic()
        if is_last:
            break


def _report(log: TextIO, state: RunState, figures: dict[str, float]) -> None:
    """Write figures to the log and to the terminal."""
    log_line(log, state.step, state.elapsed_s, figures)
    shown = "  ".join(f"{name} {value:.5g}" for name, value in figures.items())
    print(f"{state.elapsed_s:7.1f} s  {state.progress:6.1%}  step {state.step}  {shown}", flush=True)
