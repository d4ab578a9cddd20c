"""The model card of a matte network: metadata of its file, and its Markdown page."""

from pathlib import Path
from typing import Any

from model.config import MatteConfig
from model.data.manifest import Manifest, piece_entries
from model.provenance import provenance
from model.report.card import license_of


def matte_card(data: Path, name: str, config: MatteConfig, trained: dict[str, Any]) -> dict[str, Any]:
    """Return the card of a network that was trained on a data set.

    Parameters
    ----------
    trained : `steps` and `minutes`.
    """
    manifest, pieces = Manifest.read(data), piece_entries(data)
    return {
        "name": name,
        "version": "1",
        "license": license_of(manifest, pieces),
        "data": {"objects": sum(1 for _ in manifest.of("train")), "meshes": len(pieces)},
        "training": {**trained, "batch": config.batch, "size": config.size, "seed": config.seed},
        "exported": provenance(config.seed),
    }


def matte_page(card: dict[str, Any], bytes_: int) -> str:
    """Return the card as a Markdown page."""
    training, data, exported = card["training"], card["data"], card["exported"]
    images = training["steps"] * training["batch"]
    return f"""# Model card: {card["name"]}

Written by `hof-model matte` from the metadata of the file.

- **Function**: one RGB image of {training["size"]} pixels a side -> its matte, the share of each pixel that is object.
  The service shows it the whole photo, then a square around what it found.
- **Network**: EfficientNet-Lite0's convolutions (Apache-2.0), pretrained on ImageNet, and a decoder as of U-Net.
- **File**: `{card["name"]}.onnx`, {bytes_:,} bytes; matrices stored as float16, computed in float32.
- **License**: {card["license"]}.
- **Data**: renders of {data["objects"]:,} training objects and {data["meshes"]:,} other meshes in front of photographs,
  floors and walls, flat colors and noise.
- **Training**: {images:,} images in {training["minutes"]} minutes, seed {training["seed"]}. Exported {exported["date"]}
  on {exported["machine"]}, commit {exported["commit"]}.

`RESULTS.md` at the top of the project has its figures.

## Limits

- It has seen no photo of a real object, only renders pasted into photographs.
- It finds what stands out as one thing. Of several objects it may take one, all or parts.
- Edges are as sharp as {training["size"]} pixels across the object are. Hair, smoke and glass are not solved.
"""
