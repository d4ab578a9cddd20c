"""The log of a run: a line at intervals and at each validation, cut on resuming, plotted at the end."""

import json
from pathlib import Path
from typing import Final, TextIO

from service.files import whole_file

LOG_EVERY: Final = 50  # steps; on a GPU the host waits for it there


def log_line(log: TextIO, step: int, elapsed_s: float, figures: dict[str, float]) -> None:
    """Append a line and flush the log to disk."""
    log.write(json.dumps({"step": step, "elapsed_s": round(elapsed_s, 1), **figures}) + "\n")
    log.flush()


def cut_log(path: Path, step: int) -> None:
    """Remove the lines that a run wrote after step `step`, that of the checkpoint it resumes from."""
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True) if path.exists() else []
    with whole_file(path) as file:
        file.writelines(line.encode() for line in lines if line.endswith("\n") and json.loads(line)["step"] <= step)


def plot_losses(run: Path, output: Path) -> None:
    """Plot a run's training and validation loss over steps, from its log.

    Raises
    ------
    FileNotFoundError : the run has no log.
    """
    import matplotlib.pyplot as plt

    records = [json.loads(line) for line in (run / "log.jsonl").read_text(encoding="utf-8").splitlines()]
    figure, axes = plt.subplots(figsize=(7, 4))
    for key in ("loss", "val"):
        having = [record for record in records if key in record]
        axes.plot([record["step"] for record in having], [record[key] for record in having], label=key)
    axes.set(xlabel="step", ylabel="training loss; squared Chamfer distance of val", yscale="log")
    axes.legend()
    figure.tight_layout()
    figure.savefig(output, dpi=120)
    plt.close(figure)
