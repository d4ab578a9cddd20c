"""Helpers of the tests and the benchmarks: servers, processes, databases, photos, small inputs."""

from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[2]  # of the repository
