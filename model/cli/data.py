"""`hof-model data`: build a data set, vary it, add made furniture, look at it."""

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING, Final

from model.cli.pack import add_pack

if TYPE_CHECKING:
    from model.data.sources.meshes import MeshRecord

DATA: Final = Path("data/sweethome3d")


def add_stages(data: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the stages: each sets `run`, a function of the parsed arguments."""
    build = data.add_parser("build", help="render meshes, drop duplicates, split")
    build.set_defaults(run=_build)
    build.add_argument("--out", type=Path, default=DATA)
    build.add_argument("--sh3f", type=Path, help="folder of .sh3f files, or the .deb; default: download it")
    build.add_argument("--meshes", type=Path, help="a folder of OBJ/GLB/PLY/STL/OFF instead of Sweet Home 3D")
    build.add_argument("--licence", default="unknown", help="licence of --meshes, written to the manifest")
    build.add_argument("--limit", type=int, help="only the first LIMIT meshes")
    build.add_argument("--seed", type=int, default=0, help="of cameras, and of the split of what has none yet")
    build.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    vary = data.add_parser("vary", help="render free cameras and other shapes of a built data set")
    vary.set_defaults(run=_vary)
    _add_source(vary)
    vary.add_argument(
        "--variants",
        type=int,
        default=13,
        help="other shapes per training object: 4 stretched, 5 warped, then redressed",
    )
    vary.add_argument("--views", type=int, default=12, help="per shape")
    vary.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    textures = data.add_parser("textures", help="keep the training objects' textures, for `vary` and `make`")
    textures.set_defaults(run=_textures)
    _add_source(textures)
    make = data.add_parser("make", help="make furniture and other things by rule, for training only")
    make.set_defaults(run=_make)
    make.add_argument("--data", type=Path, default=DATA)
    make.add_argument("--pieces", type=int, default=9_000)
    make.add_argument("--views", type=int, default=10, help="per piece")
    make.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    photographs = data.add_parser("photographs", help="download free photographs to stand behind objects in training")
    photographs.set_defaults(run=_photographs)
    photographs.add_argument("--data", type=Path, default=DATA)
    add_pack(data.add_parser("pack", help="write a data set as a few large files, to train from on a GPU"), DATA)
    preview = data.add_parser("preview", help="write a contact sheet of views and points")
    preview.set_defaults(run=_preview)
    preview.add_argument("--data", type=Path, default=DATA)
    preview.add_argument("-o", "--output", type=Path, default=Path("out/preview.png"))
    preview.add_argument("--objects", type=int, default=24)
    preview.add_argument("--variants", action="store_true", help="what `vary` wrote, one row per variant")


def _add_source(stage: argparse.ArgumentParser) -> None:
    """A built data set, and the meshes that it was built of."""
    stage.set_defaults(licence="unknown")  # the manifest has the licence
    stage.add_argument("--data", type=Path, default=DATA)
    stage.add_argument("--sh3f", type=Path, help="as for build")
    stage.add_argument("--meshes", type=Path, help="as for build")


def _build(arguments: argparse.Namespace) -> None:
    from model.data.build import build
    from model.data.sources.sweethome3d import frozen_split

    records = _records(arguments, arguments.out)
    frozen = {} if arguments.meshes else frozen_split()
    manifest = build(records[: arguments.limit], arguments.out, arguments.seed, arguments.processes, frozen)
    sizes = {split: sum(1 for _ in manifest.of(split)) for split in ("train", "val", "test")}
    print(f"{sizes}, {len(manifest.duplicates)} duplicates, {len(manifest.failures)} failures: {arguments.out}")


def _records(arguments: argparse.Namespace, folder: Path) -> "list[MeshRecord]":
    """The meshes of `--meshes`, else Sweet Home 3D's, unpacked below `folder`."""
    from model.data.sources.meshes import folder_records
    from model.data.sources.sweethome3d import sh3f_files, sh3f_records

    if arguments.meshes:
        return list(folder_records(arguments.meshes, arguments.licence))
    work = folder / "source"
    return [record for file in sh3f_files(arguments.sh3f, work) for record in sh3f_records(file, work)]


def _vary(arguments: argparse.Namespace) -> None:
    from model.data.manifest import VARIANTS
    from model.data.variants import vary

    records = _records(arguments, arguments.data)
    failures = vary(records, arguments.data, arguments.variants, arguments.views, arguments.processes)
    print(f"{len(failures)} failures: {arguments.data / VARIANTS}")


def _textures(arguments: argparse.Namespace) -> None:
    from model.data.procedural.textures import gather_textures

    print(f"{len(gather_textures(_records(arguments, arguments.data), arguments.data))} textures")


def _make(arguments: argparse.Namespace) -> None:
    from model.data.manifest import MADE
    from model.data.procedural.pieces import make

    failures = make(arguments.data, arguments.pieces, arguments.views, arguments.processes)
    print(f"{len(failures)} failures: {arguments.data / MADE}")


def _photographs(arguments: argparse.Namespace) -> None:
    from model.data.sources.photographs import fetch_photographs

    print(f"{len(fetch_photographs(arguments.data, arguments.data / 'source'))} photographs")


def _preview(arguments: argparse.Namespace) -> None:
    from model.data.rendering.preview import preview

    preview(arguments.data, arguments.output, arguments.objects, arguments.variants)
    print(arguments.output)
