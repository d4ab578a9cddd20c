"""The model card: metadata of a weights file, and its Markdown page."""

import re
from collections.abc import Collection
from pathlib import Path
from typing import Any

from model.config import POINT_TRUNKS, TrainConfig
from model.data.manifest import SPLITS, Entry, Manifest
from model.data.sources.sweethome3d import frozen_split
from model.evaluation.evaluate import Evaluation
from model.metrics import NAMES, interval
from model.provenance import provenance
from model.report.tables import table
from service.files import whole_file

TRUNKS = {
    "dense": "the paper's DenseNet, trained from scratch",
    "lite0": "EfficientNet-Lite0's convolutions (Apache-2.0), pretrained on ImageNet",
    "resnet18": "the paper's ResNet18, trained from scratch",
    "pointnet": "PointNet in two stages, trained from scratch",
    "grid": "the paper's DenseNet on a grid of 64 x 64 x 64 cells, trained from scratch",
}
LICENSE = "Apache-2.0; trained on CC-BY and CC0 meshes, attribution in NOTICE"  # of models trained on Sweet Home 3D
# Licenses of meshes that allow weights under another license, given the credits in NOTICE; and words that rule it out.
OPEN = re.compile(r"CC0|CC[- ]BY\b|Creative Commons Attribution|Public domain|Apache|BSD|MIT\b|SCEA\b", re.IGNORECASE)
CLOSED = re.compile(r"\b(NC|ND|SA|Non-?Commercial|No-?Deriv\w*|Share-?Alike|LicenseRef)\b", re.IGNORECASE)
# Additions to a license that limit the use of names and logos, which weights do not hold.
MARKS = re.compile(r"/LicenseRef-LegalMark-\w+|LicenseRef-(?=CC-BY-TM)")
LIMITS = (
    "The front of an object is at +Z. From a view of the back the model guesses where the front is.",
    "Thin parts (chair legs, lamp stems) come out too thick or too thin, and unseen sides are guesses.",
    "A photo does not show scale: the longest side is 1 unless you pass `scale`.",
)
POINT_LIMITS = (
    "Parts that the points do not show are guesses. Points of several objects, or of a floor, count as one object.",
)
COLOR_LIMIT = (
    "Colors are those of the materials without light, estimated from a lit photo: about right on large parts, "
    "blurred over patterns and small parts."
)
NO_COLOR_LIMIT = "Geometry only: no color."


def make_card(
    name: str,
    config: TrainConfig,
    run: dict[str, Any],
    manifest: Manifest,
    color: dict[str, Any] | None = None,
    pieces: Collection[Entry] = (),
) -> dict[str, Any]:
    """Return the card of a trained encoder, without its figures.

    Parameters
    ----------
    run : `step` and `elapsed_s` of the checkpoint.
    color : training of the color head; None without one.
    pieces : made from meshes, and trained on too.
    """
    sizes = {split: sum(1 for _ in manifest.of(split)) for split in SPLITS}
    licenses = sorted({f"{entry.source}: {entry.license}" for entry in (*manifest.entries, *pieces)})
    return {
        "name": name,
        "version": "1",
        "license": license_of(manifest, pieces),
        "trunk": TRUNKS[config.encoder.trunk],
        "method": "Higher-Order Function networks (Mitchell, Engin, Isler, Lee; ICLR 2020)",
        "data": {"objects": sizes, "seed": manifest.seed, "licences": licenses, "made": config.made},
        "training": {
            "minutes": round(run["elapsed_s"] / 60, 1),
            "steps": run["step"],
            "config": config.to_dict(),
        },
        "exported": provenance(config.seed),
        **({"color": color} if color else {}),
        "limits": _limits(manifest, config, len(pieces), color is not None),
    }


def _limits(manifest: Manifest, config: TrainConfig, meshes: int, has_color: bool) -> list[str]:
    """Return the sentences on what the model does not do; `meshes` is the number of pieces."""
    if config.encoder.takes_points:
        return [_training_parts(manifest, config, meshes), *POINT_LIMITS, NO_COLOR_LIMIT]
    return [_training_images(manifest, config, meshes), *LIMITS, COLOR_LIMIT if has_color else NO_COLOR_LIMIT]


def license_of(manifest: Manifest, pieces: Collection[Entry] = ()) -> str:
    """Return the license of the weights, with the license of each source of training meshes, `pieces` included."""
    objects = [*manifest.of("train"), *pieces]
    if {entry.id for entry in objects} <= set(frozen_split()):
        return LICENSE
    sources = {(entry.source, entry.license) for entry in objects}
    unclear = {
        (source, license_)
        for source, license_ in sources
        for kept in [MARKS.sub("", license_)]
        if not OPEN.match(kept) or CLOSED.search(kept)
    }
    if not unclear:
        return f"Apache-2.0; trained on meshes with attribution in NOTICE: {_join(sources)}"
    return f"not settled: read the terms of {_join(unclear)} before you share the file" + (
        f"; other meshes: {_join(sources - unclear)}" if sources - unclear else ""
    )


def _join(sources: set[tuple[str, str]]) -> str:
    return ", ".join(f"{source} ({license_})" for source, license_ in sorted(sources))


def _distilled(training: dict[str, Any] | None) -> str:
    """Return the line on the distillation; empty without one."""
    if training is None:
        return ""
    images = training["steps"] * training["batch"]
    return f"""
- **Distilled**: what it saw over white, it learned to see before {training["photographs"]} photographs, flat colors and
  textures; {images:,} images, {training["minutes"]} minutes, {training["date"]}, commit {training["commit"]}."""


