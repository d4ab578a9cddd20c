"""The state of a training run: begun, resumed, saved. CPU and device loops share it."""

import copy
from pathlib import Path
from typing import Final

import torch
from torch import nn
from tqdm import tqdm

from model.config import TrainConfig
from model.networks.decoders import make_network
from model.networks.lite0 import load_imagenet
from model.training.checkpoints import load_network
from model.training.log import cut_log
from model.training.optimization import make_optimizer, pretrained_parts
from model.training.starting import starting_weights
from service.files import whole_file

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

    def __init__(self, config: TrainConfig) -> None:
        torch.manual_seed(config.seed)
        self.config = config
        self.step = 0
        self.elapsed_s = 0.0
        self.before = {"step": 0, "elapsed_s": 0.0}
        self.best = -1.0
        self.network: nn.Module = make_network(config)
        self.network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.average = copy.deepcopy(self.network).eval()
        self.optimizer = make_optimizer(self.network, config)

    @property
    def progress(self) -> float:
        """Share of the run's budget that is spent."""
        if self.config.steps is not None:
            return self.step / self.config.steps
        return self.elapsed_s / (60 * self.config.minutes)

    @classmethod
    def begin(cls, config: TrainConfig) -> "RunState":
        """Return a new run, from ImageNet's weights for a pretrained trunk and from what `config.start` shares.

        Raises
        ------
        FileNotFoundError : `config.start` is no file.
        ValueError : `config.start` is no checkpoint, or one of another kind of network.
        """
        state = cls(config)
        for part in pretrained_parts(state.network):
            load_imagenet(part)
        if config.start:
            network, start_config, state.before = load_network(Path(config.start))
            weights = starting_weights(network.state_dict(), start_config, state.network.state_dict(), config)
            state.network.load_state_dict(weights)
        state.average.load_state_dict(state.network.state_dict())
        return state

    @classmethod
    def resume(cls, run: Path, requested: TrainConfig) -> "RunState":
        """Return a run as its last checkpoint left it and cut its log there.

        The stored config applies; a line says so where it differs from the `requested` one.
        """
        saved = torch.load(run / "last.pt", weights_only=True)
        state = cls(TrainConfig.from_dict(saved["config"]))
        state.network.load_state_dict(saved["network"])
        state.average.load_state_dict(saved["average"])
        state.optimizer.load_state_dict(saved["optimizer"])
        for key in STORED:
            setattr(state, key, saved[key])
        if requested != state.config:
            tqdm.write(f"{run} resumes at step {state.step} with the options that it was started with")
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
            **{key: getattr(self, key) for key in STORED},
        }
        for path in paths:
            with whole_file(path) as file:
                torch.save(saved, file)
