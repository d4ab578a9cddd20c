"""The offline commands: photos and weights in; points, surfaces, pictures and weights out."""

import argparse
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Final, TypeVar

from pydantic import BaseModel, ValidationError

from service.drawing.words import MAX_POINTS, label, rows_of_words, sheet
from service.encoding.encoder import Encoder
from service.encoding.framing import preprocess
from service.encoding.matting import Matting
from service.errors import HofError, InvalidParameter
from service.files import whole_file
from service.formats.mesh.registry import MESH_FORMATS, MeshFormat
from service.formats.points.registry import POINT_FORMATS, PointFormat
from service.formats.points.writer import write
from service.formats.weights import WEIGHT_FORMATS, Weights, dump, load
from service.mapping.sampler import Sampler
from service.mapping.spec import Array, Functions, MappingSpec, joined
from service.options import EncodeOptions, MeshOptions, PointOptions
from service.runtime.composition import Member, check_members
from service.runtime.cost import check_size
from service.runtime.shapes import cloud_of, functions_for, mesh_of
from service.settings import POINTS_CEILING, Settings

Format = TypeVar("Format", PointFormat, MeshFormat)
Options = TypeVar("Options", EncodeOptions, PointOptions, MeshOptions)

PICTURE: Final = ".png"


def encode(arguments: argparse.Namespace) -> None:
    """Encode the photo of one object and write its points, or its weights as .safetensors."""
    settings = settings_of(arguments)
    options = _options(arguments, EncodeOptions)
    as_weights = arguments.output.suffix == WEIGHT_FORMATS["safetensors"].extension
    if not as_weights:
        _point_options(arguments)  # fails before the work begins
    encoder = Encoder.open(settings.model[0], settings.threads)
    framing = encoder.framing
    if options.foreground_ratio is not None:
        framing = replace(framing, foreground_ratio=options.foreground_ratio)
    matting = Matting.of(settings.matting_model, settings.threads)
    photo = arguments.photo.read_bytes()
    framed = preprocess(photo, framing, options.background, settings.max_image_pixels, matting)
    functions = encoder.encode(framed.tensor)[0]
    if as_weights:
        weights = Weights(encoder.spec, functions.theta, encoder.name, color=functions.color)
        _write(arguments.output, [dump(weights, "safetensors")])
    else:
        _write_points(arguments, encoder.spec, functions)


def sample(arguments: argparse.Namespace) -> None:
    """Sample a weights file; the points are those that the service computes for the object."""
    _point_options(arguments)
    weights = _load(arguments.weights)
    _write_points(arguments, weights.spec, weights.functions)


def mesh(arguments: argparse.Namespace) -> None:
    """Write the surface of a weights file; the triangles are those that the service computes for the object."""
    fmt = _format(arguments.output, MESH_FORMATS)
    options = _options(arguments, MeshOptions)
    weights = _load(arguments.weights)
    functions = functions_for(weights.functions, options.color, holds_color=fmt.holds_color)
    _write(arguments.output, [fmt.dump(mesh_of(weights.spec, functions, options))])


def compose(arguments: argparse.Namespace) -> None:
    """Compose the functions of k weights files and write points. A B is f_A(f_B(x)): the last one is applied first.

    As .png: a picture of words over two files A and B; all words if k = 2, those from A to B if k is larger.
    """
    as_picture = arguments.output.suffix == PICTURE
    if not as_picture:
        _point_options(arguments)
    word = [_load(path) for path in arguments.weights]
    kinds = ((each.spec, bool(each.word), each.color.spec if each.color else None) for each in word)
    members = [Member(str(path), *kind) for path, kind in zip(arguments.weights, kinds, strict=True)]
    check_members(members, "all" if as_picture else "compose")
    if as_picture:
        _write_sheet(arguments, word[0].spec, [each.theta for each in word])
    else:
        _write_points(arguments, word[0].spec, joined([each.functions for each in word]))


def info(arguments: argparse.Namespace) -> None:
    """Print the model, the spec and the size of theta as JSON; also the color's spec and the word, if any."""
    weights = _load(arguments.weights)
    summary: dict[str, Any] = {"model": weights.model, "spec": asdict(weights.spec), "size": weights.spec.size}
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


def _options(arguments: argparse.Namespace, model: type[Options]) -> Options:
    """Return the options that the flags set, the rest at their defaults. Raises InvalidParameter."""
    try:
        return model(**_values(arguments, model))
    except ValidationError as error:
        first = error.errors()[0]
        field = str(first["loc"][0])
        raise InvalidParameter(f"{field}: {first['msg']}, not {first['input']!r}", field=field) from error


def _load(path: Path) -> Weights:
    """Read a weights file. Raises CorruptWeights or InvalidSpec, which name the file."""
    try:
        return load(path.read_bytes())
    except HofError as error:
        raise type(error)(f"{path}: {error.detail}") from error


def _point_options(arguments: argparse.Namespace) -> tuple[PointFormat, PointOptions]:
    """Return the format that the output's suffix names, and the points to compute. Raises InvalidParameter."""
    fmt = _format(arguments.output, POINT_FORMATS)
    options = _options(arguments, PointOptions)
    check_size(fmt, options.n, POINTS_CEILING)
    return fmt, options


def _format(path: Path, formats: Mapping[str, Format]) -> Format:
    """Return the format with the suffix of a file. Raises InvalidParameter."""
    suffixes = {fmt.extension: fmt for fmt in formats.values()}
    if path.suffix not in suffixes:
        raise InvalidParameter(f"{path}: no format has the suffix {path.suffix!r}; use one of {', '.join(suffixes)}")
    return suffixes[path.suffix]


def _write_points(arguments: argparse.Namespace, spec: MappingSpec, functions: Functions) -> None:
    fmt, options = _point_options(arguments)
    cloud = cloud_of(spec, functions, options)
    _write(arguments.output, write(fmt.holding(color=cloud.functions.color is not None), cloud))


def _write_sheet(arguments: argparse.Namespace, spec: MappingSpec, thetas: Sequence[Array]) -> None:
    """Draw the words over A and B; `thetas` are those of A and B, (spec.size,) each."""
    options = _options(arguments, PointOptions)
    if options.n > MAX_POINTS:
        raise InvalidParameter(f"n is {options.n}; a picture shows at most {MAX_POINTS} points per word", field="n")
    if options.scale != 1:
        raise InvalidParameter(f"scale is {options.scale:g}; a picture has no scale, leave it out", field="scale")

    def points(word: str) -> Array:
        functions = tuple(thetas["AB".index(letter)] for letter in word)
        return Sampler(spec.with_k(len(word)), functions).points(
            options.n, seed=options.seed, sampling=options.sampling
        )

    rows = [[(label(word, spec.k), points(word)) for word in row] for row in rows_of_words(spec.k)]
    names = (f"{letter}: {path.stem}" for letter, path in zip("AB", arguments.weights, strict=True))
    file = io.BytesIO()
    sheet(rows, ", ".join(names)).save(file, "PNG", optimize=True)
    _write(arguments.output, [file.getvalue()])


def _write(path: Path, pieces: Iterable[bytes]) -> None:
    with whole_file(path) as file:
        file.writelines(pieces)
