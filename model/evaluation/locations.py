"""Locations of the committed measurements, relative to the project's root."""

from pathlib import Path
from typing import Final

RESULTS: Final = Path("model/results")  # records of exported models and of the ceiling
COLOR: Final = RESULTS / "color"
ESTIMATES: Final = RESULTS / "estimates"
MATTES: Final = RESULTS / "mattes" / "hof-matte.json"
MIXTURES: Final = RESULTS / "mixtures"
PAPER: Final = RESULTS / "paper"  # experiments of `hof-model paper`
RUNS: Final = RESULTS / "runs"  # runs of model/LAB.md
SURFACES: Final = RESULTS / "surfaces.json"
