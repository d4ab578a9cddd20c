"""The offline commands: photos and weights in; points, surfaces, pictures and weights out."""

import argparse
import io
import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final, TypeVar

from pydantic import BaseModel, ValidationError

from service.drawing.words import MAX_POINTS, Cell, label, rows_of_words, sheet
from service.encoding.estimates import Estimates
from service.encoding.report import ImageReport
from service.errors import HofError, InvalidParameter
from service.files import whole_file
from service.formats.mesh.registry import MESH_FORMATS, MeshFormat
from service.formats.path import PATH_FORMATS, PathFormat
from service.formats.points.registry import POINT_FORMATS, PointFormat
from service.formats.points.writer import write
from service.formats.weights import Weights, load
from service.mapping.box import measure
from service.mapping.color import ColorSampler
from service.mapping.frame import Frame
from service.mapping.sampler import Sampler
from service.mapping.spec import Functions, MappingSpec, join_functions
from service.runtime.composition import Member, check_members
from service.runtime.cost import check_size
from service.runtime.options import EncodeOptions, MeshOptions, PathOptions, PointOptions
from service.runtime.paths import path_of
from service.runtime.poses import pose_of, view_of
from service.runtime.shapes import cloud_of, functions_for, mesh_of
from service.settings import POINTS_CEILING, Settings

Format = TypeVar("Format", PointFormat, MeshFormat, PathFormat)
Options = TypeVar("Options", EncodeOptions, PointOptions, MeshOptions, PathOptions)

PICTURE: Final = ".png"
STDIO: Final = Path("-")  # as an input: stdin; as the output: stdout


def sample(arguments: argparse.Namespace) -> None:
    """Sample a weights file; the points are those that the service computes for the object."""
    point_options(arguments)
    weights = _load(arguments.weights)
    write_points(arguments, weights.spec, weights.functions, _frame(weights))


def mesh(arguments: argparse.Namespace) -> None:
    """Write the surface of a weights file; the triangles are those that the service computes for the object."""
    fmt = _format(arguments, MESH_FORMATS)
    options = options_of(arguments, MeshOptions)
    weights = _load(arguments.weights)
    functions = functions_for(weights.functions, options.color, holds_color=fmt.holds_color)
    view, frame = view_of(options, None, None), _frame(weights)
    pose = pose_of(view, weights.spec, functions, frame)
    write_file(arguments.output, [fmt.dump(mesh_of(weights.spec, functions, frame, options, pose))])


def path(arguments: argparse.Namespace) -> None:
    """Plan a path around the object of a weights file; it is the path that the service plans.

    If there is none, a .json file says why, and a .glb file is not written.
    """
    fmt = _format(arguments, PATH_FORMATS)
    options = options_of(arguments, PathOptions)
    weights = _load(arguments.weights)
    write_file(arguments.output, [fmt.dump(path_of(weights.spec, weights.functions, _frame(weights), options))])


def compose(arguments: argparse.Namespace) -> None:
    """Compose the functions of k weights files and write points. A B is f_A(f_B(x)): the last one is applied first.

    As .png: a picture of words over two files A and B; all words if k = 2, those from A to B if k is larger.
    """
    as_picture = suffix_of(arguments) == PICTURE
    if not as_picture:
        point_options(arguments)
    word = [_load(path) for path in arguments.weights]
    kinds = ((each.spec, bool(each.word), each.color.spec if each.color else None) for each in word)
    members = [Member(str(path), *kind) for path, kind in zip(arguments.weights, kinds, strict=True)]
    check_members(members, "all" if as_picture else "compose")
    if as_picture:
        _write_sheet(arguments, word[0].spec, [each.functions for each in word])
    else:
        functions = join_functions([each.functions for each in word])
        write_points(arguments, word[0].spec, functions, measure(word[0].spec, functions.theta))


def info(arguments: argparse.Namespace) -> None:
    """Print the model, the spec, the size of theta, and the object's dimensions as JSON.

    Also the color's spec and the word, if any, and what numbers of fewer bytes cost.
    """
    weights = _load(arguments.weights)
    summary: dict[str, Any] = {"model": weights.model, "spec": asdict(weights.spec), "size": weights.spec.size}
    frame = _frame(weights)
    summary |= {"dimensions": frame.dimensions, "frame": asdict(frame)}
    if weights.dtype != "float32":
        summary |= {"dtype": weights.dtype, "loss": weights.loss and asdict(weights.loss)}
    if weights.color:
        summary["color_spec"] = asdict(weights.color.spec)
    if weights.word:
        summary["word"] = weights.word
    print(json.dumps(summary, indent=2))


def settings_of(arguments: argparse.Namespace) -> Settings:
    """Return the settings: flags first, then the environment. Raises ValidationError."""
    return Settings(**_values(arguments, Settings))


def _values(arguments: argparse.Namespace, model: type[BaseModel]) -> dict[str, Any]:
    """Return the values of the flags that were set and are fields of `model`."""
    return {name: value for name, value in vars(arguments).items() if name in model.model_fields and value is not None}


