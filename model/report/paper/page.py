"""Assemble PAPER.md from the records of experiments."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Final

from model.evaluation.locations import PAPER
from model.evaluation.paper.completion import EXPERIMENT as POINTS
from model.evaluation.paper.compression import EXPERIMENT as FIT
from model.evaluation.paper.interpolation import EXPERIMENT as INTERPOLATION
from model.evaluation.paper.latent import EXPERIMENT as LATENT
from model.evaluation.paper.navigation import EXPERIMENT as PATHS
from model.evaluation.paper.record import PaperRecord
from model.evaluation.paper.runtime import EXPERIMENT as RUNTIME
from model.evaluation.paper.suites import SUITES
from model.evaluation.paper.views import EXPERIMENT as VIEWS
from model.report.paper import completion, compression, interpolation, latent, navigation, runtime, trained, views
from service.files import whole_file

PAGE: Final = "PAPER.md"
SECTIONS: Final[Mapping[str, Callable[[PaperRecord], str]]] = {  # by experiment, in order
    "table1": partial(trained.section, SUITES["table1"]),
    "architecture": partial(trained.section, SUITES["architecture"]),
    "domains": partial(trained.section, SUITES["domains"]),
    "powers": partial(trained.section, SUITES["powers"]),
    "projection": partial(trained.section, SUITES["projection"]),
    RUNTIME: runtime.section,
    f"{RUNTIME}-cuda": runtime.section,
    INTERPOLATION: interpolation.section,
    LATENT: latent.section,
    "parts": partial(trained.section, SUITES["parts"]),
    PATHS: navigation.section,
    "frame": partial(trained.section, SUITES["frame"]),
    VIEWS: views.section,
    POINTS: completion.section,
    FIT: compression.section,
}

HEAD: Final = """# The paper's experiments on our data

Experiments of Mitchell et al., *Higher-Order Function Networks for Learning Composable 3D Object Representations*
(2020), repeated on the open data of [docs/training.md](docs/training.md). `hof-model paper NAME` runs one and writes
its record below `model/results/paper/`; `make paper` writes this page from the records. The paper's own figures are of
another data set and scale: compare orders and differences, not values. [RESULTS.md](RESULTS.md) is about the shipped
models."""


def write(root: Path) -> Path:
    """Write the page below `root` from the records there; return its path. An experiment without a record is left out.

    Raises
    ------
    ValueError : a record is damaged.
    """
    parts = [HEAD]
    for experiment, section in SECTIONS.items():
        path = record_path(root, experiment)
        if path.is_file():
            parts.append(section(PaperRecord.read(path)))
    page = root / PAGE
    with whole_file(page) as file:
        file.write(("\n\n".join(parts) + "\n").encode())
    return page


def record_path(root: Path, experiment: str) -> Path:
    """Return the path of an experiment's record."""
    return root / PAPER / f"{experiment}.json"
