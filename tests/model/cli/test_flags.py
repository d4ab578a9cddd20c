"""Flags of training: one for each field of its configs."""

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pytest

from model.cli.flags import values
from model.cli.main import _parser
from model.cli.train import _config
from model.config import LITE0, PAPER_SCHEDULE, POINTNET, ColorConfig, EncoderConfig, TrainConfig
from service.encoding.framing import Framing
from service.errors import InvalidSpec
from service.mapping.spec import HOF_1, HOF_3, MappingSpec

PARTS = {"spec", "encoder", "framing"}
ALL_FLAGS: dict[str, Any] = {
    "seed": 1,
    "batch": 2,
    "points": 3,
    "target_points": 4,
    "learning_rate": 0.5,
    "pretrained_rate": 0.25,
    "weight_decay": 0.125,
    "gradient_clip": 2.0,
    "projection": 0.75,
    "minutes": 1.5,
    "steps": 5,
    "images": 8,
    "late_from": 0.4,
    "late_points": 6,
    "late_target_points": 7,
    "own_share": 0.3,
    "turn": 90.0,
    "stretch": 1.3,
    "start": "old/best.pt",
}


def config_of(*flags: object) -> TrainConfig:
    return _config(_parser().parse_args(["train", *map(str, flags)]))


def as_flags(options: dict[str, Any]) -> list[object]:
    return [part for name, value in options.items() for part in (f"--{name.replace('_', '-')}", value)]


def test_train_without_flags_has_the_defaults_of_its_config() -> None:
    assert config_of() == TrainConfig()


def test_train_with_every_flag_sets_every_field() -> None:
    switches = ["--variants", "--made", "--no-augmented", "--constant-rate"]
    flags = [*as_flags(ALL_FLAGS), *switches, "--method", "direct", "--projection-form", "nearest", "--frame", "camera"]
    config = config_of(*flags)
    switched: dict[str, Any] = {"variants": True, "made": True, "augmented": False, "constant_rate": True}
    switched |= {"method": "direct", "projection_form": "nearest", "frame": "camera"}
    assert config == replace(TrainConfig(), **ALL_FLAGS, **switched)
    same = {
        each.name for each in fields(TrainConfig) if getattr(config, each.name) == getattr(TrainConfig(), each.name)
    }
    assert same == PARTS
    assert config_of(*flags, "--no-variants", "--no-made").variants is False


def test_train_with_flags_of_the_encoder_and_framing_sets_them() -> None:
    flags = "--feature-maps 4 5 --convolutions 2 --fully-connected 8 --rank 0 --frozen 1 --joined-maps 6 --fine-maps 7"
    flags += " --point-maps 1 2 3 4"
    config = config_of(*flags.split(), "--size", 96, "--foreground-ratio", 0.5)
    assert config.encoder == EncoderConfig((4, 5), 2, (8,), 0, "dense", 1, 6, 7, "all", (1, 2, 3, 4))
    assert config.framing == Framing(96, 0.5)


def test_train_with_the_papers_schedule_has_its_settings_unless_set() -> None:
    config = config_of("--schedule", "paper", "--steps", 7, "--batch", 2, "--rank", 3)
    assert config == replace(PAPER_SCHEDULE, steps=7, batch=2, encoder=EncoderConfig(rank=3))
    assert (PAPER_SCHEDULE.learning_rate, PAPER_SCHEDULE.encoder.rank, PAPER_SCHEDULE.augmented) == (1e-5, 0, False)


def test_train_with_lite0_has_its_presets_unless_set() -> None:
    assert (config_of("--trunk", "lite0").encoder, config_of("--trunk", "lite0").framing) == (LITE0, Framing(128))
    config = config_of("--trunk", "lite0", "--fine-maps", 3, "--size", 160)
    assert (config.encoder, config.framing) == (replace(LITE0, fine_maps=3), Framing(160))


def test_train_with_pointnet_has_its_presets_unless_set() -> None:
    assert config_of("--trunk", "pointnet").encoder == POINTNET
    assert config_of("--trunk", "pointnet", "--rank", 16).encoder == replace(POINTNET, rank=16)


def test_train_with_flags_of_the_mapping_function_sets_the_spec() -> None:
    assert config_of("--mapping", "HOF-3", "--k", 1).spec == HOF_3
    assert config_of("--method", "foldingnet").spec == replace(HOF_1, domain="cube", k=2)
    small = config_of("--hidden", 8, 9, "--activation", "tanh", "--domain", "ball4", "--k", 1).spec
    assert small == MappingSpec("MLP-8-9", 4, (8, 9), 3, "tanh", 1, "ball4")
    with pytest.raises(InvalidSpec, match="needs input_dim"):
        config_of("--domain", "ball4")


@pytest.mark.parametrize(
    ("flag", "value", "allowed"),
    [
        ("--batch", "0", "a whole number of at least 1"),
        ("--batch", "1.5", "a whole number of at least 1"),
        ("--minutes", "0", "a number above 0"),
        ("--minutes", "nan", "a number above 0"),
        ("--own-share", "1.1", "a number of at least 0 and at most 1"),
        ("--k", "17", "a whole number of at least 1 and at most 16"),
        ("--hidden", "many", "a whole number of at least 1 and at most 65536"),
    ],
)
def test_train_with_a_bad_number_names_flag_value_and_limit(
    flag: str, value: str, allowed: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        config_of(flag, value)
    assert f"argument {flag}: {value!r} is not {allowed}" in capsys.readouterr().err


def test_train_with_an_abbreviated_flag_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        config_of("--minute", 5)
    assert "unrecognized arguments: --minute 5" in capsys.readouterr().err


def test_train_with_a_bad_size_or_choice_names_what_is_allowed(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ValueError, match="--size is 100, it must be a multiple of 32 pixels"):
        config_of("--size", 100)
    with pytest.raises(SystemExit, match="2"):
        config_of("--trunk", "wide")
    assert "argument --trunk: invalid choice: 'wide' (choose from" in capsys.readouterr().err


def test_color_flags_are_the_fields_of_its_config() -> None:
    assert ColorConfig(**values(_parser().parse_args(["color"]), ColorConfig)) == ColorConfig()
    options = {each.name: getattr(ColorConfig(), each.name) + 1 for each in fields(ColorConfig)}
    arguments = _parser().parse_args(["color", *map(str, as_flags(options))])
    assert ColorConfig(**values(arguments, ColorConfig)) == ColorConfig(**options)
    assert arguments.folder == Path("runs/hof1-k2")
