"""Flags from the fields of a config, one each, with its default, limits and help text."""

import argparse
import math
from collections.abc import Callable, Collection
from dataclasses import fields
from typing import TYPE_CHECKING, Any, Literal, get_args, get_origin, get_type_hints

if TYPE_CHECKING:
    from dataclasses import Field

    from _typeshed import DataclassInstance

Number = int | float


class Parser(argparse.ArgumentParser):
    """A parser that refuses abbreviated flags: `--minute` is not `--minutes`. Parsers of stages do as well."""

    def __init__(self, *args: Any, **options: Any) -> None:  # noqa: ANN401 - as argparse.ArgumentParser
        super().__init__(*args, **options)
        self.allow_abbrev = False


def add_flags(
    stage: argparse._ActionsContainer, config: "DataclassInstance", only: Collection[str] | None = None
) -> None:
    """Add a flag for each field of `config` that `model.config.option` declares; its values are the shown defaults.

    A flag that is not on the command line leaves no attribute, so that `values` returns what the user set.

    Parameters
    ----------
    only : names of fields; default: all.
    """
    kinds = get_type_hints(type(config))
    for each in fields(config):
        if "help" not in each.metadata or (only is not None and each.name not in only):
            continue
        default = _shown(getattr(config, each.name))
        stage.add_argument(
            f"--{each.name.replace('_', '-')}",
            default=argparse.SUPPRESS,
            help=(each.metadata["help"] + (f"; default: {default}" if default else "")).replace("%", "%%"),
            **_parsing(each, kinds[each.name]),
        )


def values(arguments: argparse.Namespace, config: "type[DataclassInstance]") -> dict[str, Any]:
    """Return the fields of `config` that the command line sets, by name."""
    names = {each.name for each in fields(config)}
    return {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in vars(arguments).items()
        if name in names
    }


def number(
    kind: type[Number], least: float | None = None, above: float | None = None, most: float | None = None
) -> Callable[[str], Number]:
    """Return a parser of numbers within limits; its error names the value and what is allowed."""

    def parse(text: str) -> Number:
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        if (
            not math.isfinite(value)
            or (least is not None and value < least)
            or (above is not None and value <= above)
            or (most is not None and value > most)
        ):
            raise argparse.ArgumentTypeError(f"{text!r} is not {_allowed(kind, least, above, most)}")
        return value

    return parse


def _parsing(option: "Field[Any]", kind: Any) -> dict[str, Any]:  # noqa: ANN401 - a type, or a union of types
    """Return the arguments of `add_argument` that turn text into the field's type."""
    if kind is bool:
        return {"action": argparse.BooleanOptionalAction}
    if get_origin(kind) is Literal:
        return {"choices": get_args(kind)}
    types = {part for part in (get_args(kind) or (kind,)) if part not in (type(None), ...)}
    metavar = option.name.rsplit("_", 1)[-1].upper()
    if types == {str}:
        return {"metavar": metavar}
    limits = {name: option.metadata[name] for name in ("least", "above", "most")}
    several = {"nargs": "+"} if get_origin(kind) is tuple else {}
    return {"type": number(types.pop(), **limits), "metavar": metavar, **several}


def _allowed(kind: type[Number], least: float | None, above: float | None, most: float | None) -> str:
    noun = "a whole number" if kind is int else "a number"
    low = f" of at least {least:g}" if least is not None else f" above {above:g}" if above is not None else ""
    high = f"{' and' if low else ' of'} at most {most:g}" if most is not None else ""
    return f"{noun}{low}{high}"


def _shown(default: object) -> str:
    if default is None:
        return ""
    if isinstance(default, bool):
        return "yes" if default else "no"
    return " ".join(map(str, default)) if isinstance(default, tuple) else str(default)
