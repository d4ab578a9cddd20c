"""The model card: what a weights file says of itself, and the page made from it."""

from typing import Any

from model.config import TrainConfig
from model.data.manifest import SPLITS, Manifest
from model.data.sources.sweethome3d import frozen_split
from model.evaluation.evaluate import Evaluation
from model.metrics import NAMES, interval
from model.provenance import provenance
from model.report.tables import table

TRUNKS = {
    "dense": "the paper's DenseNet, trained from scratch",
    "lite0": "EfficientNet-Lite0's convolutions (Apache-2.0), trained on ImageNet before",
}
LICENCE = "Apache-2.0; trained on CC-BY and CC0 meshes, attribution in NOTICE"  # of what is trained on Sweet Home 3D
LIMITS = (
    "The object frame has the front at +Z; from a view of the back the model must guess which way that is.",
    "Thin parts (chair legs, lamp stems) come out thicker or thinner than they are, and unseen sides are guesses.",
    "Scale is not known from a photo: the longest side is 1 unless you pass `scale`.",
)
COLOR_LIMIT = (
    "Colours are what the materials have without light, guessed from a photo with it: about right on large parts, "
    "and blurred over patterns and small ones."
)
NO_COLOR_LIMIT = "Geometry only: no colour."


def make_card(
    name: str, config: TrainConfig, run: dict[str, Any], manifest: Manifest, color: dict[str, Any] | None = None
) -> dict[str, Any]:
    """The card of a trained encoder, before its figures.

    Parameters
    ----------
    run : `step` and `elapsed_s` of the checkpoint.
    color : how the colour head was trained; None where there is none.
    """
    sizes = {split: sum(1 for _ in manifest.of(split)) for split in SPLITS}
    is_known = {entry.id for entry in manifest.entries} <= set(frozen_split())
    licences = sorted({f"{entry.source}: {entry.licence}" for entry in manifest.entries})
    return {
        "name": name,
        "version": "1",
        "license": LICENCE if is_known else f"not told; trained on meshes under: {'; '.join(licences)}",
        "trunk": TRUNKS[config.encoder.trunk],
        "method": "Higher-Order Function networks (Mitchell, Engin, Isler, Lee; ICLR 2020)",
        "data": {"objects": sizes, "seed": manifest.seed, "licences": licences, "made": config.made},
        "training": {
            "minutes": round(run["elapsed_s"] / 60, 1),
            "steps": run["step"],
            "config": config.to_dict(),
        },
        "exported": provenance(config.seed),
        **({"color": color} if color else {}),
        "limits": [_seen(manifest, config), *LIMITS, COLOR_LIMIT if color else NO_COLOR_LIMIT],
    }


def _seen(manifest: Manifest, config: TrainConfig) -> str:
    """What training showed, and so what it did not."""
    shown = list(manifest.of("train"))
    kinds = ", ".join(sorted({entry.category for entry in shown}))
    varied = ", stretched, warped, seen from 5 degrees below to 55 degrees above" if config.variants else ""
    made = ", and as often of furniture and other things made by rule" if config.made else ""
    return (
        f"Trained on renders of {len(shown)} objects ({kinds}), mirrored{varied}{made}, and on no photograph of an "
        "object: other things give rough shapes that look like one of them."
    )


def figures(evaluations: list[Evaluation]) -> dict[str, dict[str, list[float]]]:
    """method -> metric -> [mean, low, high], the 95% bootstrap interval over objects."""
    return {
        found.method: {name: [round(value, 4) for value in interval(found.column(name))] for name in NAMES}
        for found in evaluations
    }


def page(card: dict[str, Any], parameters: int, bytes_: int) -> str:
    """The card as a Markdown page."""
    training, data, color, exported = card["training"], card["data"], card.get("color"), card["exported"]
    made = " Beside them pieces made by rule, most of them furniture." if data.get("made") else ""
    views = "24 renders each" + (" and more under free cameras" if training["config"]["variants"] else "")
    coloured = (
        f"a head on the frozen encoder, {color['images']:,} images, {color['minutes']} minutes" if color else "none"
    )
    means = [[method, *(f"{values[name][0]:.3f}" for name in NAMES)] for method, values in card["figures"].items()]
    return f"""# Model card: {card["name"]}

Written by `hof-model export` from the file's own metadata. `GET /model` serves the same.

- **What**: one RGB image of an object -> theta, the {training["config"]["spec"]["name"]} mapping function of
  {parameters:,} numbers, to be applied k = {training["config"]["spec"]["k"]} times. {card["method"]}.
- **Image encoder**: {card["trunk"]}; images of {training["config"]["framing"]["size"]} pixels a side.
- **File**: `{card["name"]}.onnx`, {bytes_:,} bytes; matrices stored as float16, computed in float32.
- **Licence**: {card["license"]}.
- **Data**: {data["objects"]["train"]} training, {data["objects"]["val"]} validation and {data["objects"]["test"]} test
  objects, split by object after removing duplicates, {views}. Sources: {"; ".join(data["licences"])}.{made}
- **Training**: {training["minutes"]} minutes, {training["steps"]:,} steps, those of the runs that it started from
  included; seed {training["config"]["seed"]} in the last. Exported {exported["date"]} on {exported["machine"]}, commit
  {exported["commit"]}.
- **Colour**: {coloured}.

## Figures on the test split

Mean over objects; distances x100 of the longest side; 10,000 predicted against 10,000 true points, 4 of 24 views.
Intervals and pictures: `RESULTS.md` at the top of the project.

{table(["method", *NAMES], means)}

## Limits

{chr(10).join(f"- {limit}" for limit in card["limits"])}
"""