def options_of(arguments: argparse.Namespace, model: type[Options]) -> Options:
    """Return the options that the flags set, the rest at their defaults. Raises InvalidParameter."""
    try:
        return model(**_values(arguments, model))
    except ValidationError as error:
        first = error.errors()[0]
        field = str(first["loc"][0])
        raise InvalidParameter(f"{field}: {first['msg']}, not {first['input']!r}", field=field) from error


def _load(path: Path) -> Weights:
    """Read a weights file. Raises CorruptWeights or InvalidSpec, which name the file."""
    data = read_file(path)
    try:
        return load(data)
    except HofError as error:
        raise error.prefixed(shown_name(path)) from error


def _frame(weights: Weights) -> Frame:
    """Return the frame in a weights file; measure it if the file has none."""
    return weights.frame or measure(weights.spec, weights.theta)


def point_options(arguments: argparse.Namespace) -> tuple[PointFormat, PointOptions]:
    """Return the format that the output's suffix names, and the points to compute. Raises InvalidParameter."""
    fmt = _format(arguments, POINT_FORMATS)
    options = options_of(arguments, PointOptions)
    check_size(fmt, options.n, POINTS_CEILING)
    return fmt, options


def suffix_of(arguments: argparse.Namespace) -> str:
    """Return the suffix of the output's format, in lower case: that of --format, else that of the file."""
    suffix: str = f".{arguments.format}" if arguments.format else arguments.output.suffix
    return suffix.lower()


def _format(arguments: argparse.Namespace, formats: Mapping[str, Format]) -> Format:
    """Return the format that --format or the suffix of the output names. Raises InvalidParameter."""
    suffixes, suffix = {fmt.extension: fmt for fmt in formats.values()}, suffix_of(arguments)
    if arguments.output == STDIO and not arguments.format:
        names = ", ".join(each.removeprefix(".") for each in suffixes)
        raise InvalidParameter(f"stdout has no suffix: name the format with --format, one of {names}")
    if suffix not in suffixes:
        message = f"no format has the suffix {suffix!r}; use one of {', '.join(suffixes)}"
        raise InvalidParameter(f"{arguments.output}: {message}")
    return suffixes[suffix]


def write_points(
    arguments: argparse.Namespace,
    spec: MappingSpec,
    functions: Functions,
    frame: Frame,
    estimates: Estimates | None = None,
    photo: ImageReport | None = None,
) -> int:
    """Write the points, and return their number.

    Parameters
    ----------
    estimates, photo : of the object, if there are any; for points in the camera's frame.
    """
    fmt, options = point_options(arguments)
    view = view_of(options, estimates, photo)
    pose = pose_of(view, spec, functions, frame)
    cloud = cloud_of(spec, functions, frame, options, pose)
    fmt = fmt.holding(color=cloud.functions.color is not None, camera=pose is not None)
    write_file(arguments.output, write(fmt, cloud))
    return options.n


def _write_sheet(arguments: argparse.Namespace, spec: MappingSpec, letters: Sequence[Functions]) -> None:
    """Draw the words over A and B, each in its own frame, and in color if A or B has color."""
    options = options_of(arguments, PointOptions)
    if options.n > MAX_POINTS:
        raise InvalidParameter(f"n is {options.n}; a picture shows at most {MAX_POINTS} points per word", field="n")
    if options.frame == "camera":
        raise InvalidParameter("a picture has a camera of its own: use --frame object or raw", field="frame")
    if options.scale != 1:
        raise InvalidParameter(f"scale is {options.scale:g}; a picture has no scale, leave it out", field="scale")

    def cell(word: str) -> Cell:
        functions = join_functions([letters["AB".index(letter)] for letter in word])
        spelled, n, seed, sampling = spec.with_k(len(word)), options.n, options.seed, options.sampling
        frame = measure(spelled, functions.theta) if options.frame == "object" else None
        sampler = Sampler(spelled, tuple(functions.theta), frame)
        color = ColorSampler(functions.color) if functions.color and options.color == "auto" else None
        colors = color.colors(n, seed=seed, sampling=sampling) if color else None
        return label(word, spec.k), sampler.points(n, seed=seed, sampling=sampling), colors

    rows = [[cell(word) for word in row] for row in rows_of_words(spec.k)]
    names = (f"{letter}: {path.stem}" for letter, path in zip("AB", arguments.weights, strict=True))
    file = io.BytesIO()
    sheet(rows, ", ".join(names)).save(file, "PNG", optimize=True)
    write_file(arguments.output, [file.getvalue()])


def read_file(path: Path) -> bytes:
    """Return the bytes of a file, or of stdin."""
    return sys.stdin.buffer.read() if path == STDIO else path.read_bytes()


def shown_name(path: Path) -> str:
    """Return a file's name for messages."""
    return "-" if path == STDIO else str(path)


def write_file(path: Path, pieces: Iterable[bytes]) -> None:
    """Write a file, whole or not at all, or stdout."""
    if path == STDIO:
        sys.stdout.buffer.writelines(pieces)
        sys.stdout.buffer.flush()
        return
    with whole_file(path) as file:
        file.writelines(pieces)
