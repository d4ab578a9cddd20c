"""Train and measure the methods that the shipped model is compared with, all on the same data, trunk and steps."""

from dataclasses import replace
from pathlib import Path
from typing import Final

from model.config import COMPARED_METHODS, COMPARED_RUN, ON_CPU, DeviceOptions
from model.data.manifest import Split
from model.evaluation.comparison import run_record
from model.training.device.loop import train_on_device
from model.training.device.placement import uses_device_loop
from model.training.train import train

RUNS: Final = Path("runs/compared")
COMPARED: Final = {each.file: each.config(COMPARED_RUN) for each in COMPARED_METHODS}


def retrain(
    name: str, data: Path, split: Split, output: Path, steps: int, seed: int, options: DeviceOptions = ON_CPU
) -> Path:
    """Train one of COMPARED in RUNS, or resume it, write its record to `output`, and return the record's path.

    Raises
    ------
    FileNotFoundError : `data` holds no finished data set with its variants.
    ValueError : `name` is not in COMPARED.
    """
    if name not in COMPARED:
        raise ValueError(f"unknown method {name!r}: choose one of {', '.join(COMPARED)}")
    run = RUNS / f"{name}-{steps}-{seed}"
    config = replace(COMPARED[name], steps=steps, seed=seed)
    if uses_device_loop(options):
        train_on_device(data, run, config, options)
    else:
        train(data, run, config)
    path = output / f"{name}.json"
    run_record(run, f"{name}, {steps:,} steps", data, split, seed).write(path)
    return path
