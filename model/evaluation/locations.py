"""Locations of the committed measurements, relative to the project's root."""

from pathlib import Path
from typing import Final

RESULTS: Final = Path("model/results")  # records of exported models and of the ceiling
COLOR: Final = RESULTS / "color"
COMPARED: Final = RESULTS / "compared"  # methods that `hof-model retrain` trains and measures
ESTIMATES: Final = RESULTS / "estimates"
MIXTURES: Final = RESULTS / "mixtures"
PAPER: Final = RESULTS / "paper"  # experiments of `hof-model paper`
RUNS: Final = RESULTS / "runs"  # runs of model/LAB.md
SURFACES: Final = RESULTS / "surfaces.json"
