"""The `hof` command: serve, and the same encoding and sampling without a server."""

import argparse
import io
import json
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Final, get_args, get_origin

from pydantic import BaseModel, ValidationError

from service import __version__
from service.composition import Member, check
from service.encoder import Encoder
from service.errors import HofError, InvalidParameter
from service.formats import POINT_FORMATS, Format, PointFormat, write
from service.formats.mesh import MESH_FORMATS
from service.formats.weights import WEIGHT_FORMATS, Weights, dump, load
from service.images import Background, preprocess
from service.keys import SCOPES, make_key
from service.mapping import Array, Functions, MappingSpec, joined, word_of
from service.matting import Matting
from service.points import check_size
from service.queries import EncodeQuery, MeshQuery, PointsQuery
from service.sampler import Sampler
from service.settings import POINTS_CEILING, Settings
from service.sheet import MAX_POINTS, label, rows_of_words, sheet
from service.surface import surface_of

FAILED: Final = 2
PICTURE: Final = ".png"


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command. Returns the exit status; what went wrong is one line on stderr."""
    arguments = _parser().parse_args(argv)
    try:
        status: int | None = arguments.run(arguments)
    except HofError as error:
        return _fail(error.detail)
    except ValidationError as error:
        first = error.errors()[0]
        return _fail(f"{'.'.join(map(str, first['loc']))}: {first['msg']}")
    except OSError as error:
        return _fail(f"{error.filename}: {error.strerror}" if error.filename else str(error))
    return status or 0


def _fail(message: str) -> int:
    print(f"hof: {message}", file=sys.stderr)
    return FAILED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="hof", description="A photo goes in; a function comes out.")
    parser.add_argument("--version", action="version", version=f"hof {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    serve = commands.add_parser("serve", help="start the HTTP service", description=_serve.__doc__)
    _add_settings(serve)
    serve.set_defaults(run=_serve)

    doctor = commands.add_parser("doctor", help="check this installation", description=_doctor.__doc__)
    _add_settings(doctor)
    doctor.set_defaults(run=_doctor)

    key = commands.add_parser("key", help="make an API key", description=_key.__doc__)
    key.add_argument("name", help="whose it is, as the log shows it")
    key.add_argument("--scope", choices=SCOPES, action="append", required=True, help="what it may do; repeatable")
    key.set_defaults(run=_key)

    encode = commands.add_parser("encode", help="a photo to points or weights", description=_encode.__doc__)
    encode.add_argument("photo", type=Path, help="PNG, JPEG or WebP")
    _add_output(encode, [*(fmt.extension for fmt in POINT_FORMATS.values()), WEIGHT_FORMATS["safetensors"].extension])
    _add_sampling(encode)
    encode.add_argument("--background", choices=get_args(Background), help="as in the API; default: auto")
    encode.add_argument("--foreground-ratio", type=float, help="as in the API; default: the model's")
    _add_settings(encode, only={"model", "matting_model", "threads"})
    encode.set_defaults(run=_encode)

    sample = commands.add_parser("sample", help="a weights file to points", description=_sample.__doc__)
    sample.add_argument("weights", type=Path, help="a .safetensors file of hof or of the service")
    _add_output(sample, [fmt.extension for fmt in POINT_FORMATS.values()])
    _add_sampling(sample)
    sample.set_defaults(run=_sample)

    mesh = commands.add_parser("mesh", help="a weights file to a surface", description=_mesh.__doc__)
    mesh.add_argument("weights", type=Path, help="a .safetensors file of hof or of the service")
    _add_output(mesh, [fmt.extension for fmt in MESH_FORMATS.values()])
    _add_fields(mesh, MeshQuery, ["resolution", "scale"])
    mesh.set_defaults(run=_mesh)

    compose = commands.add_parser("compose", help="weights files to points or a picture", description=_compose.__doc__)
    compose.add_argument("weights", type=Path, nargs="+", help="k .safetensors files of one spec")
    _add_output(compose, [*(fmt.extension for fmt in POINT_FORMATS.values()), PICTURE])
    _add_sampling(compose)
    compose.set_defaults(run=_compose)

    info = commands.add_parser("info", help="what a weights file holds", description=_info.__doc__)
    info.add_argument("weights", type=Path, help="a .safetensors file")
    info.set_defaults(run=_info)

    openapi = commands.add_parser("openapi", help="the API's schema", description=_openapi.__doc__)
    openapi.set_defaults(run=_openapi)
    return parser


def _add_settings(parser: argparse.ArgumentParser, only: set[str] | None = None) -> None:
    """A flag for each field of Settings; pydantic parses and checks the values, the environment's too."""
    for name, field in Settings.model_fields.items():
        if only is None or name in only:
            default = "" if field.default_factory or field.default is None else f"; default: {field.default}"
            parser.add_argument(
                f"--{name.replace('_', '-')}",
                dest=name,
                action="append" if get_origin(field.annotation) is tuple else "store",
                default=argparse.SUPPRESS,
                metavar=name.rsplit("_", 1)[-1].upper(),
                help=f"{field.description}{default} [HOF_{name.upper()}]".replace("%", "%%"),
            )


