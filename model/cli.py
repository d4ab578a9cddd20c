"""`hof-model`: build data, train, evaluate, export. One subcommand per stage."""

import argparse
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from service.errors import HofError

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
    stage = stages.add_parser("evaluate", help="print the figures of an exported encoder")
    stage.set_defaults(run=_evaluate)
    _add_common(stage)
    stage.add_argument("--model", type=Path, default=SHIPPED)
    stage.add_argument("--split", choices=("train", "val", "test"), default="val")
    stage.add_argument("--picture", type=Path, help="write a contact sheet of image, truth and prediction")
    stage = stages.add_parser("export", help="checkpoint -> ONNX with its model card; evaluates it on the test split")
    stage.set_defaults(run=_export)
    _add_common(stage)
    stage.add_argument("--run", type=Path, default=RUN, dest="folder")
    stage.add_argument("-o", "--output", type=Path, default=SHIPPED)
    stage = stages.add_parser("results", help="evaluate the shipped weights, write RESULTS.md")
    stage.set_defaults(run=_results)
    _add_common(stage)
    stage.add_argument("--model", type=Path, default=SHIPPED)
    return parser


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
    preview = data.add_parser("preview", help="write a contact sheet of views and points")
    preview.set_defaults(run=_preview)
    preview.add_argument("--data", type=Path, default=DATA)
    preview.add_argument("-o", "--output", type=Path, default=Path("out/preview.png"))
    preview.add_argument("--objects", type=int, default=24)


def _add_train(stage: argparse.ArgumentParser) -> None:
    stage.set_defaults(run=_train)
    _add_common(stage)
    stage.add_argument("--run", type=Path, default=RUN, dest="folder", help="where checkpoints, log and plot go")
    stage.add_argument("--minutes", type=float, default=64.0)
    stage.add_argument("--mapping", choices=("HOF-1", "HOF-3"), default="HOF-1")
    stage.add_argument("--hidden", type=int, nargs="+", help="hidden widths, instead of the mapping's own")
    stage.add_argument("--activation", choices=("relu", "tanh"), default="relu")
    stage.add_argument("--k", type=int, default=2)
    stage.add_argument("--domain", choices=("ball", "sphere", "ball4", "cube"), default="ball")
    stage.add_argument("--rank", type=int, default=256, help="bottleneck before theta; 0 is the paper's full rank")
    stage.add_argument("--batch", type=int, default=32)
    stage.add_argument("--learning-rate", type=float, default=7e-4)
    stage.add_argument("--projection", type=float, default=0.0, help="lambda of the projection regularisation")


def _build(arguments: argparse.Namespace) -> None:
    from model.data.build import build
    from model.data.meshes import folder_records
    from model.data.sweethome3d import sh3f_files, sh3f_records

    if arguments.meshes:
        records = list(folder_records(arguments.meshes, arguments.licence))
    else:
        work = arguments.out / "source"
        records = [record for file in sh3f_files(arguments.sh3f, work) for record in sh3f_records(file, work)]
    manifest = build(records[: arguments.limit], arguments.out, arguments.seed, arguments.processes)
    sizes = {split: sum(1 for _ in manifest.of(split)) for split in ("train", "val", "test")}
    print(f"{sizes}, {len(manifest.duplicates)} duplicates, {len(manifest.failures)} failures: {arguments.out}")


def _preview(arguments: argparse.Namespace) -> None:
    from model.data.preview import preview

    preview(arguments.data, arguments.output, arguments.objects)
    print(arguments.output)


def _train(arguments: argparse.Namespace) -> None:
    from model.config import EncoderConfig, TrainConfig
    from model.train import plot_losses, train
    from service.mapping import DOMAIN_DIMS, HOF_1, HOF_3

    known = {"HOF-1": HOF_1, "HOF-3": HOF_3}[arguments.mapping]
    spec = replace(
        known,
        name="-".join(["MLP", *map(str, arguments.hidden)]) if arguments.hidden else known.name,
        hidden=tuple(arguments.hidden or known.hidden),
        activation=arguments.activation,
        input_dim=DOMAIN_DIMS[arguments.domain],
        domain=arguments.domain,
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
    )
    checkpoint = train(arguments.data, arguments.folder, config)
    plot_losses(arguments.folder, arguments.folder / "loss.png")
    print(checkpoint)


def _evaluate(arguments: argparse.Namespace) -> None:
    from model.evaluate import evaluate
    from model.report import contact_sheet, table
    from service.encoder import Encoder

    encoder = Encoder.open(arguments.model, threads=os.cpu_count() or 1)
    print(table(evaluate(encoder, arguments.data, arguments.split, arguments.seed)))
    if arguments.picture:
        arguments.picture.parent.mkdir(parents=True, exist_ok=True)
        contact_sheet(encoder, arguments.data, arguments.split).save(arguments.picture)
        print(arguments.picture)


def _export(arguments: argparse.Namespace) -> None:
    from model.card import figures, make_card, page
    from model.data.manifest import Manifest
    from model.evaluate import evaluate
    from model.export import export
    from model.train import load_encoder
    from service.encoder import Encoder

    trained, config, run = load_encoder(arguments.folder / "last.pt")
    output: Path = arguments.output
    card = make_card(output.stem, config, run, Manifest.read(arguments.data))
    for what, difference in export(trained, config, card, output).items():
        print(f"{what}: {difference:.1e}")
    exported = Encoder.open(output, threads=os.cpu_count() or 1)
    card["figures"] = figures(evaluate(exported, arguments.data, "test", arguments.seed))
    export(trained, config, card, output)
    card_page = page(card, config.spec.size, output.stat().st_size)
    (output.parent / "README.md").write_text(card_page, encoding="utf-8")
    print(f"{output}: {output.stat().st_size:,} bytes")


def _results(arguments: argparse.Namespace) -> None:
    from model.report import report, table
    from service.encoder import Encoder

    encoder = Encoder.open(arguments.model, threads=os.cpu_count() or 1)
    print(table(report(encoder, arguments.data, "test", ROOT, arguments.seed)))


if __name__ == "__main__":
    sys.exit(main())
