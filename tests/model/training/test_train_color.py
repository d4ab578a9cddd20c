"""The color head: its training targets, the encoder that stays unchanged, and the exported file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from model import cli
from model.config import ColorConfig, TrainConfig
from model.data.dataset import draw_batch, load_examples
from model.data.packed.options import PackOptions
from model.data.packed.pack import pack
from model.evaluation.color import object_mean
from model.export import TOLERANCE, color_parity, export
from model.networks.color_head import ColoredEncoder, ColorHead, color_spec, digest, load, look, save
from model.networks.encoder import ImageEncoder
from model.networks.mapping import power
from model.report.card import COLOR_LIMIT, NO_COLOR_LIMIT
from model.training.checkpoints import load_encoder
from model.training.state import RunState
from model.training.train_color import HeadBatch, _Learner, observe
from service.encoding.encoder import Encoder
from service.mapping.color import ColorSampler
from service.mapping.spec import HOF_1, MappingSpec
from tests.support.small import data as small_data
from tests.support.small import network as small_network
from tests.support.small.runs import export_run

pytestmark = pytest.mark.slow

CONFIG = replace(small_network.CONFIG, points=64, target_points=500)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_data.write(tmp_path_factory.mktemp("color") / "data")


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Make a run's folder with the checkpoint of a network that has learned nothing."""
    RunState(CONFIG).save(tmp_path, score=0.0)
    return tmp_path


def head_of(encoder: ImageEncoder, config: TrainConfig = CONFIG) -> ColorHead:
    side = config.framing.size
    return ColorHead(color_spec(config.spec), look(encoder, torch.zeros(1, 3, side, side))[1].shape[1]).eval()


def test_color_spec_has_1795_numbers_on_the_domain_of_the_geometry() -> None:
    for spec in (HOF_1.with_k(4), replace(HOF_1, domain="sphere")):
        colors = color_spec(spec)
        assert (colors.size, colors.k, colors.domain) == (1_795, 1, spec.domain)
    assert color_spec(MappingSpec("four", 4, (9, 9), 3, "tanh", domain="ball4")).shapes == [(256, 4), (3, 256)]


def test_observe_gives_points_the_color_of_the_nearest_true_point(run: Path, data: Path) -> None:
    encoder = load_encoder(run / "last.pt")[0]
    batch = draw_batch(load_examples(data, "train", CONFIG.framing), CONFIG, 0)
    with torch.no_grad():
        head_batch = observe(encoder, CONFIG.spec, batch)
        points = power(CONFIG.spec, encoder(batch.images), batch.canonical)
        with pytest.raises(ValueError, match="hof-model data build"):
            observe(encoder, CONFIG.spec, replace(batch, colors=None))
    nearest = torch.cdist(points, batch.points).argmin(dim=2)
    assert batch.colors is not None
    expected = torch.stack([colors[index] for colors, index in zip(batch.colors, nearest, strict=True)])
    assert (head_batch.colors == expected).float().mean() > 0.99
    assert (head_batch.canonical == batch.canonical).all()


def test_learner_lowers_the_loss_and_keeps_the_encoder(run: Path, data: Path) -> None:
    encoder = load_encoder(run / "last.pt")[0]
    before, examples = digest(encoder), load_examples(data, "train", CONFIG.framing)
    learner = _Learner(head_of(encoder), ColorConfig())
    batches = [observe(encoder, CONFIG.spec, draw_batch(examples, CONFIG, step)) for step in range(4)]
    learner.step(batches[0], 0.3)
    first = learner.loss
    for step in range(200):
        learner.step(batches[step % 4], 0.3)
    assert learner.loss < 0.75 * first
    assert digest(encoder) == before


def test_train_color_on_the_device_from_shards_writes_the_head(run: Path, data: Path, tmp_path: Path) -> None:
    packed = tmp_path / "packed"
    pack([data], packed, PackOptions(CONFIG.framing, variants=False, made=False), processes=1)
    command = ["color", "--run", str(run), "--packed", str(packed), "--device", "cpu", "--workers", "1"]
    assert cli.main([*command, "--minutes", "0.02", "--points", "32", "--target-points", "100"]) == 0
    encoder = load_encoder(run / "last.pt")[0]
    trained = load(run, encoder, CONFIG.spec)
    assert trained is not None
    head, training = trained
    assert training["images"] > 0
    assert all(torch.isfinite(weight).all() for weight in head.parameters())


