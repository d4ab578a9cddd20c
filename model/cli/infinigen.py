"""`hof-model data infinigen`: meshes of furniture and other things, made with Infinigen."""

import argparse
import resource
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
    earlier, start_s = len(_kinds(arguments.out)), _processor_s()
    failures = generate(arguments.out, arguments.count, command, arguments.limit_s, arguments.processes)
    finished = Counter(_kinds(arguments.out))
    failed = Counter(name.split("-", 1)[1] for name in failures)
    for kind in sorted(finished | failed):
        print(f"{kind:<24}{finished[kind]:>6} made{failed[kind]:>6} failed")
    used_s, added = _processor_s() - start_s, finished.total() - earlier
    print(f"{added} objects in {used_s:.0f} s of processor time: {3600 * added / max(used_s, 1):.0f} an hour and core")
    print(f"{finished.total()} objects of {len(finished)} kinds, {failed.total()} failed: {arguments.out}")


def _kinds(folder: Path) -> list[str]:
    """Return the kind of each mesh in the folder."""
    return [path.stem.split("-", 1)[1] for path in folder.glob("*.glb")]


def _processor_s() -> float:
    """Return the processor time in seconds of the worker processes that have ended."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime
