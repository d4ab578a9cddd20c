"""The state of a training run: begun, resumed, saved. CPU and device loops share it."""

import copy
from pathlib import Path
from typing import Final

import torch
from torch import nn

from model.config import TrainConfig
from model.networks.decoders import make_network
from model.networks.lite0 import load_imagenet
from model.training.checkpoints import load_network
from model.training.log import cut_log
from model.training.optimization import make_optimizer, pretrained_parts
from model.training.parts import has_checkpoint, load_checkpoint, save_checkpoint
from model.training.starting import has_same_trunk, starting_weights

CPU: Final = torch.device("cpu")
STORED: Final = ("step", "elapsed_s", "before", "best")  # attributes in a checkpoint, beside weights and config


class RunState:
    """Everything that a run carries from step to step, and to its checkpoint.

    Attributes
    ----------
    network : the network in training, channels last.
    average : the network with the moving average of all weights and buffers; it is validated and exported.
    step, elapsed_s : steps and seconds of this run.
    before : steps and seconds of the runs that this one started from.
    best : highest sum of F@1% and F@2% on the validation split so far.
    """

    def __init__(self, config: TrainConfig, device: torch.device = CPU) -> None:
        torch.manual_seed(config.seed)
        self.config = config
        self.step = 0
        self.elapsed_s = 0.0
        self.before = {"step": 0, "elapsed_s": 0.0}
        self.best = -1.0
        self.network: nn.Module = make_network(config)
        self.network.to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.average = copy.deepcopy(self.network).eval()
        self.optimizer = make_optimizer(self.network, config)

    @property
    def progress(self) -> float:
        """Share of the run's budget that is spent."""
        return share_spent(self.config, self.step, self.elapsed_s)

    @classmethod
    def begin(cls, config: TrainConfig, device: torch.device = CPU, imagenet: Path | None = None) -> "RunState":
        """Return a new run, from ImageNet's weights for a pretrained trunk and from what `config.start` shares.

        Raises
        ------
        FileNotFoundError : `config.start` is no file.
        ValueError : `config.start` is no checkpoint, or one of another kind of network.
        """
        state = cls(config, device)
        start = load_network(Path(config.start)) if config.start else None
        if start is None or not has_same_trunk(start[1], config):
            for part in pretrained_parts(state.network):
                load_imagenet(part, imagenet)
        if start is not None:
            network, start_config, state.before = start
            network.to(device)
            weights = starting_weights(network.state_dict(), start_config, state.network.state_dict(), config)
            state.network.load_state_dict(weights)
        state.average.load_state_dict(state.network.state_dict())
        return state

    @classmethod
    def resume(cls, run: Path, requested: TrainConfig, device: torch.device = CPU) -> "RunState":
        """Return a run as its last checkpoint left it and cut its log there.

        The stored config applies; a line says so where it differs from the `requested` one.
        """
        saved = load_checkpoint(run / "last.pt", device)
        state = cls(TrainConfig.from_dict(saved["config"]), device)
        state.network.load_state_dict(saved["network"])
        state.average.load_state_dict(saved["average"])
        state.optimizer.load_state_dict(saved["optimizer"])
        for key in STORED:
            setattr(state, key, saved[key])
        if requested != state.config:
            print(f"{run} resumes at step {state.step} with the options that it was started with")
        cut_log(run / "log.jsonl", state.step)
        return state

    def save(self, run: Path, score: float, in_parts: bool = False) -> None:
        """Write last.pt, and best.pt where `score` is the highest so far; in parts best.pt holds the average alone."""
        is_best = score > self.best
        self.best = max(self.best, score)
        saved = {
            "config": self.config.to_dict(),
            "network": self.network.state_dict(),
            "average": self.average.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            **{key: getattr(self, key) for key in STORED},
        }
        save_checkpoint(saved, run / "last.pt", in_parts)
        if is_best:
            unneeded = ("network", "optimizer") if in_parts else ()
            best = {name: value for name, value in saved.items() if name not in unneeded}
            save_checkpoint(best, run / "best.pt", in_parts)


def open_run(run: Path, config: TrainConfig, device: torch.device = CPU, imagenet: Path | None = None) -> RunState:
    """Make the run's folder and return its state: resumed from its last checkpoint, else new.

    Raises
    ------
    FileNotFoundError, ValueError : as `RunState.begin`, or there is no budget.
    """
    budgets = {"steps": config.steps, "images": config.images, "minutes": config.minutes}
    name, budget = next((name, value) for name, value in budgets.items() if value is not None)
    if budget <= 0:
        raise ValueError(f"the budget is {budget} {name}, it must be above 0")
    run.mkdir(parents=True, exist_ok=True)
    if has_checkpoint(run / "last.pt"):
        return RunState.resume(run, config, device)
    return RunState.begin(config, device, imagenet)


def share_spent(config: TrainConfig, step: int, elapsed_s: float) -> float:
    """Return the share of a run's budget that is spent after so many steps and seconds."""
    if config.steps is not None:
        return step / config.steps
    if config.images is not None:
        return step * config.batch / config.images
    return elapsed_s / (60 * config.minutes)


def score(figures: dict[str, float]) -> float:
    """Return the sum of F@1% and F@2%, by which the best checkpoint is chosen."""
    return figures["f@1%"] + figures["f@2%"]
