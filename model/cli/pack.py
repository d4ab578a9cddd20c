"""`hof-model data pack`: a data set as a few large files, for training where nothing but torch is installed."""

import argparse
import os
from pathlib import Path
from typing import Final

from model.cli.flags import add_flags, number, values
from model.config import LITE0_SIZE
from model.data.packed.options import IMAGENET, PackOptions
from service.encoding.framing import Framing

PACKED: Final = Path("data/packed")


def add_pack(stage: argparse.ArgumentParser, data: Path) -> None:
    """Declare the flags of the stage; `data` is the default data set."""
    ratio = Framing().foreground_ratio
    stage.set_defaults(run=_pack, default=data)
    stage.add_argument(
        "--data",
        type=Path,
        action="append",
        help=f"folder written by `hof-model data build`, may be repeated; default: {data}",
    )
    stage.add_argument("-o", "--out", type=Path, default=PACKED, help=f"folder of the shards; default: {PACKED}")
    stage.add_argument(
        "--size",
        type=number(int, least=1),
        default=LITE0_SIZE,
        help=f"pixels of an image's side; default: {LITE0_SIZE}",
    )
    stage.add_argument(
        "--foreground-ratio",
        type=number(float, above=0, most=1),
        default=ratio,
        metavar="RATIO",
        help=f"share of the side that the object's longest side takes; default: {ratio}",
    )
    add_flags(stage, PackOptions())
    stage.add_argument("--processes", type=number(int, least=1), default=os.cpu_count() or 1)


def _pack(arguments: argparse.Namespace) -> None:
    from model.data.packed.pack import pack
    from model.networks.lite0 import save_imagenet

    framing = Framing(arguments.size, arguments.foreground_ratio)
    options = PackOptions(framing=framing, **values(arguments, PackOptions))
    index = pack(arguments.data or [arguments.default], arguments.out, options, arguments.processes)
    save_imagenet(index.parent / IMAGENET)
    print(index)
