"""`hof-model`: build data, train, evaluate, export. One subcommand per stage."""

import argparse
import sys
from collections.abc import Sequence
from typing import Final

from model.cli import data, distill, evaluate, fit, heads, matte, paper, train
from model.cli.common import resolve_data
from model.cli.flags import Parser
from service.errors import HofError

INTERRUPTED: Final = 130  # as shells report SIGINT


def main(argv: Sequence[str] | None = None) -> int:
    """Run one stage; its modules are imported only then. Return the exit status."""
    try:
        arguments = _parser().parse_args(argv)
        resolve_data(arguments)
        arguments.run(arguments)
    except KeyboardInterrupt:
        return INTERRUPTED
    except (OSError, ValueError, HofError) as error:
        print(f"hof-model: {error}", file=sys.stderr)
        return 2
    return 0


def _parser() -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = Parser(prog="hof-model", description=__doc__)
    stages = parser.add_subparsers(required=True, metavar="STAGE")
    data.add_stages(stages.add_parser("data", help="build or look at a data set").add_subparsers(required=True))
    train.add_stages(stages)
    distill.add_stage(stages)
    heads.add_stages(stages)
    matte.add_stages(stages)
    evaluate.add_stages(stages)
    paper.add_stage(stages)
    fit.add_stage(stages)
    return parser


if __name__ == "__main__":
    sys.exit(main())
