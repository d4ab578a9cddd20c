"""`hof-model`: build data, train, evaluate, export. One subcommand per stage."""

import argparse
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from service.errors import HofError

if TYPE_CHECKING:
    from model.data.meshes import MeshRecord

DATA: Final = Path("data/sweethome3d")
RUN: Final = Path("runs/hof1-k2")
SHIPPED: Final = Path(__file__).resolve().parent / "weights" / "hof1-k2.onnx"
ROOT: Final = Path(__file__).resolve().parent.parent


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
    _add_data(stages.add_parser("data", help="build or look at a data set").add_subparsers(required=True))
    _add_train(stages.add_parser("train", help="train an image encoder; an existing run is resumed"))
    _add_evaluate(stages.add_parser("evaluate", help="print the figures of a trained model, or write its raw metrics"))
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
    stage.add_argument("methods", nargs="*", metavar="METHOD", help="of model/retrain.py; default: all")
    stage.add_argument("--steps", type=int, default=3_000, help="of each")
    stage.add_argument("-o", "--output", type=Path, default=ROOT / "model" / "results", help="folder of the records")
    stage = stages.add_parser("mixtures", help="measure words of two objects against the mean of their thetas")
    stage.set_defaults(run=_mixtures)
    _add_common(stage)
    stage.add_argument("--model", type=Path, default=SHIPPED, help="an exported encoder, k of 2 or more")
    stage.add_argument("--split", choices=("train", "val", "test"), default="test")
    stage.add_argument("-o", "--out", type=Path, default=ROOT, help="the folder that gets model/results")
    stage = stages.add_parser("surfaces", help="measure ways to make a surface, for RESULTS.md")
    stage.set_defaults(run=_surfaces)
    _add_common(stage)
    stage.add_argument("--model", type=Path, default=SHIPPED)
    stage.add_argument("--split", choices=("train", "val", "test"), default="test")
    stage.add_argument("-o", "--out", type=Path, default=ROOT, help="the folder that gets model/results/surfaces.json")
    stage = stages.add_parser("results", help="evaluate the shipped weights, write RESULTS.md")
    stage.set_defaults(run=_results)
    _add_common(stage)
    stage.add_argument(
        "--model",
        type=Path,
        action="append",
        help="the model of the page; again: others beside it; default: all shipped",
    )
    stage.add_argument("--split", choices=("train", "val", "test"), default="test")
    stage.add_argument("-o", "--out", type=Path, default=ROOT, help="the folder that gets RESULTS.md, model/results")
    return parser


def _add_evaluate(stage: argparse.ArgumentParser) -> None:
    stage.set_defaults(run=_evaluate)
    _add_common(stage)
    stage.add_argument("--model", type=Path, default=SHIPPED, help="an exported encoder")
    stage.add_argument("--run", type=Path, dest="folder", help="instead: a run of `hof-model train`, any method")
    stage.add_argument("--ceiling", action="store_true", help="instead: theta fitted to each object, the model's spec")
    stage.add_argument("--references", action="store_true", help="also the answers that need no training")
    stage.add_argument("--split", choices=("train", "val", "test"), default="val")
    stage.add_argument("-o", "--output", type=Path, help="write the raw metrics (JSON); the name counts for --run")
    stage.add_argument("--picture", type=Path, help="write a contact sheet of the model's predictions")


def _add_common(stage: argparse.ArgumentParser) -> None:
    stage.add_argument("--data", type=Path, default=DATA, help="folder that `hof-model data build` wrote")
    stage.add_argument("--seed", type=int, default=0)


