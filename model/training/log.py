"""What a run logs: a line every so many steps and at each validation, cut where it is resumed, drawn at its end."""

import json
from pathlib import Path
from typing import TextIO

from service.files import whole_file


def log_line(log: TextIO, step: int, elapsed_s: float, figures: dict[str, float]) -> None:
    """Write a line, and what came before it, to the disk."""
    log.write(json.dumps({"step": step, "elapsed_s": round(elapsed_s, 1), **figures}) + "\n")
    log.flush()


def cut_log(path: Path, step: int) -> None:
    """Leave out what a run logged after the checkpoint that it goes on from."""
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True) if path.exists() else []
    with whole_file(path) as file:
        file.writelines(line.encode() for line in lines if line.endswith("\n") and json.loads(line)["step"] <= step)


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
    axes.set(xlabel="step", ylabel="loss in training; squared Chamfer of val", yscale="log")
    axes.legend()
    figure.tight_layout()
    figure.savefig(output, dpi=120)
    plt.close(figure)
