"""`hof-model data`: build a data set, vary it, add procedural pieces, preview it."""

import argparse
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final

from model.cli.infinigen import add_infinigen
from model.cli.pack import add_pack
from model.data.manifest import SPLITS
from model.data.sources.axes import AXES

if TYPE_CHECKING:
    from model.data.sources.meshes import MeshRecord

DATA: Final = Path("data/sweethome3d")


def add_stages(data: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the stages. Each sets `run`, a function of the parsed arguments."""
    _add_build(data.add_parser("build", help="render meshes, drop duplicates, split"))
    _add_vary(data.add_parser("vary", help="render a built data set's objects from free cameras and in other shapes"))
    textures = data.add_parser("textures", help="collect the training objects' textures for `vary` and `make`")
    textures.set_defaults(run=_textures)
    add_source(textures)
    add_infinigen(data.add_parser("infinigen", help="make meshes of furniture and other things, for `make --meshes`"))
    _add_make(data.add_parser("make", help="make procedural furniture and other things, for training only"))
    notice = data.add_parser("notice", help="write the credits of the objects trained on, for NOTICE")
    notice.set_defaults(run=_notice)
    notice.add_argument("--data", type=Path, default=DATA, help="folder of the data set")
    notice.add_argument("--split", choices=SPLITS, default="train", help="split to credit; default: train")
    notice.add_argument("-o", "--output", type=Path, help="file; default: print it")
    photographs = data.add_parser("photographs", help="download free photographs as backgrounds for training")
    photographs.set_defaults(run=_photographs)
    photographs.add_argument("--data", type=Path, default=DATA, help="folder of the data set")
    add_pack(data.add_parser("pack", help="write a data set as a few large files, to train from on a GPU"), DATA)
    _add_preview(data.add_parser("preview", help="write a contact sheet of views and points"))


def _add_build(build: argparse.ArgumentParser) -> None:
    """Declare the flags of `build`."""
    build.set_defaults(run=_build)
    build.add_argument("--out", type=Path, default=DATA, help="folder of the data set")
    build.add_argument("--sh3f", type=Path, help="folder of .sh3f files, or the .deb; default: download")
    build.add_argument("--meshes", type=Path, help="folder of meshes (OBJ, GLB, glTF, PLY, STL, OFF) to use instead")
    build.add_argument("--license", "--licence", default="unknown", help="license of --meshes, for the manifest")
    build.add_argument("--up", choices=AXES, default="y", help="axis that points up in --meshes; default: y")
    build.add_argument(
        "--front", choices=AXES, help="axis that points to the viewer in --meshes; default: z, or -y with --up z"
    )
    build.add_argument("--split", choices=SPLITS, help="put all new objects in this split; default: 80/10/10 at random")
    build.add_argument("--limit", type=int, help="use only the first LIMIT meshes")
    build.add_argument("--seed", type=int, default=0, help="seed of the cameras, and of the split of new objects")
    build.add_argument("--processes", type=int, default=os.cpu_count() or 1, help="worker processes")


def _add_vary(vary: argparse.ArgumentParser) -> None:
    """Declare the flags of `vary`."""
    vary.set_defaults(run=_vary)
    add_source(vary)
    vary.add_argument(
        "--variants",
        type=int,
        default=13,
        help="other shapes per training object: 4 stretched, 5 warped, the rest warped with other textures",
    )
    vary.add_argument("--views", type=int, default=12, help="views per shape")
    vary.add_argument("--processes", type=int, default=os.cpu_count() or 1, help="worker processes")


def _add_make(make: argparse.ArgumentParser) -> None:
    """Declare the flags of `make`."""
    make.set_defaults(run=_make)
    make.add_argument("--data", type=Path, default=DATA, help="folder of the data set")
    pieces = make.add_mutually_exclusive_group()
    pieces.add_argument("--pieces", type=int, default=9_000, help="number of pieces")
    pieces.add_argument("--meshes", type=Path, help="folder of meshes to make the pieces of, in place of rules")
    make.set_defaults(license="unknown", up="y", front=None)
    make.add_argument("--views", type=int, default=10, help="views per piece")
    make.add_argument("--processes", type=int, default=os.cpu_count() or 1, help="worker processes")


def _add_preview(preview: argparse.ArgumentParser) -> None:
    """Declare the flags of `preview`."""
    preview.set_defaults(run=_preview)
    preview.add_argument("--data", type=Path, default=DATA, help="folder of the data set")
    preview.add_argument("-o", "--output", type=Path, default=Path("out/preview.png"))
    preview.add_argument("--objects", type=int, default=24, help="number of objects")
    preview.add_argument("--variants", action="store_true", help="show the variants that `vary` wrote, one per row")


def add_source(stage: argparse.ArgumentParser) -> None:
    """Declare the options for a built data set and the meshes that it was built from."""
    stage.set_defaults(license="unknown", up="y", front=None)  # the data set's manifest has what `build` was told
    stage.add_argument("--data", type=Path, default=DATA, help="folder of the data set")
    stage.add_argument("--sh3f", type=Path, help="same as for `build`")
    stage.add_argument("--meshes", type=Path, help="same as for `build`")


def _build(arguments: argparse.Namespace) -> None:
    from model.data.build import build
    from model.data.sources.meshes import skipped_files
    from model.data.sources.sweethome3d import frozen_split

    records = records_of(arguments, arguments.out)
    frozen = {} if arguments.meshes else frozen_split()
    manifest = build(
        records[: arguments.limit], arguments.out, arguments.seed, arguments.processes, frozen, arguments.split
    )
    sizes = {split: sum(1 for _ in manifest.of(split)) for split in SPLITS}
    print(
        f"{sizes}, {len(manifest.duplicates)} duplicates, {len(manifest.failures)} failures, "
        f"{len(manifest.losses)} without a texture: {arguments.out}"
    )
    if arguments.meshes and (skipped := skipped_files(arguments.meshes)):
        print(f"{arguments.meshes}: {skipped}", file=sys.stderr)
    if empty := [split for split, size in sizes.items() if not size]:
        print(
            f"no objects in {' and '.join(empty)}: training needs all three splits. Add meshes (ten objects give one "
            "to each split), or build others into the same --out without --split",
            file=sys.stderr,
        )


def records_of(arguments: argparse.Namespace, folder: Path) -> "list[MeshRecord]":
    """Return the meshes of `--meshes`, or else Sweet Home 3D's, unpacked below `folder`."""
    from model.data.sources.listed import mesh_records
    from model.data.sources.sweethome3d import sh3f_files, sh3f_records

    if arguments.meshes:
        return mesh_records(arguments.meshes, arguments.license, arguments.up, arguments.front)
    work = folder / "source"
    return [record for file in sh3f_files(arguments.sh3f, work) for record in sh3f_records(file, work)]


def _vary(arguments: argparse.Namespace) -> None:
    from model.data.manifest import VARIANTS
    from model.data.variants import vary

    records = records_of(arguments, arguments.data)
    failures = vary(records, arguments.data, arguments.variants, arguments.views, arguments.processes)
    print(f"{len(failures)} failures: {arguments.data / VARIANTS}")


def _textures(arguments: argparse.Namespace) -> None:
    from model.data.procedural.textures import gather_textures

    print(f"{len(gather_textures(records_of(arguments, arguments.data), arguments.data))} textures")


def _make(arguments: argparse.Namespace) -> None:
    from model.data.manifest import PIECES
    from model.data.procedural.from_meshes import make_from_meshes
    from model.data.procedural.pieces import make

    if arguments.meshes:
        records = records_of(arguments, arguments.data)
        manifest = make_from_meshes(records, arguments.data, arguments.views, arguments.processes)
        counts = f"{len(manifest.entries)} pieces of meshes, {len(manifest.duplicates)} duplicates"
        print(f"{counts}, {len(manifest.failures)} failures: {arguments.data / PIECES}")
        return
    failures = make(arguments.data, arguments.pieces, arguments.views, arguments.processes)
    print(f"{len(failures)} failures: {arguments.data / PIECES}")


def _notice(arguments: argparse.Namespace) -> None:
    from model.data.manifest import Manifest, piece_entries
    from model.data.notice import notice

    pieces = piece_entries(arguments.data) if arguments.split == "train" else ()
    text = notice([*Manifest.read(arguments.data).of(arguments.split), *pieces])
    if arguments.output:
        arguments.output.write_text(text, encoding="utf-8")
        print(arguments.output)
    else:
        print(text, end="")


def _photographs(arguments: argparse.Namespace) -> None:
    from model.data.sources.photographs import fetch_photographs

    print(f"{len(fetch_photographs(arguments.data, arguments.data / 'source'))} photographs")


def _preview(arguments: argparse.Namespace) -> None:
    from model.data.rendering.preview import preview

    preview(arguments.data, arguments.output, arguments.objects, arguments.variants)
    print(arguments.output)
