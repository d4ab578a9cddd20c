"""The colour head: what it is trained on, what it leaves alone, and its way into the exported file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from model import cli
from model.config import ColorConfig, TrainConfig
from model.data.dataset import draw_batch, load_examples
from model.evaluation.color import object_mean
from model.export import TOLERANCE, color_parity, export
from model.networks.color_head import ColoredEncoder, ColorHead, color_spec, digest, load, look, save
from model.networks.encoder import ImageEncoder
from model.networks.mapping import power
from model.training.checkpoints import load_encoder
from model.training.state import RunState
from model.training.train_color import Seen, _Learner, see
from service.encoding.encoder import Encoder
from service.mapping.color import ColorSampler
from service.mapping.spec import HOF_1, MappingSpec
from tests.support.small import data as small_data
from tests.support.small import network as small_network

CONFIG = replace(small_network.CONFIG, points=64, target_points=500)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_data.write(tmp_path_factory.mktemp("color") / "data")


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run's folder with the checkpoint of a network that has learnt nothing."""
    RunState(CONFIG).save(tmp_path, score=0.0)
    return tmp_path


def head_of(encoder: ImageEncoder, config: TrainConfig = CONFIG) -> ColorHead:
    side = config.framing.size
    return ColorHead(color_spec(config.spec), look(encoder, torch.zeros(1, 3, side, side))[1].shape[1]).eval()


def test_a_colour_has_1795_numbers_on_the_geometrys_own_domain() -> None:
    for spec in (HOF_1.with_k(4), replace(HOF_1, domain="sphere")):
        found = color_spec(spec)
        assert (found.size, found.k, found.domain) == (1_795, 1, spec.domain)
    assert color_spec(MappingSpec("four", 4, (9, 9), 3, "tanh", domain="ball4")).shapes == [(256, 4), (3, 256)]


def test_a_point_has_the_colour_of_the_nearest_true_point(run: Path, data: Path) -> None:
    encoder = load_encoder(run / "last.pt")[0]
    batch = draw_batch(load_examples(data, "train", CONFIG.framing), CONFIG, 0)
    with torch.no_grad():
        seen = see(encoder, CONFIG.spec, batch)
        points = power(CONFIG.spec, encoder(batch.images), batch.canonical)
        with pytest.raises(ValueError, match="hof-model data build"):
            see(encoder, CONFIG.spec, replace(batch, colors=None))
    nearest = torch.cdist(points, batch.points).argmin(dim=2)
    assert batch.colors is not None
    wanted = torch.stack([colours[index] for colours, index in zip(batch.colors, nearest, strict=True)])
    assert (seen.colours == wanted).float().mean() > 0.99
    assert (seen.canonical == batch.canonical).all()


def test_the_head_learns_and_the_encoder_stays_as_it_is(run: Path, data: Path) -> None:
    encoder = load_encoder(run / "last.pt")[0]
    before, examples = digest(encoder), load_examples(data, "train", CONFIG.framing)
    learner = _Learner(head_of(encoder), ColorConfig())
    batches = [see(encoder, CONFIG.spec, draw_batch(examples, CONFIG, step)) for step in range(4)]
    learner.step(batches[0], 0.3)
    first = learner.loss
    for step in range(200):
        learner.step(batches[step % 4], 0.3)
    assert learner.loss < 0.75 * first
    assert digest(encoder) == before


def test_a_target_outside_the_start_is_reached(run: Path) -> None:
    head = head_of(load_encoder(run / "last.pt")[0])
    learner, inputs = _Learner(head, ColorConfig()), torch.rand(8, len(head.state_dict()["layers.0.running_mean"]))
    seen = Seen(inputs, torch.rand(8, 64, 3) - 0.5, torch.tensor([255, 128, 0], dtype=torch.uint8).expand(8, 64, 3))
    for _ in range(150):
        learner.step(seen, 0.3)
    found = power(head.spec, head.eval()(inputs), seen.canonical).mean(dim=(0, 1))
    assert found.tolist() == pytest.approx([1, 0.5, 0], abs=0.1)


def test_a_head_of_another_checkpoint_is_refused(run: Path) -> None:
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
def test_theta_is_the_same_in_a_file_with_colour(domain: str, tmp_path: Path) -> None:
    config = replace(CONFIG, spec=replace(CONFIG.spec, domain=domain))  # type: ignore[arg-type]
    encoder = ImageEncoder(config.spec, config.encoder, config.framing.size).eval()
    head = head_of(encoder, config)
    export(encoder, config, {"name": "plain"}, tmp_path / "plain.onnx")
    differences = export(encoder, config, {"name": "colour"}, tmp_path / "colour.onnx", head)
    assert 0 < differences["color: torch - onnxruntime"] < TOLERANCE
    plain, exported = Encoder.open(tmp_path / "plain.onnx", 1), Encoder.open(tmp_path / "colour.onnx", 1)
    assert (plain.color_spec, exported.color_spec) == (None, color_spec(config.spec))
    images = np.random.default_rng(1).random((5, 3, 32, 32), np.float32)
    for one, other in zip(plain.encode(images), exported.encode(images), strict=True):
        assert one.color is None
        np.testing.assert_array_equal(one.theta, other.theta)
    with torch.no_grad():
        head.mix.linear.bias.add_(0.1)
    assert max(color_parity(ColoredEncoder(encoder, head), config, exported).values()) > TOLERANCE


def test_the_service_gives_the_colours_of_the_head(tmp_path: Path) -> None:
    encoder = ImageEncoder(CONFIG.spec, CONFIG.encoder, CONFIG.framing.size).eval()
    head = head_of(encoder)
    export(encoder, CONFIG, {"name": "x"}, tmp_path / "x.onnx", head)
    images = torch.rand(1, 3, 32, 32)
    color = Encoder.open(tmp_path / "x.onnx", 1).encode(images.numpy())[0].color
    assert color is not None
    from service.mapping.canonical import canonical_points

    x = torch.from_numpy(canonical_points("ball", 300, 4))
    with torch.no_grad():
        wanted = 255 * power(head.spec, head(look(encoder, images)[1]), x[None])[0].clip(0, 1)
    assert ColorSampler(color).colors(300, seed=4) == pytest.approx(wanted.numpy(), abs=0.51)


def test_from_the_command_line_to_a_model_in_colour(run: Path, data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    checkpoint = (run / "best.pt").read_bytes()
    assert cli.main(["color", "--run", str(run), "--data", str(data), "--minutes", "0.02"]) == 0
    assert capsys.readouterr().out == f"{run / 'color.pt'}\n"
    assert (run / "best.pt").read_bytes() == checkpoint
    output = run / "weights" / "small.onnx"
    assert cli.main(["export", "--run", str(run), "--data", str(data), "-o", str(output)]) == 0
    encoder = Encoder.open(output, 1)
    assert encoder.color_spec == color_spec(CONFIG.spec)
    assert encoder.card["color"]["images"] >= CONFIG.batch
    assert "- **Colour**: a head on the frozen encoder" in output.with_suffix(".md").read_text()
    assert not any("no colour" in limit for limit in encoder.card["limits"])


def test_the_mean_colour_of_an_object_leaves_out_its_ground() -> None:
    image = Image.new("RGBA", (4, 4), (255, 255, 255, 0))
    image.paste((200, 100, 0, 255), (0, 0, 2, 2))
    image.paste((0, 0, 0, 51), (2, 2, 4, 4))
    assert object_mean(image) == pytest.approx([200 / 1.2, 100 / 1.2, 0])