def _estimates(training: dict[str, Any] | None) -> str:
    """Return the line on the heads for the shape's confidence and the camera; empty without them."""
    if training is None:
        return ""
    kept_out = f"; measured on the sources {', '.join(training['kept_out'])}" if training["kept_out"] else ""
    return f"""
- **Shape confidence and camera**: heads on the frozen encoder, {training["images"]:,} images of
  {training["objects"]:,} objects{kept_out}."""


def _training_images(manifest: Manifest, config: TrainConfig, meshes: int) -> str:
    """Return a sentence on the training images, `meshes` of pieces included, and so on what they lack."""
    objects = list(manifest.of("train"))
    kinds = ", ".join(sorted({entry.category for entry in objects}))
    varied = ", stretched, warped, seen from 5 degrees below to 55 degrees above" if config.variants else ""
    others = f"{meshes:,} other meshes and of " if meshes else ""
    pieces = f", and on renders of {others}procedural furniture and other things" if config.made else ""
    return (
        f"Trained on renders of {len(objects)} objects ({kinds}), mirrored{varied}{pieces}. It has seen no photograph "
        "of an object. Other things give rough shapes that resemble one of these."
    )


def _training_parts(manifest: Manifest, config: TrainConfig, meshes: int) -> str:
    """Return a sentence on the parts of surfaces that the model was trained on, `meshes` of pieces included."""
    objects = list(manifest.of("train"))
    kinds = ", ".join(sorted({entry.category for entry in objects}))
    front = f"turned by up to {config.turn:g} degrees about it" if config.turn else "the front at +Z"
    others = f" and of {meshes:,} other meshes" if meshes else ""
    varied = f", stretched by up to {config.stretch:g} along each axis" if config.stretch > 1 else ""
    return (
        f"Trained on points of parts of {len(objects)} objects ({kinds}){others}{varied}, cut off by a plane or seen "
        f"by a camera, 64 to 2,048 points with noise; +Y points up, {front}. It has seen no scan of an object."
    )


def figures(evaluations: list[Evaluation]) -> dict[str, dict[str, list[float]]]:
    """Return method -> metric -> [mean, low, high], the 95% bootstrap interval over objects."""
    return {
        each.method: {name: [round(value, 4) for value in interval(each.column(name))] for name in NAMES}
        for each in evaluations
    }


def _input(config: dict[str, Any]) -> tuple[str, str, str, str]:
    """Return the kind of an encoder, its input as people send it, as it sees it, and as it was tested."""
    if config["encoder"]["trunk"] in POINT_TRUNKS:
        box = "64 points or more, in the frame of their own box"
        test = "4 parts of each as in training, completed as the service does: side found, fitted to the points"
        return "Point", "points of a part of an object", box, test
    return (
        "Image",
        "one RGB image of an object",
        f"images of {config['framing']['size']} pixels a side",
        "4 of 24 views",
    )


def write_page(card: dict[str, Any], parameters: int, file: Path) -> None:
    """Write the card beside a model's file as a Markdown page, and print the file's size."""
    size = file.stat().st_size
    with whole_file(file.with_suffix(".md")) as target:
        target.write(page(card, parameters, size).encode())
    print(f"{file}: {size:,} bytes")


def page(card: dict[str, Any], parameters: int, bytes_: int) -> str:
    """Return the card as a Markdown page."""
    training, data, color, exported = card["training"], card["data"], card.get("color"), card["exported"]
    pieces = " Also procedural pieces, most of them furniture." if data.get("made") else ""
    views = "24 renders each" + (" and more under free cameras" if training["config"]["variants"] else "")
    color_head = (
        f"a head on the frozen encoder, {color['images']:,} images, {color['minutes']} minutes" if color else "none"
    )
    kind, source, inputs, test = _input(training["config"])
    means = [[method, *(f"{values[name][0]:.3f}" for name in NAMES)] for method, values in card["figures"].items()]
    return f"""# Model card: {card["name"]}

Written by `hof-model export` from the metadata of the file. `GET /model` serves the same data.

- **Function**: {source} -> theta, the {training["config"]["spec"]["name"]} mapping function of
  {parameters:,} numbers, applied k = {training["config"]["spec"]["k"]} times. {card["method"]}.
- **{kind} encoder**: {card["trunk"]}; {inputs}.
- **File**: `{card["name"]}.onnx`, {bytes_:,} bytes; matrices stored as float16, computed in float32.
- **License**: {card["license"]}.
- **Data**: {data["objects"]["train"]} training, {data["objects"]["val"]} validation and {data["objects"]["test"]} test
  objects, split by object after removing duplicates, {views}. Sources: {"; ".join(data["licences"])}.{pieces}
- **Training**: {training["minutes"]} minutes and {training["steps"]:,} steps, including the runs that it started
  from; seed {training["config"]["seed"]} in the last run. Exported {exported["date"]} on {exported["machine"]}, commit
  {exported["commit"]}.{_distilled(card.get("distilled"))}
- **Color**: {color_head}.{_estimates(card.get("estimates"))}

## Figures on the test split

Mean over objects; distances x100 of the longest side; 10,000 predicted against 10,000 true points, {test}.
Intervals and pictures: `{"PAPER.md" if kind == "Point" else "RESULTS.md"}` at the top of the project.

{table(["method", *NAMES], means)}

## Limits

{chr(10).join(f"- {limit}" for limit in card["limits"])}
"""
