"""The device loop, on the CPU: it learns, resumes, trains every method, and needs little to be installed."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from model import cli
from model.config import METHOD_DOMAINS, DeviceOptions, Method, TrainConfig
from model.data.manifest import Manifest
from model.data.packed.options import PackOptions
from model.data.packed.pack import pack
from model.training.checkpoints import load_network
from model.training.device.data import load_data, load_validation
from model.training.device.draws import Draws, uniform_points
from model.training.device.loop import train_on_device
from model.training.device.steps import Steps
from model.training.state import RunState
from service.mapping.spec import DOMAIN_DIMS, Domain
from tests.support.small import data as boxes
from tests.support.small.network import CONFIG as SMALL

pytestmark = pytest.mark.slow

CONFIG = replace(SMALL, points=128, target_points=200, learning_rate=3e-3, steps=60)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Seven boxes to train on, one to validate."""
    folder = boxes.write(tmp_path_factory.mktemp("device") / "boxes", train=8, test=0)
    first, *others = Manifest.read(folder).entries
    Manifest(0, (replace(first, split="val"), *others), {}, {}).write(folder / "manifest.json")
    return folder


@pytest.fixture(scope="module")
def options(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> DeviceOptions:
    packed = tmp_path_factory.mktemp("packed")
    pack([folder], packed, PackOptions(CONFIG.framing, variants=False, made=False), processes=1)
    return DeviceOptions(device="cpu", packed=str(packed), workers=1)


def steps(options: DeviceOptions, state: RunState) -> Steps:
    loaded = load_data(Path("none"), state.config, options)
    return Steps(state, Draws(loaded.train, loaded.grounds, state.config))


def records(run: Path) -> list[dict[str, float]]:
    return [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]


def test_steps_lower_the_loss(options: DeviceOptions) -> None:
    taker, losses = steps(options, RunState(CONFIG)), []
    for _ in range(6):
        for _ in range(25):
            taker.take()
        losses.append(taker.mean_loss()[0])
    assert losses[-1] < 0.5 * losses[0]


def test_steps_refuse_a_loss_that_is_not_finite(options: DeviceOptions) -> None:
    taker = steps(options, RunState(CONFIG))
    with torch.no_grad():
        next(taker.state.network.parameters()).fill_(float("nan"))
    taker.take()
    with pytest.raises(FloatingPointError, match="the loss is nan at step 1"):
        taker.mean_loss()


def test_resumed_run_makes_the_same_steps(options: DeviceOptions, tmp_path: Path) -> None:
    whole, first = (steps(options, RunState(CONFIG)) for _ in range(2))
    for _ in range(6):
        whole.take()
    for _ in range(3):
        first.take()
    first.state.save(tmp_path, 0.5, in_parts=True)
    resumed = steps(options, RunState.resume(tmp_path, CONFIG))
    for _ in range(3):
        resumed.take()
    assert resumed.state.step == 6
    for ours, theirs in (
        (whole.state.network, resumed.state.network),
        (whole.state.average, resumed.state.average),
    ):
        for name, value in ours.state_dict().items():
            assert torch.equal(value, theirs.state_dict()[name]), name


def test_run_from_shards_equals_one_from_the_folder(folder: Path, options: DeviceOptions) -> None:
    packed, unpacked = (load_data(folder, CONFIG, each) for each in (options, DeviceOptions(device="cpu")))
    validation = [load_validation(folder, CONFIG, each) for each in (options, DeviceOptions(device="cpu"))]
    for ours, theirs in ((packed.train, unpacked.train), validation):
        assert torch.equal(ours.units, theirs.units)
        assert torch.equal(ours.shape_of, theirs.shape_of)
        assert torch.equal(ours.images[..., 3], theirs.images[..., 3])
        opaque = ours.images[..., 3] == 255
        difference = (ours.images.float() - theirs.images.float()).abs()[opaque]
        assert float(difference.mean()) < 8  # WebP at quality 90, on drawings of single points
        assert float((ours.points.float().mean(0) - theirs.points.float().mean(0)).abs().max()) < 1


def test_run_that_is_interrupted_goes_on_and_ends_after_its_images(options: DeviceOptions, tmp_path: Path) -> None:
    config = replace(CONFIG, steps=None, images=30 * CONFIG.batch, late_from=0.5, late_points=64, late_target_points=90)
    short = replace(options, stop_after=1e-4, checkpoint_parts=True)
    train_on_device(Path("none"), tmp_path, config, short)
    assert 0 < records(tmp_path)[-1]["step"] < 30
    chosen = train_on_device(Path("none"), tmp_path, config, replace(options, checkpoint_parts=True))
    _, stored, run = load_network(chosen)
    assert stored == config
    assert run["step"] <= 30
    assert records(tmp_path)[-1]["step"] == 30
    assert set(records(tmp_path)[-1]) == {"step", "elapsed_s", "val", "f@1%", "f@2%"}
    assert not (tmp_path / "last.pt").exists()


@pytest.mark.parametrize("method", ["deepsdf", "foldingnet", "direct", "atlasnet_sphere"])
def test_compared_methods_train_on_the_device(method: Method, options: DeviceOptions, tmp_path: Path) -> None:
    domain = METHOD_DOMAINS.get(method, "ball")
    config = replace(CONFIG, method=method, spec=replace(CONFIG.spec, domain=domain), steps=2)
    network, _, run = load_network(train_on_device(Path("none"), tmp_path, config, options))
    assert run["step"] == 2
    assert all(torch.isfinite(weight).all() for weight in network.parameters())


def test_draws_of_an_epoch_have_every_object_once_and_own_shapes_as_set(options: DeviceOptions) -> None:
    loaded = load_data(Path("none"), CONFIG, options)
    draws = Draws(loaded.train, loaded.grounds, CONFIG)
    count = len(loaded.train.units)
    order = torch.cat([draws.units(step) for step in range(count)])  # `batch` epochs
    assert order.bincount().tolist() == [CONFIG.batch] * count
    units = loaded.train.units.clone()
    units[:, 1] = units[:, 0] + 6  # of 24 views
    draws = Draws(replace(loaded.train, units=units), loaded.grounds, replace(CONFIG, own_share=0.6))
    torch.manual_seed(0)
    own = draws._views(torch.zeros(4_000, dtype=torch.int64)) < units[0, 1]
    assert float(own.float().mean()) == pytest.approx(0.6 + 0.4 * 6 / 24, abs=0.03)


def test_points_of_a_batch_lie_on_its_shapes_mirrored_with_their_images(options: DeviceOptions) -> None:
    loaded = load_data(Path("none"), CONFIG, options)
    torch.manual_seed(0)
    batch = Draws(loaded.train, loaded.grounds, CONFIG).batch(torch.arange(7), 50, 300)
    assert batch.images.shape == (7, 3, 32, 32)
    assert batch.canonical.shape == (7, 50, 3)
    assert batch.points.shape == (7, 300, 3)
    on_surface = (batch.points.abs() - batch.points.abs().amax(1, keepdim=True)).abs().amin(2)
    assert float(on_surface.max()) < 0.02  # each point lies on a face of its box
    assert batch.colors is not None


@pytest.mark.parametrize("domain", list(DOMAIN_DIMS))
def test_canonical_points_on_the_device_fill_the_domain(domain: Domain) -> None:
    torch.manual_seed(0)
    points = uniform_points(domain, 2, 20_000, torch.device("cpu"))
    assert points.shape == (2, 20_000, DOMAIN_DIMS[domain])
    assert float(points.mean().abs()) < 0.01
    radius = points.abs().amax(2) if domain == "cube" else points.norm(dim=2)
    expected = 1.0 if domain == "sphere" else DOMAIN_DIMS[domain] / (DOMAIN_DIMS[domain] + 1)
    assert float(radius.mean()) == pytest.approx(expected, abs=0.01)
    assert float(radius.max()) <= 1 + 1e-6


NEEDED = (  # torch, NumPy and Pillow, and what these need themselves
    *("torch", "torchgen", "functorch", "numpy", "numpy.libs", "PIL", "pillow.libs"),
    *("typing_extensions.py", "filelock", "fsspec", "jinja2", "markupsafe", "networkx", "sympy", "mpmath"),
)


def test_train_packed_needs_torch_numpy_and_pillow_alone(options: DeviceOptions, tmp_path: Path) -> None:
    installed = Path(torch.__file__).parents[1]
    bare = tmp_path / "site"
    bare.mkdir()
    for name in NEEDED:
        if (installed / name).exists():
            (bare / name).symlink_to(installed / name)
    paths = f"{bare}:{Path(cli.__file__).parents[2]}"
    sizes = ["--steps", "2", "--batch", "4", "--points", "16", "--size", "32", "--feature-maps", "4", "4", "4"]
    flags = ["--device", "cpu", "--packed", str(options.packed), "--run", str(tmp_path), "--workers", "1", *sizes]
    code = "import sys; from model.cli import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-S", "-c", code, "train", *flags]
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": paths})
    assert done.returncode == 0, done.stderr
    assert records(tmp_path)[-1]["step"] == 2


def test_train_refuses_a_device_that_is_not_there(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    if not torch.cuda.is_available():
        assert cli.main(["train", "--device", "cuda", "--run", str(tmp_path)]) == 2
        assert "sees no CUDA device" in capsys.readouterr().err
    assert cli.main(["train", "--device", "cpu", "--stop-after", "3", "--run", str(tmp_path)]) == 2
    assert "--stop-after goes with" in capsys.readouterr().err


def test_config_budget_in_images_survives_a_checkpoint() -> None:
    config = TrainConfig(images=1_000)
    assert TrainConfig.from_dict(config.to_dict()) == config
    assert np.isclose(RunState(replace(CONFIG, steps=None, images=80)).progress, 0)