def test_learner_reaches_a_color_outside_the_start(run: Path) -> None:
    head = head_of(load_encoder(run / "last.pt")[0])
    learner, inputs = _Learner(head, ColorConfig()), torch.rand(8, len(head.state_dict()["layers.0.running_mean"]))
    head_batch = HeadBatch(
        inputs, torch.rand(8, 64, 3) - 0.5, torch.tensor([255, 128, 0], dtype=torch.uint8).expand(8, 64, 3)
    )
    for _ in range(150):
        learner.step(head_batch, 0.3)
    colors = power(head.spec, head.eval()(inputs), head_batch.canonical).mean(dim=(0, 1))
    assert colors.tolist() == pytest.approx([1, 0.5, 0], abs=0.1)


def test_load_of_a_head_of_another_checkpoint_is_refused(run: Path) -> None:
    encoder = load_encoder(run / "last.pt")[0]
    assert load(run, encoder, CONFIG.spec) is None
    head = head_of(encoder)
    save(head, encoder, {"images": 5}, run)
    loaded, training = load(run, encoder, CONFIG.spec) or (None, {})
    assert loaded is not None
    assert all(torch.equal(value, head.state_dict()[name]) for name, value in loaded.state_dict().items())
    assert training == {"images": 5}
    with torch.no_grad():
        encoder.head.linear.bias[3] += 1e-6
    with pytest.raises(ValueError, match="belongs to another checkpoint: run `hof-model color"):
        load(run, encoder, CONFIG.spec)


@pytest.mark.parametrize("domain", ["ball", "sphere"])
def test_export_with_color_leaves_theta_the_same(domain: str, tmp_path: Path) -> None:
    config = replace(CONFIG, spec=replace(CONFIG.spec, domain=domain))  # type: ignore[arg-type]
    encoder = ImageEncoder(config.spec, config.encoder, config.framing.size).eval()
    head = head_of(encoder, config)
    export(encoder, config, {"name": "plain"}, tmp_path / "plain.onnx")
    differences = export(encoder, config, {"name": "color"}, tmp_path / "color.onnx", head)
    assert 0 < differences["color: torch - onnxruntime"] < TOLERANCE
    plain, exported = Encoder.open(tmp_path / "plain.onnx", 1), Encoder.open(tmp_path / "color.onnx", 1)
    assert (plain.color_spec, exported.color_spec) == (None, color_spec(config.spec))
    images = np.random.default_rng(1).random((5, 3, 32, 32), np.float32)
    for one, other in zip(plain.encode(images), exported.encode(images), strict=True):
        assert one.color is None
        np.testing.assert_array_equal(one.theta, other.theta)
    with torch.no_grad():
        head.mix.linear.bias.add_(0.1)
    assert max(color_parity(ColoredEncoder(encoder, head), config, exported).values()) > TOLERANCE


def test_color_sampler_gives_the_colors_of_the_head(tmp_path: Path) -> None:
    encoder = ImageEncoder(CONFIG.spec, CONFIG.encoder, CONFIG.framing.size).eval()
    head = head_of(encoder)
    export(encoder, CONFIG, {"name": "x"}, tmp_path / "x.onnx", head)
    images = torch.rand(1, 3, 32, 32)
    color = Encoder.open(tmp_path / "x.onnx", 1).encode(images.numpy())[0].color
    assert color is not None
    from service.mapping.canonical import canonical_points

    x = torch.from_numpy(canonical_points("ball", 300, 4))
    with torch.no_grad():
        expected = 255 * power(head.spec, head(look(encoder, images)[1]), x[None])[0].clip(0, 1)
    assert ColorSampler(color).colors(300, seed=4) == pytest.approx(expected.numpy(), abs=0.51)


def test_color_and_export_give_a_model_with_color(run: Path, data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    checkpoint = (run / "best.pt").read_bytes()
    assert cli.main(["color", "--run", str(run), "--data", str(data), "--minutes", "0.02"]) == 0
    assert capsys.readouterr().out == f"{run / 'color.pt'}\n"
    assert (run / "best.pt").read_bytes() == checkpoint
    output = export_run(run, data, run / "weights" / "small.onnx")
    encoder = Encoder.open(output, 1)
    assert encoder.color_spec == color_spec(CONFIG.spec)
    assert encoder.card["color"]["images"] >= CONFIG.batch
    assert "- **Color**: a head on the frozen encoder" in output.with_suffix(".md").read_text()
    assert COLOR_LIMIT in encoder.card["limits"]
    assert NO_COLOR_LIMIT not in encoder.card["limits"]


def test_object_mean_leaves_out_the_background() -> None:
    image = Image.new("RGBA", (4, 4), (255, 255, 255, 0))
    image.paste((200, 100, 0, 255), (0, 0, 2, 2))
    image.paste((0, 0, 0, 51), (2, 2, 4, 4))
    assert object_mean(image) == pytest.approx([200 / 1.2, 100 / 1.2, 0])
