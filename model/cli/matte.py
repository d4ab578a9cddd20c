"""`hof-model matte` and `hof-model mattes`: train the matte network, and measure it."""

import argparse
from pathlib import Path

from model.cli.common import ROOT, SHIPPED, SHIPPED_MATTE, add_data, add_seed
from model.cli.flags import add_flags, values
from model.config import MatteConfig
from model.data.manifest import SPLITS


def add_stages(stages: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare both stages: each sets `run`, a function of the parsed arguments."""
    stage = stages.add_parser("matte", help="train the network that finds the object of a photo; resumable")
    stage.set_defaults(run=_matte)
    add_data(stage)
    stage.add_argument("--run", type=Path, default=Path("runs/matte"), dest="folder", help="folder of the run")
    add_flags(stage, MatteConfig())
    stage.add_argument("-o", "--output", type=Path, default=SHIPPED_MATTE, help="ONNX file; default: the shipped one")
    stage = stages.add_parser("mattes", help="measure mattes in front of photographs, for RESULTS.md")
    stage.set_defaults(run=_mattes)
    add_data(stage)
    add_seed(stage)
    stage.add_argument("--model", type=Path, default=SHIPPED, help="exported encoder; default: the shipped one")
    stage.add_argument("--matte", type=Path, default=SHIPPED_MATTE, help="matte network; default: the shipped one")
    stage.add_argument("--u2net", type=Path, metavar="FILE", help="u2netp.onnx, to compare with")
    stage.add_argument("--split", choices=SPLITS, default="test", help="split to measure on; default: test")
    stage.add_argument("-o", "--out", type=Path, default=ROOT, help="folder that receives model/results/mattes")


def _matte(arguments: argparse.Namespace) -> None:
    from model.export_matte import export_matte
    from model.report.matte_card import matte_card, matte_page
    from model.training.grounds.train_matte import load_matte, train_matte
    from service.files import whole_file

    config = MatteConfig(**values(arguments, MatteConfig))
    network, trained = load_matte(train_matte(arguments.data, arguments.folder, config))
    card = matte_card(arguments.data, arguments.output.stem, config, trained)
    difference = export_matte(network, config.size, card, arguments.output)
    size = arguments.output.stat().st_size
    with whole_file(arguments.output.with_suffix(".md")) as file:
        file.write(matte_page(card, size).encode())
    print(f"matte: torch - onnxruntime: {difference:.1e}\n{arguments.output}: {size:,} bytes")


def _mattes(arguments: argparse.Namespace) -> None:
    from model.evaluation.locations import MATTES
    from model.evaluation.mattes import U2NET, measure_mattes
    from model.report.mattes import section
    from service.encoding.encoder import Encoder
    from service.encoding.masks import MattingFunction
    from service.encoding.matting import Matting

    encoder = Encoder.open(arguments.model, threads=1)
    files = {U2NET: arguments.u2net, arguments.matte.stem: arguments.matte}
    opened = {way: Matting.of(file, threads=1) for way, file in files.items()}
    ways: dict[str, MattingFunction] = {way: matting for way, matting in opened.items() if matting}
    trials = measure_mattes(encoder, ways, arguments.data, arguments.split, arguments.seed)
    trials.write(arguments.out / MATTES)
    print(section(arguments.out))
