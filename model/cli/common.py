"""Paths and flags that several stages share."""

import argparse
from pathlib import Path
from typing import Final

from model.cli.data import DATA
from model.data.shapenet.layouts import LAYOUTS

RUN: Final = Path("runs/hof1-k2")
SHIPPED: Final = Path(__file__).resolve().parents[1] / "weights" / "hof1-k2.onnx"
SHIPPED_POINTS: Final = SHIPPED.with_name("hof1-k2-points.onnx")
SHIPPED_MATTE: Final = SHIPPED.with_name("hof-matte.onnx")
ROOT: Final = Path(__file__).resolve().parents[2]


def add_data(stage: argparse.ArgumentParser) -> None:
    """Add `--data`, the data set's folder."""
    stage.add_argument(
        "--data",
        type=Path,
        default=DATA,
        help=f"folder written by `hof-model data build`, or {', '.join(f'{kind}:PATH' for kind in LAYOUTS)}; "
        f"default: {DATA}",
    )


def resolve_data(arguments: argparse.Namespace) -> None:
    """Replace `KIND:PATH` in `--data` by the folder of the converted data set.

    Raises
    ------
    FileNotFoundError : the path lacks a folder or list of its layout.
    ValueError : no model can be read.
    """
    kind, colon, path = str(getattr(arguments, "data", "")).partition(":")
    if colon and kind in LAYOUTS:
        from model.data.shapenet.convert import convert

        arguments.data = convert(kind, Path(path))


def add_run(stage: argparse.ArgumentParser, text: str) -> None:
    """Add `--run`, the folder of a training run, stored as `folder`."""
    stage.add_argument("--run", type=Path, default=RUN, dest="folder", help=f"{text}; default: {RUN}")


def add_seed(stage: argparse.ArgumentParser) -> None:
    """Add `--seed` for stages that sample but have no config of their own."""
    stage.add_argument("--seed", type=int, default=0, help="seed of sampled points and images; default: 0")
