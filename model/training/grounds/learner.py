"""The loop of the smaller trainings: batches made at each step, a budget in minutes, a checkpoint that resumes."""

import copy
import os
import time
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from tqdm import tqdm

from model.config import DistillConfig, MatteConfig
from model.training.average import update_average
from model.training.log import LOG_EVERY, cut_log, log_line
from model.training.optimization import set_learning_rate
from model.training.train import CHECKPOINT_EVERY_S, compute_threads
from service.files import whole_file

Batch = tuple[Tensor, Tensor]  # images, and what the network should answer
Loss = Callable[[Any, Tensor, Tensor], Tensor]  # takes the network
Budget = MatteConfig | DistillConfig


class Learner:
    """A network, the average of its weights, and its optimizer; the state of a run."""

    def __init__(
        self,
        network: nn.Module,
        loss: Loss,
        config: Budget,
        checkpoint: Path,
        rates: Mapping[nn.Module, float] | None = None,
        origin: str = "",
    ) -> None:
        """Go on from `checkpoint` if it exists.

        Parameters
        ----------
        rates : shares of the learning rate for parts of the network.
        origin : digest of the model that the network was taken from.

        Raises
        ------
        ValueError : the checkpoint is of another origin.
        """
        self._config, self._loss_of, self._origin = config, loss, origin
        self.step, self.elapsed_s, self.loss = 0, 0.0, 0.0
        self.network = network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.average = copy.deepcopy(self.network).eval()
        groups = [{"params": list(part.parameters()), "rate": rate} for part, rate in (rates or {}).items()]
        grouped = {weight for group in groups for weight in group["params"]}  # type: ignore[attr-defined]
        rest = [weight for weight in network.parameters() if weight.requires_grad and weight not in grouped]
        self._optimizer = torch.optim.AdamW(
            [{"params": rest, "rate": 1.0}, *groups], weight_decay=config.weight_decay, fused=True
        )
        if checkpoint.exists():
            self._resume(checkpoint)
        self._cores = os.cpu_count() or 1
        self._pool = compute_threads(self._cores, threads_each=1)

    def _resume(self, checkpoint: Path) -> None:
        saved = torch.load(checkpoint, weights_only=True)
        if saved.get("origin", self._origin) != self._origin:
            raise ValueError(f"{checkpoint} is a run of another model: name another folder with --run")
        self.network.load_state_dict(saved["network"])
        self.average.load_state_dict(saved["average"])
        self._optimizer.load_state_dict(saved["optimizer"])
        self.step, self.elapsed_s = saved["step"], saved["elapsed_s"]

    @property
    def progress(self) -> float:
        """Share of the budget that is spent."""
        return self.elapsed_s / (60 * self._config.minutes)

    def take(self, batch: Batch) -> None:
        """Take one step, on all cores."""
        set_learning_rate(self._optimizer, self._config.learning_rate, self.progress)
        self.network.train()
        self._optimizer.zero_grad(set_to_none=True)
        parts = list(zip(*(each.chunk(self._cores) for each in batch), strict=True))
        loss = sum(self._pool.map(self._add_gradients, parts))
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
        self._optimizer.step()
        update_average(self.average, self.network, self.step)
        self.step += 1
        self.loss += max(0.02, 1 / self.step) * (loss - self.loss)

    def _add_gradients(self, part: Batch) -> float:
        """Add the gradients of a part of the batch; return its share of the loss."""
        images, answers = part
        loss = len(images) / self._config.batch * self._loss_of(self.network, images, answers)
        loss.backward()  # type: ignore[no-untyped-call]
        return float(loss.detach())

    def save(self, path: Path) -> None:
        """Write the checkpoint."""
        saved = {
            "network": self.network.state_dict(),
            "average": self.average.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "step": self.step,
            "elapsed_s": self.elapsed_s,
            "origin": self._origin,
        }
        with whole_file(path) as file:
            torch.save(saved, file)


def load_average(network: nn.Module, checkpoint: Path) -> dict[str, Any]:
    """Load the averaged weights of a checkpoint; return how long they were trained: steps and minutes.

    Raises
    ------
    FileNotFoundError : there is no such file.
    """
    with checkpoint.open("rb") as file:
        saved = torch.load(file, weights_only=True)
    network.load_state_dict(saved["average"])
    return {"steps": saved["step"], "minutes": round(saved["elapsed_s"] / 60, 1)}


def learn(
    learner: Learner,
    run: Path,
    draw: Callable[[int], Batch],
    check: Callable[[Any], dict[str, float]],
    threads: int = 1,
) -> Path:
    """Train until the budget is spent, and return the checkpoint, `run/last.pt`.

    Parameters
    ----------
    draw : makes the batch of a step.
    check : figures of the averaged network, for `run/log.jsonl`; called with each checkpoint.
    threads : number of batches that are made beside a step.
    """
    checkpoint = run / "last.pt"
    cut_log(run / "log.jsonl", learner.step)
    with (
        compute_threads(threads, threads_each=1) as loaders,
        (run / "log.jsonl").open("a", encoding="utf-8") as log,
        tqdm(total=1_000, initial=round(1_000 * learner.progress), unit=" thousandths", disable=None) as bar,
    ):
        start, last_save = time.monotonic() - learner.elapsed_s, time.monotonic()
        following = deque(loaders.submit(draw, learner.step + ahead) for ahead in range(threads))
        while learner.progress < 1:
            batch = following.popleft().result()
            following.append(loaders.submit(draw, learner.step + threads))
            learner.take(batch)
            learner.elapsed_s = time.monotonic() - start
            if learner.step % LOG_EVERY == 0:
                log_line(log, learner.step, learner.elapsed_s, {"loss": learner.loss})
                bar.update(min(1_000, round(1_000 * learner.progress)) - bar.n)
            if learner.progress >= 1 or time.monotonic() - last_save > CHECKPOINT_EVERY_S:
                log_line(log, learner.step, learner.elapsed_s, check(learner.average))
                learner.save(checkpoint)
                last_save = time.monotonic()
    return checkpoint
