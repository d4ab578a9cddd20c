"""`hof encode-many`: many photos become a table of objects."""

import argparse
import sys
from functools import partial
from pathlib import Path

from service.cli.files import options_of, settings_of
from service.cli.flags import add_framing, add_settings
from service.cli.progress import ProgressLine
from service.cli.store import check_bulk
from service.errors import InvalidParameter
from service.runtime.bulk.sources import photos_of
from service.runtime.options import EncodeOptions
from service.settings import available_cpus


def add_stage(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `hof encode-many`."""
    parser.add_argument(
        "photos",
        help="a folder, searched with its subfolders; s3://BUCKET/FOLDER; a text file with a path on each line; or a "
        "pattern in quotes, such as 'photos/**/*.jpg'",
    )
    parser.add_argument("-o", "--output", type=Path, required=True, help="file to write, .parquet; it must not exist")
    add_framing(parser)
    parser.add_argument(
        "--processes", type=int, help="photos that are encoded at a time; default: number of CPUs that it may use"
    )
    add_settings(parser, only={"model", "matting_model", "max_image_bytes", "max_image_pixels"})
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Encode many photos and write their objects to a Parquet file, a row each.

    A photo that cannot be encoded is a row whose column `error` says why. Run it again if it was stopped: finished rows
    are kept beside the output until it is complete.
    """
    check_bulk("hof encode-many")
    if str(arguments.output).lower().startswith("s3:"):
        raise InvalidParameter("the output has to be a local file; copy it to S3 once it is complete", field="output")
    from service.runtime.bulk.encoding import encode_many
    from service.runtime.bulk.photos import Setup

    settings, options = settings_of(arguments), options_of(arguments, EncodeOptions)
    processes = available_cpus() if arguments.processes is None else arguments.processes
    if processes < 1:
        raise InvalidParameter(f"processes is {processes}, it must be 1 or more", field="processes")
    setup = Setup(
        settings.model[0],
        settings.matting_model,
        options.background,
        options.foreground_ratio,
        settings.max_image_bytes,
        settings.max_image_pixels,
    )
    progress = ProgressLine("photos")
    try:
        objects, failed = encode_many(
            setup, partial(photos_of, arguments.photos), arguments.output, processes, progress
        )
    finally:
        progress.end()
    report = f"{objects} objects" + (f", {failed} photos that could not be encoded (column error)" if failed else "")
    print(f"hof: {arguments.output}: {report}", file=sys.stderr)
