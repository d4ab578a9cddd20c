"""The `hof` command: the HTTP service, and encoding, sampling and meshing without a server."""

import argparse
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from types import FrameType
from typing import Final

from pydantic import BaseModel, ValidationError

from service import __version__
from service.api.keys import SCOPES, make_key
from service.cli import encode, encode_many, files, store
from service.cli.fit import add_fit, fit
from service.cli.flags import Parser, add_framing, add_settings, unusable_setting
from service.errors import HofError
from service.formats.mesh.registry import MESH_FORMATS
from service.formats.path import PATH_FORMATS
from service.formats.points.registry import POINT_FORMATS
from service.formats.weights import WEIGHT_FORMATS
from service.runtime.options import CameraOptions, MeshOptions, PathOptions, PointOptions
from service.server.memory import importing
from service.settings import Settings

FAILED: Final = 2
INTERRUPTED, TERMINATED, UNREAD = 130, 143, 141  # as shells report SIGINT, SIGTERM and SIGPIPE


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit status. An error is one line on stderr."""
    try:
        arguments = _parser().parse_args(argv)
        with nullcontext() if arguments.run is _serve else _ending_on_sigterm():
            status: int | None = arguments.run(arguments)
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:  # the reader of stdout has left, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python flushes stdout at exit
        return UNREAD
    except HofError as error:
        return _fail(error.detail)
    except ValidationError as error:
        return _fail(unusable_setting(error))
    except OSError as error:
        return _fail(f"{error.filename}: {error.strerror}" if error.filename else str(error))
    return status or 0


@contextmanager
def _ending_on_sigterm() -> Iterator[None]:
    """Let SIGTERM end the block like an exception, so that no temporary file is left."""
    if threading.current_thread() is not threading.main_thread():  # only the main thread may set handlers
        yield
        return

    def end(_signal: int, _frame: FrameType | None) -> None:
        raise SystemExit(TERMINATED)

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _fail(message: str) -> int:
    print(f"hof: {message}", file=sys.stderr)
    return FAILED


def _parser() -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = Parser(
        prog="hof", description="Turn a photo of an object into a small function that draws it in 3D."
    )
    parser.add_argument("--version", action="version", version=f"hof {__version__}")
    stages = parser.add_subparsers(required=True, metavar="COMMAND")

    serve = stages.add_parser("serve", help="start the HTTP service", description=_serve.__doc__)
    add_settings(serve)
    serve.set_defaults(run=_serve)

    doctor = stages.add_parser("doctor", help="check this installation", description=_doctor.__doc__)
    add_settings(doctor)
    doctor.set_defaults(run=_doctor)

    key = stages.add_parser("key", help="create an API key", description=_key.__doc__)
    key.add_argument("name", help="name of the key's holder, shown in the log")
    key.add_argument("--scope", choices=SCOPES, action="append", required=True, help="permission; repeat for several")
    key.set_defaults(run=_key)

    _add_commands(stages)
    add_fit(stages.add_parser("fit", help="turn a mesh into a function", description=fit.__doc__))

    store.add_stages(stages.add_parser("store", help="export, import and copy the objects of a database"))

    openapi = stages.add_parser("openapi", help="print the API's schema", description=_openapi.__doc__)
    openapi.set_defaults(run=_openapi)
    return parser


def _add_commands(stages: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the commands that need no server (`service.cli.files`)."""
    _add_encode(
        stages.add_parser(
            "encode", help="turn photos of one object into points or weights", description=encode.encode.__doc__
        )
    )
    encode_many.add_stage(
        stages.add_parser("encode-many", help="turn many photos into a table", description=encode_many.run.__doc__)
    )

    sample = stages.add_parser("sample", help="turn a weights file into points", description=files.sample.__doc__)
    sample.add_argument("weights", type=Path, help="a .safetensors file of `hof encode` or of the service; - for stdin")
    _add_output(sample, [fmt.extension for fmt in POINT_FORMATS.values()])
    _add_sampling(sample)
    sample.set_defaults(run=files.sample)

    mesh = stages.add_parser("mesh", help="turn a weights file into a surface", description=files.mesh.__doc__)
    mesh.add_argument("weights", type=Path, help="a .safetensors file of `hof encode` or of the service; - for stdin")
    _add_output(mesh, [fmt.extension for fmt in MESH_FORMATS.values()])
    _add_fields(mesh, MeshOptions, ["resolution", "scale", "frame", "color", *CameraOptions.model_fields])
    mesh.set_defaults(run=files.mesh)

    _add_path(stages.add_parser("path", help="plan a path around an object", description=files.path.__doc__))

    compose = stages.add_parser(
        "compose", help="compose weights files into points or a picture", description=files.compose.__doc__
    )
    compose.add_argument("weights", type=Path, nargs="+", help="k .safetensors files with the same spec")
    _add_output(compose, [*(fmt.extension for fmt in POINT_FORMATS.values()), files.PICTURE])
    _add_sampling(compose)
    compose.set_defaults(run=files.compose)

    info = stages.add_parser("info", help="describe a weights file", description=files.info.__doc__)
    info.add_argument("weights", type=Path, help="a .safetensors file; - for stdin")
    info.set_defaults(run=files.info)


