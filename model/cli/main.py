"""`hof-model`: build data, train, evaluate, export. One subcommand per stage."""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from model.cli.data import DATA, add_stages
from service.errors import HofError

if TYPE_CHECKING:
    from service.mapping.spec import MappingSpec

RUN: Final = Path("runs/hof1-k2")
SHIPPED: Final = Path(__file__).resolve().parents[1] / "weights" / "hof1-k2.onnx"
ROOT: Final = Path(__file__).resolve().parents[2]
SPLITS: Final = ("train", "val", "test")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one stage; its modules are imported only then. Returns the exit status."""
    arguments = _parser().parse_args(argv)
    try:
        run = arguments.run
        run(arguments)
    except (OSError, ValueError, HofError) as error:
        print(f"hof-model: {error}", file=sys.stderr)
        return 2
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="hof-model", description=__doc__)
    stages = parser.add_subparsers(required=True, metavar="STAGE")
    add_stages(stages.add_parser("data", help="build or look at a data set").add_subparsers(required=True))
    _add_train(stages.add_parser("train", help="train an image encoder; an existing run is resumed"))
    _add_evaluate(stages.add_parser("evaluate", help="print the figures of a trained model, or write its raw metrics"))
    stage = stages.add_parser("blend", help="the mean of a run's weights and a later one's, as a run")
    stage.set_defaults(run=_blend)
    stage.add_argument("first", type=Path, metavar="RUN", help="or an exported model")
    stage.add_argument("later", type=Path, metavar="LATER", help="one that started from it")
    stage.add_argument("--share", type=float, default=0.5, help="of the later run's weights")
    stage.add_argument("-o", "--out", type=Path, required=True, help="folder of the run that is written")
    stage = stages.add_parser("color", help="train the colour head of a trained run, whose encoder stays as it is")
    stage.set_defaults(run=_color)
    _add_common(stage)
    stage.add_argument("--run", type=Path, default=RUN, dest="folder")
    stage.add_argument("--minutes", type=float, default=12.0)
    stage = stages.add_parser("export", help="checkpoint -> ONNX with its model card; evaluates it on the test split")
    stage.set_defaults(run=_export)
    _add_common(stage)
    stage.add_argument("--run", type=Path, default=RUN, dest="folder")
    stage.add_argument("-o", "--output", type=Path, default=SHIPPED)
    stage = stages.add_parser("retrain", help="train and measure what the shipped model is compared with; resumable")
    stage.set_defaults(run=_retrain)
    _add_common(stage)
    stage.add_argument("methods", nargs="*", metavar="METHOD", help="of model/evaluation/compared.py; default: all")
    stage.add_argument("--steps", type=int, default=1_500, help="of each")
    stage.add_argument("-o", "--output", type=Path, default=ROOT / "model" / "results", help="folder of the records")
    _add_results(stages)
    return parser


def _add_results(stages: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """The stages that measure exported models for RESULTS.md."""
    stage = stages.add_parser("mixtures", help="measure words of two objects against the mean of their thetas")
    stage.set_defaults(run=_mixtures)
    stage.add_argument("--model", type=Path, default=SHIPPED, help="an exported encoder, k of 2 or more")
    _add_measured(stage, "model/results")
    stage = stages.add_parser("surfaces", help="measure ways to make a surface, for RESULTS.md")
    stage.set_defaults(run=_surfaces)
    stage.add_argument("--model", type=Path, default=SHIPPED)
    _add_measured(stage, "model/results/surfaces.json")
    stage = stages.add_parser("results", help="evaluate the shipped weights, write RESULTS.md")
    stage.set_defaults(run=_results)
    stage.add_argument(
        "--model",
        type=Path,
        action="append",
        help="the model of the page; again: others beside it; default: all shipped",
    )
    _add_measured(stage, "RESULTS.md, model/results")


def _add_measured(stage: argparse.ArgumentParser, written: str) -> None:
    _add_common(stage)
    stage.add_argument("--split", choices=SPLITS, default="test")
    stage.add_argument("-o", "--out", type=Path, default=ROOT, help=f"the folder that gets {written}")


def _add_evaluate(stage: argparse.ArgumentParser) -> None:
    stage.set_defaults(run=_evaluate)
    _add_common(stage)
    stage.add_argument("--model", type=Path, default=SHIPPED, help="an exported encoder")
    stage.add_argument("--run", type=Path, dest="folder", help="instead: a run of `hof-model train`, any method")
    stage.add_argument("--ceiling", action="store_true", help="instead: theta fitted to each object, the model's spec")
    stage.add_argument("--references", action="store_true", help="also the answers that need no training")
    stage.add_argument("--photographs", action="store_true", help="with --run: also in front of photographs")
    stage.add_argument("--split", choices=SPLITS, default="val")
    stage.add_argument("-o", "--output", type=Path, help="write the raw metrics (JSON); the name counts for --run")
    stage.add_argument("--picture", type=Path, help="write a contact sheet of the model's predictions")


def _add_common(stage: argparse.ArgumentParser) -> None:
    stage.add_argument("--data", type=Path, default=DATA, help="folder that `hof-model data build` wrote")
    stage.add_argument("--seed", type=int, default=0)


def _add_train(stage: argparse.ArgumentParser) -> None:
    stage.set_defaults(run=_train)
    _add_common(stage)
    stage.add_argument("--run", type=Path, default=RUN, dest="folder", help="where checkpoints, log and plot go")
    stage.add_argument("--minutes", type=float, default=64.0)
    stage.add_argument("--steps", type=int, help="budget in steps, instead of minutes")
    stage.add_argument("--start", type=Path, help="checkpoint or exported model whose weights a new run starts from")
    stage.add_argument("--method", choices=("hof", "deepsdf", "foldingnet", "direct"), default="hof")
    stage.add_argument("--mapping", choices=("HOF-1", "HOF-3"), default="HOF-1")
    stage.add_argument("--hidden", type=int, nargs="+", help="hidden widths, instead of the mapping's own")
    stage.add_argument("--activation", choices=("relu", "tanh"), default="relu")
    stage.add_argument("--k", type=int, default=2)
    stage.add_argument(
        "--domain", choices=("ball", "sphere", "ball4", "cube"), help="default: ball; cube for foldingnet"
    )
    stage.add_argument("--trunk", choices=("dense", "lite0"), default="dense", help="lite0: pretrained, at 128 pixels")
    stage.add_argument("--rank", type=int, default=256, help="bottleneck before theta; 0 is the paper's full rank")
    stage.add_argument("--batch", type=int, default=32)
    stage.add_argument("--learning-rate", type=float, default=7e-4)
    stage.add_argument("--pretrained-rate", type=float, default=0.3, help="share of it that pretrained layers have")
    stage.add_argument("--projection", type=float, default=0.0, help="lambda of the projection regularisation")
    stage.add_argument("--variants", action="store_true", help="train on the stretched shapes too")
    stage.add_argument("--own-share", type=float, default=0.0, help="of an object's draws, set aside for its own shape")
    stage.add_argument("--made", action="store_true", help="train on the furniture made by rule too")
    stage.add_argument(
        "--late-from",
        type=float,
        default=1.0,
        help="share of the budget after which the loss is cd_epcg with an F-score-like term; 1: never",
    )
    stage.add_argument("--late-points", type=int, default=1_536, help="predicted points in the loss from there on")
    stage.add_argument("--late-target-points", type=int, default=10_000, help="true points likewise")


def _spec(arguments: argparse.Namespace) -> "MappingSpec":
    """The mapping function that the options of `train` ask for."""
    from service.mapping.spec import DOMAIN_DIMS, HOF_1, HOF_3, Domain

    known = {"HOF-1": HOF_1, "HOF-3": HOF_3}[arguments.mapping]
    domain: Domain = arguments.domain or ("cube" if arguments.method == "foldingnet" else "ball")
    return replace(
        known,
        name="-".join(["MLP", *map(str, arguments.hidden)]) if arguments.hidden else known.name,
        hidden=tuple(arguments.hidden or known.hidden),
        activation=arguments.activation,
        input_dim=DOMAIN_DIMS[domain],
        domain=domain,
        k=arguments.k,
    )


def _train(arguments: argparse.Namespace) -> None:
    from model.config import DENSE, LITE0, TrainConfig
    from model.training.log import plot_losses
    from model.training.train import train
    from service.encoding.framing import Framing

    encoder, framing = {"dense": (DENSE, Framing()), "lite0": (LITE0, Framing(128))}[arguments.trunk]
    config = TrainConfig(
        spec=_spec(arguments),
        encoder=replace(encoder, rank=arguments.rank),
        framing=framing,
        seed=arguments.seed,
        batch=arguments.batch,
        learning_rate=arguments.learning_rate,
        pretrained_rate=arguments.pretrained_rate,
        projection=arguments.projection,
        minutes=arguments.minutes,
        steps=arguments.steps,
        method=arguments.method,
        late_from=arguments.late_from,
        late_points=arguments.late_points,
        late_target_points=arguments.late_target_points,
        variants=arguments.variants,
        own_share=arguments.own_share,
        made=arguments.made,
        start=str(arguments.start) if arguments.start else None,
    )
    checkpoint = train(arguments.data, arguments.folder, config)
    plot_losses(arguments.folder, arguments.folder / "loss.png")
    print(checkpoint)


def _blend(arguments: argparse.Namespace) -> None:
    from model.training.average import blend

    print(blend(arguments.first, arguments.later, arguments.share, arguments.out))


def _color(arguments: argparse.Namespace) -> None:
    from model.training.train_color import train_color

    print(train_color(arguments.data, arguments.folder, arguments.minutes, arguments.seed))


def _evaluate(arguments: argparse.Namespace) -> None:
    from model.evaluation import comparison
    from model.evaluation.conditions import Condition
    from model.evaluation.evaluate import cases
    from model.report.sheets import first_objects
    from model.report.tables import card_table
    from service.encoding.encoder import Encoder

    if arguments.folder and (arguments.ceiling or arguments.picture):
        raise ValueError("--ceiling and --picture are of an exported model: leave out --run")
    if arguments.photographs and not arguments.folder:
        raise ValueError("--photographs goes with --run; `hof-model results` does it for exported models")
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


def _retrain(arguments: argparse.Namespace) -> None:
    from model.evaluation.compared import COMPARED, retrain

    for name in arguments.methods or COMPARED:
        print(retrain(name, arguments.data, "test", arguments.output, arguments.steps, arguments.seed))


def _export(arguments: argparse.Namespace) -> None:
    from model.data.manifest import Manifest
    from model.evaluation.comparison import encoder_record, references
    from model.export import export
    from model.files import whole_file
    from model.networks.color_head import load
    from model.report.card import figures, make_card, page
    from model.training.checkpoints import chosen_checkpoint, load_encoder
    from service.encoding.encoder import Encoder

    trained, config, run = load_encoder(chosen_checkpoint(arguments.folder))
    color, coloured = load(arguments.folder, trained, config.spec) or (None, None)
    output: Path = arguments.output
    card = make_card(output.stem, config, run, Manifest.read(arguments.data), coloured)
    with tempfile.TemporaryDirectory() as folder:
        unmeasured = Path(folder) / output.name
        for what, difference in export(trained, config, card, unmeasured, color).items():
            print(f"{what}: {difference:.1e}")
        encoder = Encoder.open(unmeasured, threads=1)
        measured = encoder_record(encoder, arguments.data, "test", arguments.seed).evaluations
    card["figures"] = figures([*measured, *references(arguments.data, "test", arguments.seed)])
    export(trained, config, card, output, color)
    with whole_file(output.with_suffix(".md")) as file:
        file.write(page(card, config.spec.size, output.stat().st_size).encode())
    print(f"{output}: {output.stat().st_size:,} bytes")


def _mixtures(arguments: argparse.Namespace) -> None:
    from model.report.mixtures import write
    from service.encoding.encoder import Encoder

    encoder = Encoder.open(arguments.model, threads=1)
    print(write(encoder, arguments.data, arguments.split, arguments.out, arguments.seed))


def _surfaces(arguments: argparse.Namespace) -> None:
    from model.evaluation.surfaces import FILE, measure_surfaces, section
    from model.report.page import FOLDER

    found = measure_surfaces(arguments.model, arguments.data, arguments.split, arguments.seed)
    found.write(arguments.out / FOLDER / FILE)
    print(section(found))


def _results(arguments: argparse.Namespace) -> None:
    from model.report.page import report

    models = arguments.model or [SHIPPED, *sorted(set(SHIPPED.parent.glob("*.onnx")) - {SHIPPED})]
    print(report(models, arguments.data, arguments.split, arguments.out, arguments.seed))


if __name__ == "__main__":
    sys.exit(main())
