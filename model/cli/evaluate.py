"""`hof-model evaluate`, `export`, `mixtures`, `surfaces`, `results`: measure trained models and export them."""

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from model.cli.common import ROOT, SHIPPED, SHIPPED_MATTE, SHIPPED_POINTS, add_data, add_run, add_seed
from model.data.manifest import SPLITS

if TYPE_CHECKING:
    from model.evaluation.conditions import Condition


def add_stages(stages: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the stages: each sets `run`, a function of the parsed arguments."""
    _add_evaluate(stages.add_parser("evaluate", help="print the metrics of a trained model, or write raw metrics"))
    stage = stages.add_parser("export", help="write a run as ONNX with its model card, evaluated on the test split")
    stage.set_defaults(run=_export)
    add_data(stage)
    add_seed(stage)
    add_run(stage, "run to export")
    stage.add_argument(
        "-o", "--output", type=Path, default=SHIPPED, help="ONNX file to write; default: the shipped one"
    )
    stage = stages.add_parser("mixtures", help="compare words of two objects with the mean of their thetas")
    stage.set_defaults(run=_mixtures)
    stage.add_argument(
        "--model", type=Path, default=SHIPPED, help="exported encoder with k >= 2; default: the shipped one"
    )
    _add_report(stage, "model/results/mixtures")
    stage = stages.add_parser("surfaces", help="measure surface methods for RESULTS.md")
    stage.set_defaults(run=_surfaces)
    stage.add_argument("--model", type=Path, default=SHIPPED, help="exported encoder; default: the shipped one")
    _add_report(stage, "model/results/surfaces.json")
    stage = stages.add_parser("results", help="evaluate the shipped models and write RESULTS.md")
    stage.set_defaults(run=_results)
    stage.add_argument(
        "--model",
        type=Path,
        action="append",
        help="exported encoder; the first is the page's subject, repeat for others; default: all shipped",
    )
    _add_report(stage, "RESULTS.md and model/results")


def _add_report(stage: argparse.ArgumentParser, written: str) -> None:
    add_data(stage)
    add_seed(stage)
    stage.add_argument("--split", choices=SPLITS, default="test", help="split to measure on; default: test")
    stage.add_argument("-o", "--out", type=Path, default=ROOT, help=f"folder that receives {written}")


def _add_evaluate(stage: argparse.ArgumentParser) -> None:
    stage.set_defaults(run=_evaluate)
    add_data(stage)
    add_seed(stage)
    stage.add_argument("--model", type=Path, default=SHIPPED, help="exported encoder; default: the shipped one")
    stage.add_argument(
        "--run", type=Path, dest="folder", help="evaluate a run of `hof-model train` instead, any method"
    )
    stage.add_argument("--ceiling", action="store_true", help="fit theta to each object instead, with the model's spec")
    stage.add_argument("--references", action="store_true", help="add the references that need no training")
    stage.add_argument("--photographs", action="store_true", help="with --run: add views in front of photographs")
    stage.add_argument(
        "--protocol",
        choices=("project", "epcg"),
        default="project",
        help="epcg: the protocol of the paper's Table 1, on all views, with a table of classes",
    )
    stage.add_argument("--split", choices=SPLITS, default="val", help="split to measure on; default: val")
    stage.add_argument(
        "-o", "--output", type=Path, help="write the raw metrics (JSON); with --run its name is the label"
    )
    stage.add_argument("--picture", type=Path, help="write a contact sheet of the model's predictions")


def _evaluate_epcg(arguments: argparse.Namespace) -> None:
    from model.evaluation.comparison import network_answer
    from model.evaluation.epcg import measure_epcg
    from model.evaluation.evaluate import encoder_answer
    from model.evaluation.timing import mapping_decoder, network_decoder
    from model.report.epcg import section
    from model.training.checkpoints import chosen_checkpoint, load_network
    from service.encoding.encoder import Encoder

    if arguments.ceiling or arguments.references or arguments.photographs or arguments.picture:
        raise ValueError("--protocol epcg goes with --run or --model alone: leave out the other options")
    if arguments.folder:
        network, config, _ = load_network(chosen_checkpoint(arguments.folder))
        name, answer = arguments.folder.name, network_answer(arguments.folder, network, config, arguments.seed)
        decoder = network_decoder(network, config)
    else:
        encoder = Encoder.open(arguments.model, threads=1)
        name, answer, decoder = encoder.name, encoder_answer(encoder), mapping_decoder(encoder)
    record = measure_epcg(name, answer, decoder, arguments.data, arguments.split, arguments.seed)
    if arguments.output:
        record.write(arguments.output)
    print(section(record))


def _evaluate(arguments: argparse.Namespace) -> None:
    if arguments.protocol == "epcg":
        _evaluate_epcg(arguments)
        return
    from model.evaluation import comparison
    from model.evaluation.evaluate import cases
    from model.report.sheets import first_objects
    from model.report.tables import card_table
    from service.encoding.encoder import Encoder

    if arguments.folder and (arguments.ceiling or arguments.picture):
        raise ValueError("--ceiling and --picture need an exported model: leave out --run")
    if arguments.photographs and not arguments.folder:
        raise ValueError("--photographs needs --run; for exported models use `hof-model results`")
    of = (arguments.data, arguments.split, arguments.seed)
    if arguments.folder:
        name = arguments.output.stem if arguments.output else arguments.folder.name
        hard: tuple[Condition, ...] = ("photograph",) if arguments.photographs else ()
        record = comparison.run_record(arguments.folder, name, *of, ("plain", *hard))
    else:
        encoder = Encoder.open(arguments.model, threads=1)
        record = (comparison.ceiling_record if arguments.ceiling else comparison.encoder_record)(encoder, *of)
    if arguments.references:
        record = replace(record, evaluations=(*record.evaluations, *comparison.references(*of)))
    if arguments.output:
        record.write(arguments.output)
    print(card_table(record.evaluations))
    if arguments.picture:
        encoder = Encoder.open(arguments.model, threads=1)
        arguments.picture.parent.mkdir(parents=True, exist_ok=True)
        first_objects(encoder, list(cases(arguments.data, arguments.split))).save(arguments.picture)
        print(arguments.picture)


def _export(arguments: argparse.Namespace) -> None:
    from model.data.manifest import Manifest, piece_entries
    from model.evaluation.comparison import encoder_record, references
    from model.evaluation.paper.completion import measure_completion
    from model.export import export
    from model.networks.color_head import load
    from model.report.card import figures, make_card, write_page
    from model.training.checkpoints import chosen_checkpoint, load_encoder
    from service.encoding.encoder import Encoder

    trained, config, run = load_encoder(chosen_checkpoint(arguments.folder))
    color, color_training = load(arguments.folder, trained, config.spec) or (None, None)
    output: Path = arguments.output
    pieces = piece_entries(arguments.data) if config.made else ()
    card = make_card(output.stem, config, run, Manifest.read(arguments.data), color_training, pieces)
    with tempfile.TemporaryDirectory() as folder:
        unmeasured = Path(folder) / output.name
        for quantity, difference in export(trained, config, card, unmeasured, color).items():
            print(f"{quantity}: {difference:.1e}")
        encoder = Encoder.open(unmeasured, threads=1)
        if config.encoder.takes_points:
            evaluations = [measure_completion(encoder, arguments.data, "test", arguments.seed)]
        else:
            own = encoder_record(encoder, arguments.data, "test", arguments.seed).evaluations
            evaluations = [*own, *references(arguments.data, "test", arguments.seed)]
    card["figures"] = figures(evaluations)
    export(trained, config, card, output, color)
    write_page(card, config.spec.size, output)


def _mixtures(arguments: argparse.Namespace) -> None:
    from model.report.mixtures import write
    from service.encoding.encoder import Encoder

    encoder = Encoder.open(arguments.model, threads=1)
    print(write(encoder, arguments.data, arguments.split, arguments.out, arguments.seed))


def _surfaces(arguments: argparse.Namespace) -> None:
    from model.evaluation.locations import SURFACES
    from model.evaluation.surfaces import measure_surfaces
    from model.report.surfaces import section

    record = measure_surfaces(arguments.model, arguments.data, arguments.split, arguments.seed)
    record.write(arguments.out / SURFACES)
    print(section(record))


def _results(arguments: argparse.Namespace) -> None:
    from model.report.results import report
    from service.encoding.matting import Matting

    others = set(SHIPPED.parent.glob("*.onnx")) - {SHIPPED, SHIPPED_POINTS, SHIPPED_MATTE}
    models = arguments.model or [SHIPPED, *sorted(others)]
    matting = Matting.of(SHIPPED_MATTE, threads=1)
    print(report(models, arguments.data, arguments.split, arguments.out, arguments.seed, matting))