def _add_encode(stage: argparse.ArgumentParser) -> None:
    stage.add_argument(
        "photo", type=Path, help="PNG, JPEG, WebP or AVIF, or HEIC with the extra `heic`; points or a mesh; - for stdin"
    )
    stage.add_argument(
        "--view",
        type=Path,
        action="append",
        default=[],
        metavar="PHOTO",
        help="another photo of the same object, from another side; repeat for up to 7",
    )
    stage.add_argument("--label", default="", help="name of the object, one line; kept in a .safetensors file")
    _add_output(stage, [*(fmt.extension for fmt in POINT_FORMATS.values()), WEIGHT_FORMATS["safetensors"].extension])
    _add_sampling(stage)
    add_framing(stage)
    add_settings(stage, only={"model", "matting_model", "max_image_pixels", "threads"})
    stage.set_defaults(run=encode.encode)


def _add_path(stage: argparse.ArgumentParser) -> None:
    stage.add_argument("weights", type=Path, help="a .safetensors file of `hof encode` or of the service; - for stdin")
    for name in ("start", "goal"):
        text = PathOptions.model_fields[name].description
        stage.add_argument(f"--{name}", nargs=3, required=True, metavar=("X", "Y", "Z"), help=text)
    _add_output(stage, [fmt.extension for fmt in PATH_FORMATS.values()])
    _add_fields(stage, PathOptions, ["cells", "clearance", "scale", "frame"])
    stage.set_defaults(run=files.path)


def _add_output(parser: argparse.ArgumentParser, suffixes: list[str]) -> None:
    parser.add_argument(
        "-o", "--output", type=Path, required=True, help=f"file to write: {', '.join(suffixes)}; - for stdout"
    )
    names = [suffix.removeprefix(".") for suffix in suffixes]
    parser.add_argument("--format", choices=names, help="format of the output; default: the suffix of its file")


def _add_sampling(parser: argparse.ArgumentParser) -> None:
    _add_fields(parser, PointOptions, ["n", "seed", "scale", "frame", "sampling", "color", *CameraOptions.model_fields])


def _add_fields(parser: argparse.ArgumentParser, model: type[BaseModel], names: Sequence[str]) -> None:
    for name in names:
        field = model.model_fields[name]
        default = "" if field.default is None else f"; default: {field.default}"
        parser.add_argument(f"--{name}", default=argparse.SUPPRESS, help=f"{field.description}{default}")


def _serve(arguments: argparse.Namespace) -> None:
    """Serve the API. Each flag has an environment variable, in brackets."""
    with importing():
        from service.server.serve import serve  # imported here so that the other commands start fast

    serve(files.settings_of(arguments))


def _doctor(arguments: argparse.Namespace) -> int:
    """Check what `hof serve` needs, one line per check. The exit status is 1 if the service would not run."""
    from service.cli.doctor import examine

    failed = False
    for finding in examine(files.settings_of(arguments)):
        print(finding, flush=True)
        failed |= finding.state == "fail"
    return int(failed)


def _key(arguments: argparse.Namespace) -> None:
    """Create an API key. Its line for the keys file goes to stdout, the key itself to stderr; it is not shown again."""
    token, key = make_key(arguments.name, frozenset(arguments.scope))
    print(f"hof: the key, which is not shown again: {token}", file=sys.stderr)
    print(key.line)


def _openapi(arguments: argparse.Namespace) -> None:
    """Print the API's schema (openapi.json)."""
    from service.api.app import create_app
    from service.api.openapi import openapi_text

    sys.stdout.write(openapi_text(create_app(Settings())))
