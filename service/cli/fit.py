"""`hof fit`: a mesh becomes a function. It runs `hof-model fit` in a process of its own, because it needs torch."""

import argparse
import importlib.util
import subprocess
import sys
from typing import Final

from service.errors import InvalidParameter

NEEDS: Final = ("torch", "trimesh", "model")
FLAGS: Final = {
    "up": "axis of the mesh that points up: x, -x, y, -y, z or -z; default: y",
    "front": "axis that points to the viewer; default: z, or -y if z is up",
    "k": "number of times the function is applied; default: 2, as the shipped model",
    "steps": "steps of the search; default: 1000",
    "seed": "seed of the points; default: 0",
}


def add_fit(stage: argparse.ArgumentParser) -> None:
    """Declare the command's flags, which `hof-model fit` checks."""
    stage.add_argument("mesh", help="OBJ, GLB, glTF, PLY, STL or OFF")
    stage.add_argument("-o", "--output", required=True, help="file to write: .safetensors")
    for name, text in FLAGS.items():
        stage.add_argument(f"--{name}", help=text)
    stage.set_defaults(run=fit)


def fit(arguments: argparse.Namespace) -> int:
    """Fit a function to a mesh, and write its weights. Needs the extra `train`."""
    if missing := [name for name in NEEDS if importlib.util.find_spec(name) is None]:
        raise InvalidParameter(f"fitting needs {missing[0]}: pip install '.[train]' in the source folder")
    flags = [f"--{name}={value}" for name in FLAGS if (value := getattr(arguments, name)) is not None]
    command = [sys.executable, "-m", "model.cli", "fit", f"--output={arguments.output}", *flags, "--", arguments.mesh]
    return subprocess.run(command, check=False).returncode  # noqa: S603 - a module of this project
