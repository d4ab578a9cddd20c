"""`hof-model paper`: experiments of the paper, and the page that reports them."""

import argparse
from pathlib import Path
from typing import Final

from model.cli.common import ROOT, SHIPPED, add_data, add_seed
from model.cli.data import add_source, records_of
from model.cli.fit import STEPS
from model.cli.flags import number
from model.cli.suites import add_suites
from model.data.manifest import SPLITS

FIT: Final = "fit"
LATENT: Final = "latent"
PATHS: Final = "paths"
VIEWS: Final = "views"
PAGE: Final = "page"


def add_stage(stages: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the stage: each experiment sets `run`, a function of the parsed arguments."""
    stage = stages.add_parser("paper", help="repeat an experiment of the paper, and write PAPER.md")
    experiments = stage.add_subparsers(required=True, metavar="NAME")
    page = experiments.add_parser(PAGE, help="write PAPER.md from the records alone")
    page.set_defaults(run=_page)
    _add_out(page)
    latent = experiments.add_parser(LATENT, help="a concatenated latent vector equals a bias of the first layer")
    latent.set_defaults(run=_latent)
    add_seed(latent)
    _add_out(latent)
    paths = experiments.add_parser(PATHS, help="collision-free paths, planned on predictions, checked on the truth")
    paths.set_defaults(run=_paths)
    _add_measured(paths)
    paths.add_argument(
        "--run",
        type=Path,
        action="append",
        default=[],
        dest="folders",
        help="a run of `hof-model train` to measure, too; repeat for several",
    )
    _add_fit(experiments.add_parser(FIT, help="theta fitted to meshes, against compressed meshes of as many bytes"))
    views = experiments.add_parser(VIEWS, help="several views of one object, aggregated into one shape")
    views.set_defaults(run=_views)
    _add_measured(views)
    add_suites(experiments)


def _add_fit(stage: argparse.ArgumentParser) -> None:
    stage.set_defaults(run=_fit)
    add_source(stage)
    add_seed(stage)
    stage.add_argument("--split", choices=SPLITS, default="test", help="split to measure on; default: test")
    stage.add_argument("--objects", type=number(int, least=1), default=10, help="number of objects; default: 10")
    stage.add_argument("--steps", type=number(int, least=1), default=STEPS, help=f"steps of the fit; default: {STEPS}")
    _add_out(stage)


def _add_measured(stage: argparse.ArgumentParser) -> None:
    """Add the flags of an experiment that measures an encoder on a split."""
    add_data(stage)
    add_seed(stage)
    stage.add_argument("--model", type=Path, default=SHIPPED, help="exported encoder; default: the shipped one")
    stage.add_argument("--split", choices=SPLITS, default="test", help="split to measure on; default: test")
    _add_out(stage)


def _add_out(stage: argparse.ArgumentParser) -> None:
    stage.add_argument(
        "-o", "--out", type=Path, default=ROOT, help="folder that receives PAPER.md and model/results/paper"
    )


def _page(arguments: argparse.Namespace) -> None:
    from model.report.paper.page import write

    print(write(arguments.out))


def _fit(arguments: argparse.Namespace) -> None:
    from model.evaluation.paper.compression import EXPERIMENT, measure_compression
    from model.report.paper.page import record_path, write

    meshes = {record.id: record for record in records_of(arguments, arguments.data)}
    sizes = (arguments.objects, arguments.steps, arguments.seed)
    record = measure_compression(arguments.data, arguments.split, meshes, *sizes)
    record.write(record_path(arguments.out, EXPERIMENT))
    print(write(arguments.out))


def _latent(arguments: argparse.Namespace) -> None:
    from model.evaluation.paper.latent import EXPERIMENT, measure_latent
    from model.report.paper.page import record_path, write

    measure_latent(arguments.seed).write(record_path(arguments.out, EXPERIMENT))
    print(write(arguments.out))


def _paths(arguments: argparse.Namespace) -> None:
    from model.evaluation.paper.navigation import EXPERIMENT, measure_paths
    from model.report.paper.page import record_path, write

    record = measure_paths(arguments.model, arguments.data, arguments.split, arguments.seed, tuple(arguments.folders))
    record.write(record_path(arguments.out, EXPERIMENT))
    print(write(arguments.out))


def _views(arguments: argparse.Namespace) -> None:
    from model.evaluation.paper.views import EXPERIMENT, measure_views
    from model.report.paper.page import record_path, write

    record = measure_views(arguments.model, arguments.data, arguments.split, arguments.seed)
    record.write(record_path(arguments.out, EXPERIMENT))
    print(write(arguments.out))
