"""`hof-model`: build data, train, evaluate, export. One subcommand per stage."""

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

DATA = Path("data/sweethome3d")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one stage; its modules are imported only then. Returns the exit status."""
    arguments = _parser().parse_args(argv)
    try:
        run = arguments.run
        run(arguments)
    except (OSError, ValueError) as error:
        print(f"hof-model: {error}", file=sys.stderr)
        return 2
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="hof-model", description=__doc__)
    stages = parser.add_subparsers(required=True, metavar="STAGE")
    data = stages.add_parser("data", help="build or look at a data set").add_subparsers(required=True)
    build = data.add_parser("build", help="render meshes, drop duplicates, split")
    build.set_defaults(run=_build)
    build.add_argument("--out", type=Path, default=DATA)
    build.add_argument("--sh3f", type=Path, help="folder of .sh3f files, or the .deb; default: download it")
    build.add_argument("--meshes", type=Path, help="a folder of OBJ/GLB/PLY/STL/OFF instead of Sweet Home 3D")
    build.add_argument("--licence", default="unknown", help="licence of --meshes, written to the manifest")
    build.add_argument("--limit", type=int, help="only the first LIMIT meshes")
    build.add_argument("--seed", type=int, default=0)
    build.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    preview = data.add_parser("preview", help="write a contact sheet of views and points")
    preview.set_defaults(run=_preview)
    preview.add_argument("--data", type=Path, default=DATA)
    preview.add_argument("-o", "--output", type=Path, default=Path("out/preview.png"))
    preview.add_argument("--objects", type=int, default=24)
    return parser


def _build(arguments: argparse.Namespace) -> None:
    from model.data.build import build
    from model.data.meshes import folder_records
    from model.data.sweethome3d import sh3f_files, sh3f_records

    if arguments.meshes:
        records = list(folder_records(arguments.meshes, arguments.licence))
    else:
        work = arguments.out / "source"
        records = [record for file in sh3f_files(arguments.sh3f, work) for record in sh3f_records(file, work)]
    manifest = build(records[: arguments.limit], arguments.out, arguments.seed, arguments.processes)
    sizes = {split: sum(1 for _ in manifest.of(split)) for split in ("train", "val", "test")}
    print(f"{sizes}, {len(manifest.duplicates)} duplicates, {len(manifest.failures)} failures: {arguments.out}")


def _preview(arguments: argparse.Namespace) -> None:
    from model.data.preview import preview

    preview(arguments.data, arguments.output, arguments.objects)
    print(arguments.output)


if __name__ == "__main__":
    sys.exit(main())
