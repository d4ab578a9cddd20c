"""Flags that stand for settings."""

import argparse
from typing import get_origin

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
