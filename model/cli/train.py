"""`hof-model train`, `blend`, `color`, `retrain`: everything that trains."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from model.cli.common import ROOT, RUN, add_data, add_run, add_seed

if TYPE_CHECKING:
    from service.mapping.spec import MappingSpec


def add_stages(stages: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the stages: each sets `run`, a function of the parsed arguments."""
    _add_train(stages.add_parser("train", help="train an image encoder; an existing run is resumed"))
    stage = stages.add_parser("blend", help="average the weights of a run and a later one")
    stage.set_defaults(run=_blend)
    stage.add_argument("first", type=Path, metavar="RUN", help="folder of a run, or an exported model")
    stage.add_argument("later", type=Path, metavar="LATER", help="a run that started from it, or its exported model")
    stage.add_argument(
        "--share", type=float, default=0.5, help="weight of LATER in the mean, from 0 to 1; default: 0.5"
    )
    stage.add_argument("-o", "--out", type=Path, required=True, help="folder of the run to write")
    stage = stages.add_parser("color", help="train the color head of a trained run; its encoder stays unchanged")
    stage.set_defaults(run=_color)
    add_data(stage)
    add_seed(stage)
    add_run(stage, "run whose chosen checkpoint gets the head")
    stage.add_argument("--minutes", type=float, default=12.0)
    stage = stages.add_parser("retrain", help="train and measure the methods of the comparison; resumable")
    stage.set_defaults(run=_retrain)
    add_data(stage)
    add_seed(stage)
    stage.add_argument("methods", nargs="*", metavar="METHOD", help="of model/evaluation/compared.py; default: all")
    stage.add_argument("--steps", type=int, default=1_500, help="of each")
    stage.add_argument("-o", "--output", type=Path, default=ROOT / "model" / "results", help="folder of the records")


def _add_train(stage: argparse.ArgumentParser) -> None:
    stage.set_defaults(run=_train)
    add_data(stage)
    add_seed(stage)
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


def _retrain(arguments: argparse.Namespace) -> None:
    from model.evaluation.compared import COMPARED, retrain

    for name in arguments.methods or COMPARED:
        print(retrain(name, arguments.data, "test", arguments.output, arguments.steps, arguments.seed))
