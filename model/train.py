"""Train g_phi end to end through f_theta: one run, one folder, resumable."""

import json
import os
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final

import torch
from torch import Tensor
from tqdm import tqdm

from model.config import TrainConfig
from model.data.dataset import Batch, Examples, draw_batch, load_examples, plain_images
from model.losses import chamfer, projection
from model.memory import keep_freed_memory
from model.networks import ImageEncoder, power

CHECKPOINT_EVERY_S: Final = 600.0
LOG_EVERY: Final = 50  # steps
WARMUP: Final = 0.02  # of the budget
VALIDATION_VIEW: Final = 1  # of 24: from the front, a little to the side


def train(data: Path, run: Path, config: TrainConfig) -> Path:
    """Train within the budget of `config.minutes` and return the path of the last checkpoint.

    A run folder that holds a checkpoint is resumed with the config stored there; the batches go on where
    they stopped, since each is a function of (seed, step) alone.

    Raises
    ------
    FileNotFoundError : `data` holds no finished data set.
    """
    run.mkdir(parents=True, exist_ok=True)
    keep_freed_memory()
    state = _State.resume(run) if (run / "last.pt").exists() else _State(config)
    examples = load_examples(data, "train", state.config.framing)
    validation = load_examples(data, "val", state.config.framing)
    budget_s = state.config.minutes * 60
    with (
        ThreadPoolExecutor(os.cpu_count()) as threads,
        ThreadPoolExecutor(1) as loader,
        (run / "log.jsonl").open("a", encoding="utf-8") as log,
        tqdm(total=round(budget_s), initial=round(state.elapsed_s), unit="s", desc="train") as bar,
    ):
        started, saved = time.monotonic() - state.elapsed_s, time.monotonic()
        coming = loader.submit(draw_batch, examples, state.config, state.step)
        losses: list[float] = []
        while state.elapsed_s < budget_s:
            batch = coming.result()
            coming = loader.submit(draw_batch, examples, state.config, state.step + 1)
            losses.append(_step(state, batch, state.elapsed_s / budget_s, threads))
            state.elapsed_s = time.monotonic() - started
            if state.step % LOG_EVERY == 0:
                mean = sum(losses) / len(losses)
                losses.clear()
                _log(log, bar, state, {"loss": mean})
            if time.monotonic() - saved > CHECKPOINT_EVERY_S or state.elapsed_s >= budget_s:
                _log(log, bar, state, {"val": _validate(state, validation, threads)})
                state.save(run / "last.pt")
                saved = time.monotonic()
    return run / "last.pt"


class _State:
    """What a run carries from step to step, and to its checkpoint."""

    def __init__(self, config: TrainConfig) -> None:
        torch.manual_seed(config.seed)
        self.config = config
        self.step = 0
        self.elapsed_s = 0.0
        self.encoder = ImageEncoder(config.spec, config.encoder, config.framing.size)
        self.encoder.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.optimizer = torch.optim.AdamW(
            self.encoder.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay, fused=True
        )

    @classmethod
    def resume(cls, run: Path) -> "_State":
        saved = torch.load(run / "last.pt", weights_only=True)
        state = cls(TrainConfig.from_dict(saved["config"]))
        state.encoder.load_state_dict(saved["encoder"])
        state.optimizer.load_state_dict(saved["optimizer"])
        state.step, state.elapsed_s = saved["step"], saved["elapsed_s"]
        return state

    def save(self, path: Path) -> None:
        temporary = path.with_suffix(".tmp")
        torch.save(
            {
                "config": self.config.to_dict(),
                "encoder": self.encoder.state_dict(),
                "optimizer": self.optimizer.state_dict(),
                "step": self.step,
                "elapsed_s": self.elapsed_s,
            },
            temporary,
        )
        os.replace(temporary, path)


def load_encoder(checkpoint: Path) -> tuple[ImageEncoder, TrainConfig, dict[str, Any]]:
    """The trained encoder of a checkpoint in evaluation mode, its config, and `step` and `elapsed_s`.

    Raises
    ------
    FileNotFoundError : no such checkpoint.
    """
    saved = torch.load(checkpoint, weights_only=True)
    config = TrainConfig.from_dict(saved["config"])
    encoder = ImageEncoder(config.spec, config.encoder, config.framing.size)
    encoder.load_state_dict(saved["encoder"])
    return encoder.eval(), config, {"step": saved["step"], "elapsed_s": saved["elapsed_s"]}


def _step(state: _State, batch: Batch, progress: float, threads: ThreadPoolExecutor) -> float:
    for group in state.optimizer.param_groups:
        group["lr"] = state.config.learning_rate * _schedule(progress)
    state.encoder.train()
    predicted = _predict(state, batch)
    loss = chamfer(predicted, batch.points, threads)
    if state.config.projection:
        loss = loss + state.config.projection * projection(predicted, batch.canonical)
    state.optimizer.zero_grad(set_to_none=True)
    loss.backward()  # type: ignore[no-untyped-call]
    torch.nn.utils.clip_grad_norm_(state.encoder.parameters(), state.config.gradient_clip)
    state.optimizer.step()
    state.step += 1
    return float(loss.detach())


def _predict(state: _State, batch: Batch) -> Tensor:
    theta = state.encoder(batch.images.contiguous(memory_format=torch.channels_last))
    return power(state.config.spec, theta, batch.canonical)


def _schedule(progress: float) -> float:
    """Share of the learning rate at `progress` in [0, 1]: linear warm-up, then a cosine to 0."""
    if progress < WARMUP:
        return max(progress / WARMUP, 1e-3)
    return 0.5 * (1 + float(torch.cos(torch.tensor(torch.pi * progress))))


@torch.no_grad()
def _validate(state: _State, validation: Examples, threads: ThreadPoolExecutor) -> float:
    """Mean symmetric Chamfer over the validation objects, one view each, no augmentation."""
    state.encoder.eval()
    losses = []
    for start in range(0, len(validation.entries), state.config.batch):
        chosen = slice(start, start + state.config.batch)
        images = plain_images(validation.crops[chosen, VALIDATION_VIEW])
        drawn = draw_batch(validation, state.config, 0)
        batch = Batch(images, drawn.canonical[: len(images)], torch.from_numpy(validation.points[chosen, :2_000]))
        losses += [float(chamfer(_predict(state, batch), batch.points, threads))] * len(images)
    return sum(losses) / len(losses)


def _log(log: Any, bar: Any, state: _State, figures: dict[str, float]) -> None:  # noqa: ANN401
    log.write(json.dumps({"step": state.step, "elapsed_s": round(state.elapsed_s, 1), **figures}) + "\n")
    log.flush()
    bar.set_postfix({"step": state.step, **{key: f"{value:.4f}" for key, value in figures.items()}}, refresh=False)
    bar.update(round(state.elapsed_s) - bar.n)


def plot_losses(run: Path, output: Path) -> None:
    """Draw a run's training and validation loss over steps, from its log.

    Raises
    ------
    FileNotFoundError : the run has no log.
    """
    import matplotlib.pyplot as plt

    records = [json.loads(line) for line in (run / "log.jsonl").read_text(encoding="utf-8").splitlines()]
    figure, axes = plt.subplots(figsize=(7, 4))
    for key in ("loss", "val"):
        chosen = [record for record in records if key in record]
        axes.plot([record["step"] for record in chosen], [record[key] for record in chosen], label=key)
    axes.set(xlabel="step", ylabel="symmetric Chamfer (squared)", yscale="log")
    axes.legend()
    figure.tight_layout()
    figure.savefig(output, dpi=120)
    plt.close(figure)
