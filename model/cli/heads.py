"""`hof-model heads` and `hof-model estimates`: train the heads of an exported model, and measure them."""

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from model.cli.common import ROOT, SHIPPED, add_data, add_seed
from model.cli.flags import add_flags, values
from model.config import HeadsConfig
from model.data.manifest import SPLITS

if TYPE_CHECKING:
    from model.evaluation.estimates.observe import KnownObject
    from model.networks.observations import Observations


def add_stages(stages: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare both stages: each sets `run`, a function of the parsed arguments."""
    stage = stages.add_parser(
        "heads", help="train heads for the fit of the shape and the camera, behind a finished model"
    )
    stage.set_defaults(run=_heads)
    stage.add_argument("--model", type=Path, default=SHIPPED, help="exported encoder; default: the shipped one")
    add_data(stage)
    stage.add_argument("--others", type=Path, help="data set of objects that the encoder was not trained on")
    stage.add_argument("--kept-out", nargs="*", default=[], metavar="SOURCE", help="sources of --others to measure on")
    stage.add_argument(
        "--frontless", nargs="*", default=[], metavar="SOURCE", help="sources whose objects have no front at +Z"
    )
    stage.add_argument(
        "--observations", type=Path, metavar="FILE", help="file of observations (.npz): used if there, else written"
    )
    add_flags(stage, HeadsConfig())
    stage.add_argument("-o", "--output", type=Path, required=True, help="ONNX file to write; may be that of --model")
    stage = stages.add_parser("estimates", help="measure the confidence and the camera of a model, for RESULTS.md")
    stage.set_defaults(run=_estimates)
    stage.add_argument("--model", type=Path, default=SHIPPED, help="exported encoder; default: the shipped one")
    add_data(stage)
    add_seed(stage)
    stage.add_argument("--others", type=Path, help="data set with the sources that the heads never saw")
    stage.add_argument("--split", choices=SPLITS, default="test", help="split to measure on; default: test")
    stage.add_argument("-o", "--out", type=Path, default=ROOT, help="folder that receives model/results/estimates")


def _heads(arguments: argparse.Namespace) -> None:
    from model.export import attach
    from model.report.card import write_page
    from model.training.train_heads import train_heads
    from service.encoding.encoder import Encoder

    config = HeadsConfig(**values(arguments, HeadsConfig))
    observations = _observations(arguments, config)
    heads = train_heads(observations, config)
    encoder = Encoder.open(arguments.model, threads=1)
    card = {**encoder.card, "estimates": _training(arguments, observations, config)}
    output: Path = arguments.output
    for quantity, difference in attach(arguments.model, heads, card, output).items():
        print(f"{quantity}: {difference:.1e}")
    write_page(card, encoder.spec.size, output)


def _observations(arguments: argparse.Namespace, config: HeadsConfig) -> "Observations":
    """Return the observations in the file that `--observations` names, or else observe the model."""
    from model.evaluation.estimates.observe import observe
    from model.networks.observations import Observations

    file: Path | None = arguments.observations
    if file and file.exists():
        return Observations.read(file)
    observations = observe(arguments.model, _known_objects(arguments), config.views, config.seed)
    if file:
        observations.write(file)
    return observations


def _known_objects(arguments: argparse.Namespace) -> "list[KnownObject]":
    """Return the objects to learn from: the data set's without its test split, others without the kept-out sources."""
    from model.data.manifest import Manifest
    from model.evaluation.estimates.observe import KnownObject

    entries = [(arguments.data, entry) for entry in Manifest.read(arguments.data).entries if entry.split != "test"]
    if arguments.others:
        entries += [(arguments.others, entry) for entry in Manifest.read(arguments.others).entries]
    return [
        KnownObject(folder, entry, entry.source not in arguments.frontless)
        for folder, entry in entries
        if entry.source not in arguments.kept_out
    ]


def _training(arguments: argparse.Namespace, observations: "Observations", config: HeadsConfig) -> dict[str, Any]:
    """Return the heads' training for the card."""
    from model.provenance import provenance

    return {
        "images": len(observations),
        "objects": len(observations.ids),
        "kept_out": arguments.kept_out,
        "frontless": arguments.frontless,
        "config": asdict(config),
        **provenance(config.seed),
    }


def _estimates(arguments: argparse.Namespace) -> None:
    from model.evaluation.estimates.trials import measure_estimates
    from model.evaluation.locations import ESTIMATES
    from model.report.estimates import draw_reliability, section

    trials = measure_estimates(arguments.model, arguments.data, arguments.others, arguments.split, arguments.seed)
    path = arguments.out / ESTIMATES / f"{trials.origin['model']}.json"
    trials.write(path)
    draw_reliability(trials, path.with_suffix(".png"))
    print(section(trials))
