"""`hof-model data infinigen`: meshes of furniture and other things, made with Infinigen."""

import argparse
from collections import Counter
from pathlib import Path
from typing import Final

from model.cli.flags import number
from model.data.infinigen.environment import ENVIRONMENT

MESHES: Final = Path("data/infinigen")


def add_infinigen(stage: argparse.ArgumentParser) -> None:
    """Declare the flags of the stage."""
    stage.set_defaults(run=_infinigen)
    stage.add_argument("--count", type=number(int, least=1), default=10_000, help="objects; default: 10000")
    stage.add_argument("-o", "--out", type=Path, default=MESHES, help=f"folder of the meshes; default: {MESHES}")
    stage.add_argument(
        "--environment",
        type=Path,
        default=ENVIRONMENT,
        help=f"environment with Infinigen and Blender, installed if it is missing; default: {ENVIRONMENT}",
    )
    stage.add_argument(
        "--limit-s",
        type=number(int, least=1),
        default=60,
        help="seconds of processor time after which an object is given up; default: 60",
    )
    stage.add_argument(
        "--processes", type=number(int, least=1), default=1, help="workers, about a gigabyte each; default: 1"
    )


def _infinigen(arguments: argparse.Namespace) -> None:
    from model.data.infinigen.environment import interpreter
    from model.data.infinigen.generate import generate, worker_command

    command = worker_command(interpreter(arguments.environment))
    failures = generate(arguments.out, arguments.count, command, arguments.limit_s, arguments.processes)
    made = Counter(path.stem.split("-", 1)[1] for path in arguments.out.glob("*.glb"))
    failed = Counter(name.split("-", 1)[1] for name in failures)
    for kind in sorted(made | failed):
        print(f"{kind:<24}{made[kind]:>6} made{failed[kind]:>6} failed")
    print(f"{made.total()} objects of {len(made)} kinds, {failed.total()} failed: {arguments.out}")
