"""Write the section of PAPER.md on the runtime over n."""

from typing import Final

import numpy as np

from model.evaluation.paper.record import PaperRecord
from model.evaluation.paper.runtime import median
from model.metrics import interval
from model.report.tables import table

BASE: Final = "HOF-1"
COMPARED: Final = ("DeepSDF", "FoldingNet")
CLAIMED: Final = 100  # "an almost 100x difference" on the CPU
FROM: Final = 1_000  # points from which GPU times diverge, in the paper


def section(record: PaperRecord) -> str:
    """Return the section of one device: setting, table, verdict."""
    setting, origin = record.setting, record.origin
    counts = setting["counts"]
    rows = [[trial.method, *(f"{median(trial, n):,.2f}" for n in counts)] for trial in record.trials]
    kind = "processor time" if setting["device"] == "cpu" else "time until the device has finished"
    device = setting["device"]
    return f"""## Runtime over n, {device.upper()}

Milliseconds to map n canonical points, {kind}; theta and latent codes are there before. Written by
`hof-model paper runtime --device {device}`: {setting["hardware"]}, torch {setting["torch"]}, float32, at most
{setting["chunk"]:,} points at once, median of {setting["repeats"]} runs in turn; {origin["machine"]}, {origin["date"]},
commit {origin["commit"]}. The service's own sampler is faster: [benchmarks/RESULTS.md](benchmarks/RESULTS.md) has it.

{table(["network", *(f"n = {n:,}" for n in counts)], rows)}

{_verdict(record)}"""


def _verdict(record: PaperRecord) -> str:
    counts = record.setting["counts"]
    base = record.trial(BASE)
    lines = []
    for name in COMPARED:
        ratios = [interval(record.trial(name).column(str(n)) / np.maximum(base.column(str(n)), 1e-3)) for n in counts]
        shown = ", ".join(
            f"{r[0]:.0f} ({r[1]:.0f} to {r[2]:.0f}) at {n:,}" for r, n in zip(ratios, counts, strict=True)
        )
        if record.setting["device"] == "cpu":
            last = ratios[-1]
            met = "holds" if last[1] >= CLAIMED else "does not hold" if last[2] < CLAIMED else "undecided"
            claim = f"An almost {CLAIMED}-fold difference: {met}"
        else:
            later = [ratio for ratio, n in zip(ratios, counts, strict=True) if n > FROM]
            met = "holds" if all(ratio[1] > 1 for ratio in later) else "does not hold"
            claim = f"Times diverge from {FROM:,} points on: {met}"
        lines.append(f"- {name}, times the time of {BASE}: {shown}. {claim}.")
    return f"""The paper's claim, with 95% bootstrap intervals over runs:

{chr(10).join(lines)}"""
