"""A tiny run, from meshes to an exported encoder."""

from pathlib import Path

import pytest

from model.data.build import build
from model.data.sources.meshes import folder_records
from model.training.train import train
from tests.support.small.runs import RUN, export_run
from tests.support.small.shapes import write_folder


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Render a data set from a folder of meshes."""
    folder = tmp_path_factory.mktemp("training")
    build(folder_records(write_folder(folder / "meshes"), "CC0"), folder / "data", seed=0, processes=2)
    return folder / "data"


@pytest.fixture(scope="session")
def run(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Train RUN and return the folder of the finished run."""
    return train(built, tmp_path_factory.mktemp("run"), RUN).parent


@pytest.fixture(scope="session")
def exported(run: Path, built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Export the run as an ONNX file."""
    output = tmp_path_factory.mktemp("weights") / "small-k2.onnx"
    return export_run(run, built, output)
