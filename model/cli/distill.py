"""`hof-model distill`: train an exported encoder to give the same answer with a background as over white."""

import argparse
import tempfile
from pathlib import Path

from model.cli.common import SHIPPED, SHIPPED_MATTE, add_data
from model.cli.flags import add_flags, values
from model.config import DistillConfig


def add_stage(stages: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the stage: it sets `run`, a function of the parsed arguments."""
    stage = stages.add_parser(
        "distill", help="train an exported model to give the same answer with a background as over white; resumable"
    )
    stage.set_defaults(run=_distill)
    add_data(stage)
    stage.add_argument("--model", type=Path, default=SHIPPED, help="exported encoder; default: the shipped one")
    stage.add_argument("--matte", type=Path, default=SHIPPED_MATTE, help="matte network; default: the shipped one")
    stage.add_argument("--run", type=Path, default=Path("runs/distilled"), dest="folder", help="folder of the run")
    add_flags(stage, DistillConfig())
    stage.add_argument("-o", "--output", type=Path, required=True, help="ONNX file to write; may be that of --model")


def _distill(arguments: argparse.Namespace) -> None:
    from model.data.sources.photographs import photograph_files
    from model.evaluation.comparison import encoder_record
    from model.export_distilled import export_distilled
    from model.provenance import provenance
    from model.report.card import figures, write_page
    from model.training.grounds.distill import distill, load_distilled
    from service.encoding.encoder import Encoder
    from service.encoding.matting import Matting

    config, model, output = DistillConfig(**values(arguments, DistillConfig)), arguments.model, arguments.output
    card = Encoder.open(model, threads=1).card
    checkpoint = distill(arguments.data, model, arguments.folder, config, Matting(arguments.matte, threads=1))
    encoder, trained, spent = load_distilled(model, checkpoint)
    photographs = len(photograph_files(arguments.data))
    card["distilled"] = {**spent, "batch": config.batch, "photographs": photographs, **provenance(config.seed)}
    with tempfile.TemporaryDirectory() as folder:
        unmeasured = Path(folder) / output.name
        for quantity, difference in export_distilled(model, encoder, trained, card, unmeasured).items():
            print(f"{quantity}: {difference:.1e}")
        measured = encoder_record(Encoder.open(unmeasured, threads=1), arguments.data, "test", config.seed)
    card["figures"] |= figures(list(measured.evaluations))
    export_distilled(model, encoder, trained, card, output)
    write_page(card, trained.spec.size, output)
