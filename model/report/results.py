"""Evaluate exported models and write RESULTS.md, its pictures and the records behind it."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from model.data.manifest import Split
from model.evaluation.classes import class_of
from model.evaluation.color import color_record
from model.evaluation.comparison import COUNTS, encoder_record, oracle_of_all, references
from model.evaluation.conditions import CONDITIONS
from model.evaluation.evaluate import Case, cases
from model.evaluation.locations import COLOR, RESULTS, SURFACES
from model.evaluation.records import Record
from model.evaluation.surfaces import Trials
from model.evaluation.timing import encoder_ms
from model.report import color, estimates, mattes, mixtures, runs, surfaces
from model.report.page import Shipped, all_evaluations, markdown
from model.report.sheets import everyday_objects, first_objects
from model.report.targets import checks, target_table
from service.encoding.encoder import Encoder
from service.encoding.masks import MattingFunction


def report(
    models: Sequence[Path],
    data: Path,
    split: Split,
    root: Path,
    seed: int = 0,
    matting: MattingFunction | None = None,
) -> str:
    """Evaluate ONNX files; write `root/RESULTS.md`, `root/model/results/<model>.json` and the first model's pictures.

    The page is about the first model. The others and every other record in `root/model/results` enter the tables, as do
    the records of `hof-model mixtures` and `hof-model surfaces`. Returns the table of targets.

    Raises
    ------
    FileNotFoundError : no data set, or `hof-model data vary` or `hof-model surfaces` has not been run.
    ValueError : a record holds other objects.
    """
    model, *beside = models
    encoder = Encoder.open(model, threads=1)
    shipped = Shipped(encoder.name, encoder.digest, model.stat().st_size, encoder_ms(model.read_bytes()))
    folder = root / RESULTS
    objects = list(cases(data, split))
    read_others(root, encoder.name, split, objects)
    ours = encoder_record(encoder, data, split, seed, CONDITIONS, COUNTS, matting)
    untrained = (*references(data, split, seed, CONDITIONS, matting), oracle_of_all(data, split))
    ours = replace(ours, evaluations=(*ours.evaluations, *untrained))
    ours.write(folder / f"{encoder.name}.json")
    for other in (Encoder.open(path, threads=1) for path in beside):
        encoder_record(other, data, split, seed).write(folder / f"{other.name}.json")
    _draw(encoder, objects, folder)
    others = read_others(root, encoder.name, split, objects)
    in_color = color_record(encoder, data, split, seed) if encoder.color_spec else None
    if in_color:
        in_color.write(root / COLOR / f"{encoder.name}.json")
    classes = [class_of(case.entry) for case in objects]
    targets = target_table(checks(all_evaluations(ours, others), ours.method, classes, shipped.bytes_, shipped.ms))
    page = markdown(ours, others, shipped, classes, targets, _sections(root, in_color))
    (root / "RESULTS.md").write_text(page, encoding="utf-8")
    return targets


def _draw(encoder: Encoder, objects: Sequence[Case], folder: Path) -> None:
    """Write the pictures of an encoder's objects."""
    for suffix, sheet in (("", first_objects), ("-everyday", everyday_objects)):
        sheet(encoder, objects).quantize().save(folder / f"{encoder.name}{suffix}.png", optimize=True)


def _sections(root: Path, in_color: Record | None) -> list[str]:
    """Return the sections on other measurements, those that have a record."""
    sections = [
        runs.section(root),
        surfaces.section(Trials.read(root / SURFACES)),
        mixtures.section(root),
        color.section(in_color) if in_color else "",
        estimates.sections(root),
        mattes.section(root),
    ]
    return [section for section in sections if section]


def read_others(root: Path, ours: str, split: Split, objects: Sequence[Case]) -> list[Record]:
    """Read the records of methods other than `ours`, in order of their paths.

    Raises
    ------
    ValueError : a record holds other objects than `objects`.
    """
    ids = tuple(case.entry.id for case in objects)
    records = []
    for path in sorted({*(root / RESULTS).glob("*.json")} - {root / SURFACES}):
        record = Record.read(path)
        if record.method == ours:
            continue
        if (record.split, record.ids) != (split, ids):
            raise ValueError(
                f"{path} is of other objects than the {split} split of this data set: build the data set that it was "
                "measured on, or measure it again with `hof-model evaluate -o`"
            )
        records.append(record)
    return records
