"""`hof-model paper`: experiments of the paper, and the page that reports them."""

import argparse
from pathlib import Path
from typing import Final

from model.cli.common import ROOT, SHIPPED, SHIPPED_POINTS, add_data, add_seed
from model.cli.data import add_source, records_of
from model.cli.fit import STEPS
from model.cli.flags import number
from model.cli.suites import add_suites
from model.data.manifest import SPLITS

FIT: Final = "fit"
INTERPOLATION: Final = "interpolation"
LATENT: Final = "latent"
PATHS: Final = "paths"
RUNTIME: Final = "runtime"
VIEWS: Final = "views"
POINTS: Final = "points"
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
    points = experiments.add_parser(POINTS, help="the whole object from points of a part of its surface")
    points.set_defaults(run=_points)
    _add_measured(points, SHIPPED_POINTS)
    runtime = experiments.add_parser(RUNTIME, help="time to map n points, of HOF and the decoders it is compared with")
    runtime.set_defaults(run=_runtime)
    add_seed(runtime)
    runtime.add_argument("--device", choices=("cpu", "cuda"), default="cpu", help="device to time; default: cpu")
    runtime.add_argument("--record-only", action="store_true", help="do not write PAPER.md: needs torch alone")
    _add_out(runtime)
    interpolation = experiments.add_parser(INTERPOLATION, help="words against means of thetas, from `mixtures`")
    interpolation.set_defaults(run=_interpolation)
    _add_out(interpolation)
    add_suites(experiments)


def _add_fit(stage: argparse.ArgumentParser) -> None:
    stage.set_defaults(run=_fit)
    add_source(stage)
    add_seed(stage)
    stage.add_argument("--split", choices=SPLITS, default="test", help="split to measure on; default: test")
    stage.add_argument("--objects", type=number(int, least=1), default=10, help="number of objects; default: 10")
    stage.add_argument("--steps", type=number(int, least=1), default=STEPS, help=f"steps of the fit; default: {STEPS}")
    _add_out(stage)


def _add_measured(stage: argparse.ArgumentParser, model: Path = SHIPPED) -> None:
    """Add the flags of an experiment that measures an encoder, by default `model`, on a split."""
    add_data(stage)
    add_seed(stage)
    stage.add_argument("--model", type=Path, default=model, help=f"exported encoder; default: {model.name}")
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


def _interpolation(arguments: argparse.Namespace) -> None:
    from model.evaluation.locations import MIXTURES
    from model.evaluation.paper.interpolation import EXPERIMENT, interpolation_record
    from model.report.paper.page import record_path, write

    interpolation_record(arguments.out / MIXTURES).write(record_path(arguments.out, EXPERIMENT))
    print(write(arguments.out))


def _runtime(arguments: argparse.Namespace) -> None:
    import torch

    from model.evaluation.locations import PAPER
    from model.evaluation.paper.runtime import experiment_of, measure_runtime

    if arguments.device == "cuda" and not torch.cuda.is_available():
        raise ValueError(f"--device cuda: torch {torch.__version__} sees no CUDA device")
    path = arguments.out / PAPER / f"{experiment_of(arguments.device)}.json"
    measure_runtime(arguments.device, arguments.seed).write(path)
    if arguments.record_only:
        print(path)
        return
    from model.report.paper.page import write

    print(write(arguments.out))


def _points(arguments: argparse.Namespace) -> None:
    from model.evaluation.paper.completion import EXPERIMENT, draw_completed, measure_points
    from model.report.paper.page import record_path, write

    measured = (arguments.model, arguments.data, arguments.split, arguments.seed)
    path = record_path(arguments.out, EXPERIMENT)
    measure_points(*measured).write(path)
    draw_completed(*measured).quantize(64).save(path.with_suffix(".png"), optimize=True)
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
