"""Train the matte network (`hof-model matte`): pictures made at each step, and which of their pixels are object."""

import copy
import os
import time
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
import torch.nn.functional as nnf
from torch import Tensor, nn
from tqdm import tqdm

from model.config import MatteConfig
from model.data.manifest import Manifest, Split, piece_files, variant_files
from model.data.rendering.composites import Composites
from model.data.sources.photographs import photograph_files, scenery_files, surface_files
from model.networks.encoder import channels_last
from model.networks.matte import MatteNetwork
from model.training.average import update_average
from model.training.log import LOG_EVERY, cut_log, log_line
from model.training.memory import keep_freed_memory
from model.training.optimization import set_learning_rate
from model.training.train import CHECKPOINT_EVERY_S, compute_threads
from service.files import whole_file

OWN_VIEWS: Final = 8  # of each object, evenly spread over its ring
VARIANTS: Final = 4  # of each object, its free cameras among them
CHECKED: Final = 256  # pictures of validation objects
OVERLAP_WEIGHT: Final = 0.5  # of the overlap's loss, beside the cross entropy

Batch = tuple[Tensor, Tensor]


def train_matte(data: Path, run: Path, config: MatteConfig) -> Path:
    """Train within `config.minutes` and return the path of the checkpoint, `run/last.pt`; an existing run is resumed.

    Raises
    ------
    FileNotFoundError : `data` lacks the objects, `hof-model data vary` or `hof-model data make`.
    """
    run.mkdir(parents=True, exist_ok=True)
    checkpoint = run / "last.pt"
    learner = _Learner(config, checkpoint)
    cut_log(run / "log.jsonl", learner.step)
    composites = load_composites(data, "train")
    checked = load_composites(data, "val").draw(CHECKED, config.size, np.random.default_rng(config.seed))
    keep_freed_memory()

    def draw(step: int) -> Batch:
        return composites.draw(config.batch, config.size, np.random.default_rng([config.seed, step]))

    with (
        compute_threads(1, threads_each=1) as loader,
        (run / "log.jsonl").open("a", encoding="utf-8") as log,
        tqdm(total=1_000, initial=round(1_000 * learner.progress), unit=" thousandths", disable=None) as bar,
    ):
        start, last_save = time.monotonic() - learner.elapsed_s, time.monotonic()
        following = loader.submit(draw, learner.step)
        while learner.progress < 1:
            batch = following.result()
            following = loader.submit(draw, learner.step + 1)
            learner.take(batch)
            learner.elapsed_s = time.monotonic() - start
            if learner.step % LOG_EVERY == 0:
                log_line(log, learner.step, learner.elapsed_s, {"loss": learner.loss})
                bar.update(min(1_000, round(1_000 * learner.progress)) - bar.n)
            if learner.progress >= 1 or time.monotonic() - last_save > CHECKPOINT_EVERY_S:
                log_line(log, learner.step, learner.elapsed_s, {"overlap": overlap(learner.average, checked)})
                learner.save(checkpoint)
                last_save = time.monotonic()
    return checkpoint


def load_matte(checkpoint: Path) -> tuple[MatteNetwork, dict[str, Any]]:
    """Return the averaged network of a checkpoint, in evaluation, and how long it was trained: steps and minutes.

    Raises
    ------
    FileNotFoundError : there is no such file.
    """
    with checkpoint.open("rb") as file:
        saved = torch.load(file, weights_only=True)
    network = MatteNetwork()
    network.load_state_dict(saved["average"])
    return network.eval(), {"steps": saved["step"], "minutes": round(saved["elapsed_s"] / 60, 1)}


def load_composites(data: Path, split: Split) -> Composites:
    """Load views of a split's objects; of the training split also those of its variants, and all pieces.

    Raises
    ------
    FileNotFoundError : the data set, its variants or its pieces are missing.
    """
    views = []
    for entry in Manifest.read(data).of(split):
        with np.load(data / entry.file) as arrays:
            ring = arrays["views"]
        views.append(ring[:: max(1, len(ring) // OWN_VIEWS)])
        if split == "train":
            views += [_views(path) for path in variant_files(data, entry)[:VARIANTS]]
    if split == "train":
        views += [_views(path) for path in piece_files(data)]
    return Composites(np.concatenate(views), photograph_files(data), scenery_files(data), surface_files(data))


def _views(path: Path) -> Any:  # noqa: ANN401 - (n, S, S, 4) uint8
    with np.load(path) as arrays:
        return arrays["views"]


def matte_loss(logits: Tensor, mattes: Tensor) -> Tensor:
    """Return the mean cross entropy, and OVERLAP_WEIGHT of what soft masks lack of a whole overlap.

    Parameters
    ----------
    logits, mattes : (b, 1, s, s); mattes in [0, 1].
    """
    soft = logits.sigmoid()
    both, either = (soft * mattes).sum((1, 2, 3)), (soft + mattes - soft * mattes).sum((1, 2, 3))
    lacking = 1 - (both + 1) / (either + 1)
    return nnf.binary_cross_entropy_with_logits(logits, mattes) + OVERLAP_WEIGHT * lacking.mean()


@torch.no_grad()
def overlap(network: nn.Module, checked: Batch) -> float:
    """Return the mean intersection over union of masks and mattes above one half; that of two empty ones is 1."""
    images, mattes = checked
    masks = torch.cat([network(channels_last(part)) for part in images.chunk(max(1, len(images) // 32))]) > 0
    true = mattes > 0.5
    both, either = (masks & true).sum((1, 2, 3)), (masks | true).sum((1, 2, 3))
    return float(((both + 1) / (either + 1)).mean())


class _Learner:
    """The network, its average and its optimizer; the state of a run."""

    def __init__(self, config: MatteConfig, checkpoint: Path) -> None:
        torch.manual_seed(config.seed)
        self._config = config
        self.step, self.elapsed_s, self.loss = 0, 0.0, 0.0
        saved = torch.load(checkpoint, weights_only=True) if checkpoint.exists() else None
        network = MatteNetwork() if saved else MatteNetwork.pretrained()
        self.network = network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.average = copy.deepcopy(self.network).eval()
        pretrained = set(network.trunk.parameters())
        groups = [
            {"params": [weight for weight in network.parameters() if weight not in pretrained], "rate": 1.0},
            {"params": list(network.trunk.parameters()), "rate": config.pretrained_rate},
        ]
        self._optimizer = torch.optim.AdamW(groups, weight_decay=config.weight_decay, fused=True)
        if saved:
            self.network.load_state_dict(saved["network"])
            self.average.load_state_dict(saved["average"])
            self._optimizer.load_state_dict(saved["optimizer"])
            self.step, self.elapsed_s = saved["step"], saved["elapsed_s"]
        self._cores = os.cpu_count() or 1
        self._pool = compute_threads(self._cores, threads_each=1)

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
        images, mattes = part
        share = len(images) / self._config.batch
        loss = share * matte_loss(self.network(channels_last(images)), mattes)
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
        }
        with whole_file(path) as file:
            torch.save(saved, file)
