"""`hof-model fit`: a mesh becomes a function, without any image or encoder."""

import argparse
import sys
from pathlib import Path
from typing import Final

from model.cli.common import add_seed
from model.cli.flags import number
from model.data.sources.axes import AXES

SUFFIX: Final = ".safetensors"
K: Final = 2
STEPS: Final = 1_000


def add_stage(stages: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the stage: it sets `run`, a function of the parsed arguments."""
    stage = stages.add_parser("fit", help="fit theta to a mesh and write it as a weights file")
    stage.set_defaults(run=_fit)
    stage.add_argument("mesh", type=Path, help="OBJ, GLB, glTF, PLY, STL or OFF")
    stage.add_argument(
        "-o", "--output", type=Path, required=True, help=f"{SUFFIX} file to write, which `hof` and the service read"
    )
    stage.add_argument("--up", choices=AXES, default="y", help="axis of the mesh that points up; default: y")
    stage.add_argument("--front", choices=AXES, help="axis that points to the viewer; default: z, or -y if z is up")
    stage.add_argument("--k", type=number(int, least=1, most=16), default=K, help=f"compositions; default: {K}")
    stage.add_argument("--steps", type=number(int, least=1), default=STEPS, help=f"steps of Adam; default: {STEPS}")
    add_seed(stage)


def _fit(arguments: argparse.Namespace) -> None:
    from model.data.sources.meshes import turn
    from model.evaluation.fitting import SPEC, fit_mesh
    from service.files import whole_file
    from service.formats.weights import dump

    output: Path = arguments.output
    if output.suffix.lower() != SUFFIX:
        raise ValueError(f"{output}: a function is written as {SUFFIX}; use that suffix")
    if not arguments.mesh.is_file():
        raise FileNotFoundError(f"{arguments.mesh} is not there: pass a mesh file")
    rotation = turn(arguments.up, arguments.front)
    try:
        fitted = fit_mesh(arguments.mesh, rotation, SPEC.with_k(arguments.k), arguments.steps, arguments.seed)
    except ValueError as error:
        raise ValueError(f"{arguments.mesh}: {error}") from error
    with whole_file(output) as file:
        file.write(dump(fitted.weights, "safetensors"))
    for loss in fitted.losses:
        print(f"{arguments.mesh}: {loss}", file=sys.stderr)
    figures = ", ".join(f"{name} {value:.3f}" for name, value in fitted.figures.items())
    print(f"{output}: {fitted.weights.spec.size:,} numbers; against the mesh {figures}")