def _add_data(data: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    build = data.add_parser("build", help="render meshes, drop duplicates, split")
    build.set_defaults(run=_build)
    build.add_argument("--out", type=Path, default=DATA)
    build.add_argument("--sh3f", type=Path, help="folder of .sh3f files, or the .deb; default: download it")
    build.add_argument("--meshes", type=Path, help="a folder of OBJ/GLB/PLY/STL/OFF instead of Sweet Home 3D")
    build.add_argument("--licence", default="unknown", help="licence of --meshes, written to the manifest")
    build.add_argument("--limit", type=int, help="only the first LIMIT meshes")
    build.add_argument("--seed", type=int, default=0)
    build.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    vary = data.add_parser("vary", help="render free cameras and stretched shapes of a built data set")
    vary.set_defaults(run=_vary, licence="unknown")  # the manifest has the licence
    vary.add_argument("--data", type=Path, default=DATA)
    vary.add_argument("--sh3f", type=Path, help="as for build")
    vary.add_argument("--meshes", type=Path, help="as for build")
    vary.add_argument("--variants", type=int, default=4, help="stretched shapes per training object")
    vary.add_argument("--views", type=int, default=12, help="per shape")
    vary.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    preview = data.add_parser("preview", help="write a contact sheet of views and points")
    preview.set_defaults(run=_preview)
    preview.add_argument("--data", type=Path, default=DATA)
    preview.add_argument("-o", "--output", type=Path, default=Path("out/preview.png"))
    preview.add_argument("--objects", type=int, default=24)
    preview.add_argument("--variants", action="store_true", help="what `vary` wrote, one row per variant")


def _add_train(stage: argparse.ArgumentParser) -> None:
    stage.set_defaults(run=_train)
    _add_common(stage)
    stage.add_argument("--run", type=Path, default=RUN, dest="folder", help="where checkpoints, log and plot go")
    stage.add_argument("--minutes", type=float, default=64.0)
    stage.add_argument("--steps", type=int, help="budget in steps, instead of minutes")
    stage.add_argument("--start", type=Path, help="checkpoint whose weights a new run starts from")
    stage.add_argument("--method", choices=("hof", "deepsdf", "foldingnet", "direct"), default="hof")
    stage.add_argument("--mapping", choices=("HOF-1", "HOF-3"), default="HOF-1")
    stage.add_argument("--hidden", type=int, nargs="+", help="hidden widths, instead of the mapping's own")
    stage.add_argument("--activation", choices=("relu", "tanh"), default="relu")
    stage.add_argument("--k", type=int, default=2)
    stage.add_argument(
        "--domain", choices=("ball", "sphere", "ball4", "cube"), help="default: ball; cube for foldingnet"
    )
    stage.add_argument("--rank", type=int, default=256, help="bottleneck before theta; 0 is the paper's full rank")
    stage.add_argument("--batch", type=int, default=32)
    stage.add_argument("--learning-rate", type=float, default=7e-4)
    stage.add_argument("--projection", type=float, default=0.0, help="lambda of the projection regularisation")
    stage.add_argument("--variants", action="store_true", help="train on the stretched shapes too")
    stage.add_argument(
        "--late-from",
        type=float,
        default=1.0,
        help="share of the budget after which the loss is cd_epcg with an F-score-like term; 1: never",
    )
    stage.add_argument("--late-points", type=int, default=1_536, help="predicted points in the loss from there on")
    stage.add_argument("--late-target-points", type=int, default=3_000, help="true points likewise")


def _build(arguments: argparse.Namespace) -> None:
    from model.data.build import build

    records = _records(arguments, arguments.out)
    manifest = build(records[: arguments.limit], arguments.out, arguments.seed, arguments.processes)
    sizes = {split: sum(1 for _ in manifest.of(split)) for split in ("train", "val", "test")}
    print(f"{sizes}, {len(manifest.duplicates)} duplicates, {len(manifest.failures)} failures: {arguments.out}")


def _records(arguments: argparse.Namespace, folder: Path) -> "list[MeshRecord]":
    """The meshes of `--meshes`, else Sweet Home 3D's, unpacked below `folder`."""
    from model.data.meshes import folder_records
    from model.data.sweethome3d import sh3f_files, sh3f_records

    if arguments.meshes:
        return list(folder_records(arguments.meshes, arguments.licence))
    work = folder / "source"
    return [record for file in sh3f_files(arguments.sh3f, work) for record in sh3f_records(file, work)]


def _vary(arguments: argparse.Namespace) -> None:
    from model.data.manifest import VARIANTS
    from model.data.variants import vary

    records = _records(arguments, arguments.data)
    failures = vary(records, arguments.data, arguments.variants, arguments.views, arguments.processes)
    print(f"{len(failures)} failures: {arguments.data / VARIANTS}")


def _preview(arguments: argparse.Namespace) -> None:
    from model.data.preview import preview

    preview(arguments.data, arguments.output, arguments.objects, arguments.variants)
    print(arguments.output)


def _train(arguments: argparse.Namespace) -> None:
    from model.config import EncoderConfig, TrainConfig
    from model.train import plot_losses, train
    from service.mapping import DOMAIN_DIMS, HOF_1, HOF_3, Domain

    known = {"HOF-1": HOF_1, "HOF-3": HOF_3}[arguments.mapping]
    domain: Domain = arguments.domain or ("cube" if arguments.method == "foldingnet" else "ball")
    spec = replace(
        known,
        name="-".join(["MLP", *map(str, arguments.hidden)]) if arguments.hidden else known.name,
        hidden=tuple(arguments.hidden or known.hidden),
        activation=arguments.activation,
        input_dim=DOMAIN_DIMS[domain],
        domain=domain,
        k=arguments.k,
    )
    config = TrainConfig(
        spec=spec,
        encoder=EncoderConfig(rank=arguments.rank),
        seed=arguments.seed,
        batch=arguments.batch,
        learning_rate=arguments.learning_rate,
        projection=arguments.projection,
        minutes=arguments.minutes,
        steps=arguments.steps,
        method=arguments.method,
        late_from=arguments.late_from,
        late_points=arguments.late_points,
        late_target_points=arguments.late_target_points,
        variants=arguments.variants,
        start=str(arguments.start) if arguments.start else None,
    )
    checkpoint = train(arguments.data, arguments.folder, config)
    plot_losses(arguments.folder, arguments.folder / "loss.png")
    print(checkpoint)


def _color(arguments: argparse.Namespace) -> None:
    from model.train_color import train_color

    print(train_color(arguments.data, arguments.folder, arguments.minutes, arguments.seed))


def _evaluate(arguments: argparse.Namespace) -> None:
    from model import comparison
    from model.evaluate import cases
    from model.sheets import first_objects
    from model.tables import card_table
    from service.encoder import Encoder

    of = (arguments.data, arguments.split, arguments.seed)
    if arguments.folder:
        name = arguments.output.stem if arguments.output else arguments.folder.name
        record = comparison.run_record(arguments.folder, name, *of)
    else:
        encoder = Encoder.open(arguments.model, threads=1)
        record = (comparison.ceiling_record if arguments.ceiling else comparison.encoder_record)(encoder, *of)
    if arguments.output:
        record.write(arguments.output)
    print(card_table([*record.evaluations, *(comparison.references(*of) if arguments.references else [])]))
    if arguments.picture:
        encoder = Encoder.open(arguments.model, threads=1)
        arguments.picture.parent.mkdir(parents=True, exist_ok=True)
        first_objects(encoder, list(cases(arguments.data, arguments.split))).save(arguments.picture)
        print(arguments.picture)


def _retrain(arguments: argparse.Namespace) -> None:
    from model.retrain import COMPARED, retrain

    for name in arguments.methods or COMPARED:
        print(retrain(name, arguments.data, "test", arguments.output, arguments.steps, arguments.seed))


def _export(arguments: argparse.Namespace) -> None:
    from model.card import figures, make_card, page
    from model.checkpoints import chosen_checkpoint, load_encoder
    from model.color import load
    from model.comparison import encoder_record, references
    from model.data.manifest import Manifest
    from model.export import export
    from service.encoder import Encoder

    trained, config, run = load_encoder(chosen_checkpoint(arguments.folder))
    color, coloured = load(arguments.folder, trained, config.spec) or (None, None)
    output: Path = arguments.output
    card = make_card(output.stem, config, run, Manifest.read(arguments.data), coloured)
    for what, difference in export(trained, config, card, output, color).items():
        print(f"{what}: {difference:.1e}")
    measured = encoder_record(Encoder.open(output, threads=1), arguments.data, "test", arguments.seed).evaluations
    card["figures"] = figures([*measured, *references(arguments.data, "test", arguments.seed)])
    export(trained, config, card, output, color)
    card_page = page(card, config.spec.size, output.stat().st_size)
    output.with_suffix(".md").write_text(card_page, encoding="utf-8")
    print(f"{output}: {output.stat().st_size:,} bytes")


def _mixtures(arguments: argparse.Namespace) -> None:
    from model.mixture_report import write
    from service.encoder import Encoder

    encoder = Encoder.open(arguments.model, threads=1)
    print(write(encoder, arguments.data, arguments.split, arguments.out, arguments.seed))


def _surfaces(arguments: argparse.Namespace) -> None:
    from model.report import FOLDER
    from model.surfaces import FILE, measure_surfaces, section

    found = measure_surfaces(arguments.model, arguments.data, arguments.split, arguments.seed)
    found.write(arguments.out / FOLDER / FILE)
    print(section(found))


def _results(arguments: argparse.Namespace) -> None:
    from model.report import report

    models = arguments.model or [SHIPPED, *sorted(set(SHIPPED.parent.glob("*.onnx")) - {SHIPPED})]
    print(report(models, arguments.data, arguments.split, arguments.out, arguments.seed))


if __name__ == "__main__":
    sys.exit(main())