def _add_output(parser: argparse.ArgumentParser, suffixes: list[str]) -> None:
    parser.add_argument("-o", "--output", type=Path, required=True, help=f"file to write: {', '.join(suffixes)}")


def _add_sampling(parser: argparse.ArgumentParser) -> None:
    _add_fields(parser, PointsQuery, ["n", "seed", "scale", "sampling", "color"])


def _add_fields(parser: argparse.ArgumentParser, model: type[BaseModel], names: Sequence[str]) -> None:
    for name in names:
        field = model.model_fields[name]
        parser.add_argument(
            f"--{name}", default=argparse.SUPPRESS, help=f"{field.description}; default: {field.default}"
        )


def _settings(arguments: argparse.Namespace) -> Settings:
    return Settings(**_given(arguments, Settings))


def _given(arguments: argparse.Namespace, model: type[BaseModel]) -> dict[str, Any]:
    """The arguments that are fields of a model and were given."""
    return {name: value for name, value in vars(arguments).items() if name in model.model_fields and value is not None}


def _serve(arguments: argparse.Namespace) -> None:
    """Serve the API. Each flag has an environment variable, in brackets."""
    from service.server import serve  # not needed by the other commands, which should start fast

    serve(_settings(arguments))


def _doctor(arguments: argparse.Namespace) -> int:
    """Check what `hof serve` needs, a line each. Exits with 1 where it would not run."""
    from service.doctor import examine  # not needed by the other commands

    failed = False
    for finding in examine(_settings(arguments)):
        print(finding, flush=True)
        failed |= finding.state == "fail"
    return int(failed)


def _key(arguments: argparse.Namespace) -> None:
    """Make an API key: its line for the keys file goes to stdout, the key itself, this once, to stderr."""
    token, key = make_key(arguments.name, frozenset(arguments.scope))
    print(f"hof: the key, which is shown this once: {token}", file=sys.stderr)
    print(key.line)


def _encode(arguments: argparse.Namespace) -> None:
    """Encode the photo of one object and write its points, or its weights as .safetensors."""
    settings = _settings(arguments)
    query = EncodeQuery(**_given(arguments, EncodeQuery) | {"model": None})
    as_weights = arguments.output.suffix == WEIGHT_FORMATS["safetensors"].extension
    if not as_weights:
        _points_query(arguments)  # refuses before the work is done
    encoder = Encoder.open(settings.model[0], settings.threads)
    framing = encoder.framing
    if query.foreground_ratio is not None:
        framing = replace(framing, foreground_ratio=query.foreground_ratio)
    matting = Matting.of(settings.matting_model, settings.threads)
    photo = arguments.photo.read_bytes()
    framed = preprocess(photo, framing, query.background, settings.max_image_pixels, matting)
    functions = encoder.encode(framed.tensor)[0]
    if as_weights:
        weights = Weights(encoder.spec, functions.theta, encoder.name, color=functions.color)
        _write(arguments.output, [dump(weights, "safetensors")])
    else:
        _write_points(arguments, encoder.spec, functions)


def _sample(arguments: argparse.Namespace) -> None:
    """Sample a weights file: the same points as the service gives for the object."""
    _points_query(arguments)
    weights = _load(arguments.weights)
    _write_points(arguments, weights.spec, weights.functions)


def _mesh(arguments: argparse.Namespace) -> None:
    """Write the surface of a weights file: the same triangles as the service gives for the object."""
    fmt = _format(arguments.output, MESH_FORMATS)
    query = MeshQuery(**_given(arguments, MeshQuery))
    weights = _load(arguments.weights)
    sampler = Sampler(weights.spec, word_of(weights.spec, weights.theta))
    _write(arguments.output, [fmt.dump(surface_of(sampler, query.resolution, query.scale))])


