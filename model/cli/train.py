"""`hof-model train`, `blend`, `color`: encoders and their color heads."""

import argparse
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Final, get_args

from model.cli.common import add_data, add_run
from model.cli.flags import add_flags, number, values
from model.config import (
    DENSE,
    GRID,
    LITE0,
    LITE0_SIZE,
    METHOD_DOMAINS,
    PAPER_EPOCHS,
    PAPER_SCHEDULE,
    POINTNET,
    ColorConfig,
    DeviceOptions,
    EncoderConfig,
    TrainConfig,
)
from service.encoding.framing import Framing
from service.mapping.spec import DOMAIN_DIMS, HOF_1, HOF_3, MAX_K, MAX_WIDTH, Activation, Domain, MappingSpec

BUDGETS: Final = {"steps", "images", "minutes"}
PLACE_FLAGS: Final = ("device", "packed", "workers")
MAPPINGS: Final = {"HOF-1": HOF_1, "HOF-3": HOF_3}
SIZE_STEP: Final = 32  # pixels: the stride of Lite0; that of the DenseNet divides it


def add_stages(stages: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the stages: each sets `run`, a function of the parsed arguments."""
    _add_train(stages.add_parser("train", help="train an image encoder; an existing run is resumed"))
    stage = stages.add_parser("blend", help="average the weights of a run and a later one")
    stage.set_defaults(run=_blend)
    stage.add_argument("first", type=Path, metavar="RUN", help="folder of a run, or an exported model")
    stage.add_argument("later", type=Path, metavar="LATER", help="a run that started from it, or its exported model")
    stage.add_argument(
        "--share", type=float, default=0.5, help="weight of LATER in the mean, from 0 to 1; default: 0.5"
    )
    stage.add_argument("-o", "--out", type=Path, required=True, help="folder of the run to write")
    stage = stages.add_parser("color", help="train the color head of a trained run; its encoder stays unchanged")
    stage.set_defaults(run=_color)
    add_data(stage)
    add_run(stage, "run whose chosen checkpoint gets the head")
    add_flags(stage, ColorConfig())
    add_flags(stage.add_argument_group("device"), DeviceOptions(), only=PLACE_FLAGS)


def _add_train(stage: argparse.ArgumentParser) -> None:
    stage.set_defaults(run=_train)
    add_data(stage)
    add_run(stage, "folder of checkpoints, log and plot")
    add_flags(stage, TrainConfig())
    add_schedule(stage)
    add_flags(stage.add_argument_group("device"), DeviceOptions())
    _add_mapping(stage.add_argument_group("mapping function"))
    add_network(stage)


def add_network(stage: argparse.ArgumentParser) -> None:
    """Add the flags of the image encoder and of the framing of images."""
    widths = " ".join(map(str, LITE0.fully_connected))
    add_flags(
        stage.add_argument_group(
            "image encoder",
            f"lite0 has other defaults: --fully-connected {widths} --fine-maps {LITE0.fine_maps} --size {LITE0_SIZE}; "
            f"pointnet and grid: --fully-connected {' '.join(map(str, POINTNET.fully_connected))}; "
            f"grid: --feature-maps {' '.join(map(str, GRID.feature_maps))}.",
        ),
        DENSE,
    )
    framing, default = stage.add_argument_group("framing of images"), Framing()
    framing.add_argument(
        "--size",
        type=number(int, least=SIZE_STEP),
        help=f"pixels of an image's side, a multiple of {SIZE_STEP}; default: {default.size}",
    )
    framing.add_argument(
        "--foreground-ratio",
        type=number(float, above=0, most=1),
        default=default.foreground_ratio,
        metavar="RATIO",
        help=f"share of the side that the object's longest side takes; default: {default.foreground_ratio}",
    )


def add_schedule(stage: argparse.ArgumentParser) -> None:
    """Add `--schedule`, other defaults for the whole run."""
    stage.add_argument(
        "--schedule",
        choices=("project", "paper"),
        default="project",
        help="paper: Adam at 1e-5, batches of one image, 4 epochs, DenseNet of full rank, no augmentation; other flags "
        "change parts of it",
    )


def paper_images(data: Path, packed: str | None) -> int:
    """Return the images of PAPER_EPOCHS epochs, in each of which every training image is used once.

    Raises
    ------
    FileNotFoundError : no such data set.
    """
    from model.data.packed.views import count_views

    return PAPER_EPOCHS * count_views(data, "train", packed)


def _add_mapping(group: argparse._ArgumentGroup) -> None:
    """Add the flags of the MappingSpec."""
    default = TrainConfig().spec
    group.add_argument("--mapping", choices=MAPPINGS, default=default.name, help=f"default: {default.name}")
    group.add_argument(
        "--hidden",
        type=number(int, least=1, most=MAX_WIDTH),
        nargs="+",
        metavar="WIDTH",
        help="widths of the hidden layers; default: those of --mapping",
    )
    group.add_argument(
        "--activation",
        choices=get_args(Activation),
        default=default.activation,
        help=f"activation after each hidden layer; default: {default.activation}",
    )
    group.add_argument(
        "--k",
        type=number(int, least=1, most=MAX_K),
        default=default.k,
        metavar="K",
        help=f"times that the function is applied; default: {default.k}",
    )
    group.add_argument(
        "--domain",
        choices=DOMAIN_DIMS,
        help=f"canonical domain; default: {default.domain}, for foldingnet and atlasnet_25 cube, for atlasnet_sphere "
        "sphere",
    )


def _config(arguments: argparse.Namespace) -> TrainConfig:
    """Return the config that the flags of `train` describe. Raises as `config_from`, and InvalidSpec."""
    return replace(config_from(arguments, TrainConfig()), spec=_spec(arguments))


def config_from(arguments: argparse.Namespace, base: TrainConfig) -> TrainConfig:
    """Return `base`, or the paper's schedule, with what the flags change; the spec stays.

    Raises
    ------
    FileNotFoundError : the paper's schedule needs to know the data set, and there is none.
    ValueError : `--size` is no multiple of SIZE_STEP.
    """
    encoder, options = values(arguments, EncoderConfig), values(arguments, TrainConfig)
    base = PAPER_SCHEDULE if arguments.schedule == "paper" else base
    presets = {"lite0": (LITE0, LITE0_SIZE), "pointnet": (POINTNET, Framing().size), "grid": (GRID, Framing().size)}
    trunk, size = presets.get(encoder.get("trunk", ""), (base.encoder, Framing().size))
    size = arguments.size or size
    if size % SIZE_STEP:
        raise ValueError(f"--size is {size}, it must be a multiple of {SIZE_STEP} pixels")
    if options.keys() & BUDGETS:  # a budget replaces that of the base
        options = dict.fromkeys(("steps", "images")) | options
    elif arguments.schedule == "paper":
        options["images"] = paper_images(arguments.data, values(arguments, DeviceOptions).get("packed"))
    framing = Framing(size, arguments.foreground_ratio)
    return replace(base, encoder=replace(trunk, **encoder), framing=framing, **options)


def _spec(arguments: argparse.Namespace) -> MappingSpec:
    """Return the mapping function that the flags of `train` describe."""
    shape = MAPPINGS[arguments.mapping]
    domain: Domain = arguments.domain or METHOD_DOMAINS.get(getattr(arguments, "method", "hof"), shape.domain)
    return replace(
        shape,
        name="-".join(["MLP", *map(str, arguments.hidden)]) if arguments.hidden else shape.name,
        hidden=tuple(arguments.hidden or shape.hidden),
        activation=arguments.activation,
        input_dim=DOMAIN_DIMS[domain],
        domain=domain,
        k=arguments.k,
    )


def _train(arguments: argparse.Namespace) -> None:
    from model.training.device.placement import uses_device_loop

    options, config = DeviceOptions(**values(arguments, DeviceOptions)), _config(arguments)
    if uses_device_loop(options):
        from model.training.device.loop import train_on_device

        checkpoint = train_on_device(arguments.data, arguments.folder, config, options)
    else:
        from model.training.train import train

        checkpoint = train(arguments.data, arguments.folder, config)
    if find_spec("matplotlib"):  # a machine that only trains lacks it
        from model.training.log import plot_losses

        plot_losses(arguments.folder, arguments.folder / "loss.png")
    print(checkpoint)


def _blend(arguments: argparse.Namespace) -> None:
    from model.training.average import blend

    print(blend(arguments.first, arguments.later, arguments.share, arguments.out))


def _color(arguments: argparse.Namespace) -> None:
    from model.training.train_color import train_color

    options = DeviceOptions(**values(arguments, DeviceOptions))
    print(train_color(arguments.data, arguments.folder, ColorConfig(**values(arguments, ColorConfig)), options))
