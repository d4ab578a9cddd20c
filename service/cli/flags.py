"""Flags that several commands share."""

import argparse
from typing import get_args, get_origin

from service.encoding.framing import Background
from service.settings import Settings


def add_settings(parser: argparse.ArgumentParser, only: set[str] | None = None) -> None:
    """Add a flag for each field of Settings; pydantic parses and checks the values."""
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


def add_framing(parser: argparse.ArgumentParser) -> None:
    """Add the flags that say how an object is cut out of its photo (`service.runtime.options.EncodeOptions`)."""
    parser.add_argument("--background", choices=get_args(Background), help="background removal; default: auto")
    parser.add_argument(
        "--foreground-ratio",
        type=float,
        help="share of the input that the object fills, 0.1 to 1; default: the model's",
    )