def _compose(arguments: argparse.Namespace) -> None:
    """Compose the functions of k weights files and write the points of A B: f_A(f_B(x)), the last one applied first.
    As .png: a picture of the words over two files, A and B; all of k = 2, those from A to B of a larger k."""
    as_picture = arguments.output.suffix == PICTURE
    if not as_picture:
        _points_query(arguments)
    word = [_load(path) for path in arguments.weights]
    kinds = ((each.spec, bool(each.word), each.color.spec if each.color else None) for each in word)
    members = [Member(str(path), *kind) for path, kind in zip(arguments.weights, kinds, strict=True)]
    check(members, "all" if as_picture else "compose")
    if as_picture:
        _write_sheet(arguments, word[0].spec, [each.theta for each in word])
    else:
        _write_points(arguments, word[0].spec, joined([each.functions for each in word]))


def _write_sheet(arguments: argparse.Namespace, spec: MappingSpec, thetas: Sequence[Array]) -> None:
    """A picture of the words over A and B, whose thetas these are, (spec.size,) each."""
    query = PointsQuery(**_given(arguments, PointsQuery))
    if query.n > MAX_POINTS:
        raise InvalidParameter(f"n is {query.n}, a picture shows at most {MAX_POINTS} points of a word", field="n")
    if query.scale != 1:
        raise InvalidParameter("a picture has no scale", field="scale")

    def points(word: str) -> Array:
        functions = tuple(thetas["AB".index(letter)] for letter in word)
        return Sampler(spec.with_k(len(word)), functions).points(query.n, seed=query.seed, sampling=query.sampling)

    rows = [[(label(word, spec.k), points(word)) for word in row] for row in rows_of_words(spec.k)]
    names = (f"{letter}: {path.stem}" for letter, path in zip("AB", arguments.weights, strict=True))
    file = io.BytesIO()
    sheet(rows, ", ".join(names)).save(file, "PNG", optimize=True)
    _write(arguments.output, [file.getvalue()])


def _info(arguments: argparse.Namespace) -> None:
    """Print the model's name, the spec and the size of theta, as JSON; its word and its colour's spec, if any."""
    weights = _load(arguments.weights)
    told: dict[str, Any] = {"model": weights.model, "spec": asdict(weights.spec), "size": weights.spec.size}
    if weights.color:
        told["color_spec"] = asdict(weights.color.spec)
    if weights.word:
        told["word"] = weights.word
    print(json.dumps(told, indent=2))


def _openapi(arguments: argparse.Namespace) -> None:
    """Print the API's schema: openapi.json."""
    from service.app import create_app  # not needed by the other commands
    from service.openapi import openapi_text

    sys.stdout.write(openapi_text(create_app(Settings())))


def _load(path: Path) -> Weights:
    """A weights file. Raises CorruptWeights or InvalidSpec, which name it."""
    try:
        return load(path.read_bytes())
    except HofError as error:
        raise type(error)(f"{path}: {error.detail}") from error


def _points_query(arguments: argparse.Namespace) -> tuple[PointFormat, PointsQuery]:
    """What to sample, and the format that the output's suffix tells."""
    fmt = _format(arguments.output, POINT_FORMATS)
    query = PointsQuery(**_given(arguments, PointsQuery))
    check_size(fmt, query.n, POINTS_CEILING)
    return fmt, query


def _format(path: Path, formats: Mapping[str, Format]) -> Format:
    """The format that a file's suffix tells. Raises InvalidParameter."""
    suffixes = {fmt.extension: fmt for fmt in formats.values()}
    if path.suffix not in suffixes:
        raise InvalidParameter(f"{path}: no format has the suffix {path.suffix!r}, only {', '.join(suffixes)}")
    return suffixes[path.suffix]


def _write_points(arguments: argparse.Namespace, spec: MappingSpec, functions: Functions) -> None:
    fmt, query = _points_query(arguments)
    cloud = query.cloud(spec, functions)
    _write(arguments.output, write(fmt.holding(color=cloud.functions.color is not None), cloud))


def _write(path: Path, pieces: Iterable[bytes]) -> None:
    """Write a file whole or not at all: under another name first, beside where it goes."""
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with part.open("xb") as file:
            file.writelines(pieces)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
