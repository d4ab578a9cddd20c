"""Train the variants of a suite. Needs torch, NumPy and Pillow alone, so that a machine with a GPU can run it."""

import hashlib
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from model.config import DeviceOptions, TrainConfig
from model.evaluation.paper.suites import Suite
from model.training.device.loop import train_on_device
from model.training.device.placement import uses_device_loop
from model.training.parts import has_checkpoint, load_checkpoint
from model.training.state import share_spent


def configs(suite: Suite, common: TrainConfig, seed: int) -> dict[str, TrainConfig]:
    """Return the config of each variant."""
    return {name: replace(change(common), seed=seed) for name, change in suite.variants.items()}


def run_folder(runs: Path, config: TrainConfig) -> Path:
    """Return the folder of a config's run, named by its difference from the defaults.

    Variants of several experiments that are the same network share it: they are trained once.
    """
    defaults = TrainConfig().to_dict()
    changes = {name: value for name, value in config.to_dict().items() if value != defaults[name]}
    return runs / hashlib.sha256(json.dumps(changes, sort_keys=True).encode()).hexdigest()[:12]


def train_suite(
    experiment: str,
    suite: Suite,
    common: TrainConfig,
    seeds: Sequence[int],
    data: Path,
    runs: Path,
    options: DeviceOptions | None = None,
) -> dict[tuple[str, int], Path] | None:
    """Train each variant with each seed, or resume it, and return the folders by variant and seed.

    Finished runs stay as they are. Once `options.stop_after` minutes are spent, return None; the next call goes on.

    Raises
    ------
    FileNotFoundError : no data set.
    ValueError : there is no such device.
    """
    options = options or DeviceOptions()
    end = time.monotonic() + 60 * options.stop_after if options.stop_after else float("inf")
    folders = {}
    for seed in seeds:
        for name, config in configs(suite, common, seed).items():
            folder = folders[name, seed] = run_folder(runs, config)
            if is_finished(folder):
                continue
            left = (end - time.monotonic()) / 60
            if left <= 0:
                return None
            print(f"{experiment}, {name}, seed {seed}: {folder}", file=sys.stderr)
            if uses_device_loop(options):
                train_on_device(data, folder, config, replace(options, stop_after=left if options.stop_after else None))
                if not is_finished(folder):
                    return None
            else:
                from model.training.train import train  # needs more than a machine with a GPU may have

                train(data, folder, config)
    return folders


def is_finished(folder: Path) -> bool:
    """Return whether a run has spent its budget."""
    if not has_checkpoint(folder / "last.pt"):
        return False
    saved = load_checkpoint(folder / "last.pt")
    return share_spent(TrainConfig.from_dict(saved["config"]), saved["step"], saved["elapsed_s"]) >= 1
