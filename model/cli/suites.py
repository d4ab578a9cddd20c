"""`hof-model paper NAME` for the experiments that train: one driver for all of them."""

import argparse
from dataclasses import fields
from pathlib import Path
from typing import Final

from model.cli.common import ROOT, add_data
from model.cli.flags import add_flags, number, values
from model.cli.train import add_network, add_schedule, config_from
from model.config import COMPARED_RUN, DeviceOptions, TrainConfig
from model.data.manifest import SPLITS
from model.evaluation.paper.suites import PICTURED, SUITES

VARIED: Final = {"seed", "method", "projection", "projection_form", "frame", "start"}  # options that the suites set
RUNS: Final = Path("runs/paper")


def add_suites(experiments: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the experiments that train."""
    for name, suite in SUITES.items():
        stage = experiments.add_parser(name, help=f"{suite.title.lower()}: trains {len(suite.variants)} networks alike")
        stage.set_defaults(run=_suite, experiment=name)
        add_data(stage)
        stage.add_argument("--split", choices=SPLITS, default="test", help="split to measure on; default: test")
        stage.add_argument(
            "--seeds", type=number(int, least=0), nargs="+", default=[0], help="a run for each; default: 0"
        )
        stage.add_argument("--runs", type=Path, default=RUNS, help=f"folder of the runs, resumable; default: {RUNS}")
        stage.add_argument("--train-only", action="store_true", help="do not measure: for a machine with a GPU alone")
        stage.add_argument(
            "--protocol",
            choices=("project", "epcg"),
            default="project",
            help="epcg: measure all views against all true points",
        )
        stage.add_argument(
            "-o", "--out", type=Path, default=ROOT, help="folder that receives PAPER.md and model/results/paper"
        )
        common = [each.name for each in fields(TrainConfig) if each.name not in VARIED]
        add_flags(stage.add_argument_group("training, the same for all variants"), COMPARED_RUN, only=common)
        add_schedule(stage)
        add_flags(stage.add_argument_group("device"), DeviceOptions())
        add_network(stage)


def _suite(arguments: argparse.Namespace) -> None:
    from model.evaluation.paper.training import train_suite

    name = arguments.experiment
    options = DeviceOptions(**values(arguments, DeviceOptions))
    common = config_from(arguments, COMPARED_RUN)
    runs = train_suite(name, SUITES[name], common, arguments.seeds, arguments.data, arguments.runs, options)
    if runs is None:
        print(f"{name}: not finished, the same command goes on")
        return
    if arguments.train_only:
        print(*runs.values(), sep="\n")
        return
    from model.evaluation.paper.trained import measure_suite
    from model.report.paper.page import record_path, write

    is_epcg, by_class = arguments.protocol == "epcg", SUITES[name].is_by_class
    record = measure_suite(name, runs, arguments.data, arguments.split, is_epcg, by_class and not is_epcg)
    path = record_path(arguments.out, name)
    record.write(path)
    if name == PICTURED:
        from model.evaluation.paper.slices import draw_slices

        draw_slices(runs, arguments.data, arguments.split).quantize(64).save(path.with_suffix(".png"), optimize=True)
    print(write(arguments.out))
