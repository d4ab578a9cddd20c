"""Flags that several commands share."""

import argparse
from typing import Any, Final, get_args, get_origin

from pydantic import ValidationError

from service.encoding.framing import Background
from service.settings import Settings

HIDDEN: Final = "database_url"  # it may hold a password


class Parser(argparse.ArgumentParser):
    """A parser that refuses abbreviated flags: `--store` is not `--store-dtype`. Parsers of commands do as well."""

    def __init__(self, *args: Any, **options: Any) -> None:  # noqa: ANN401 - as argparse.ArgumentParser
        super().__init__(*args, **options)
        self.allow_abbrev = False


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


def unusable_setting(error: ValidationError) -> str:
    """Return which setting is wrong, by its flag and its variable, the limit and the value."""
    first = error.errors()[0]
    if not first["loc"]:  # several settings that do not fit together
        return first["msg"]
    name = str(first["loc"][0])
    text = f"{first['msg']}, not {first['input']!r}"
    if first["type"] == "value_error":  # of our own validators, which name the value
        text = str(first["ctx"]["error"])
    elif name == HIDDEN:
        text = first["msg"]
    return f"HOF_{name.upper()} or --{name.replace('_', '-')}: {text}"


def add_framing(parser: argparse.ArgumentParser) -> None:
    """Add the flags that say how an object is cut out of its photo (`service.runtime.options.EncodeOptions`)."""
    parser.add_argument("--background", choices=get_args(Background), help="background removal; default: auto")
    parser.add_argument(
        "--foreground-ratio",
        type=float,
        help="share of the input that the object fills, 0.1 to 1; default: the model's",
    )
