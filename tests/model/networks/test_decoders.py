"""The compared methods: sizes, shapes, and each decoder against its documentation."""

from dataclasses import replace
from itertools import pairwise
from typing import get_args

import numpy as np
import pytest
import torch
from torch import nn

from model.config import METHOD_DOMAINS, Method, TrainConfig
from model.networks.atlasnet import PATCHES, AtlasNet, Patch
from model.networks.decoders import DIRECT_POINTS, DeepSdf, FoldingNet, Lvc, make_network
from service.encoding.framing import Framing
from service.mapping.spec import HOF_1
from tests.support.small import network as small_network

CONFIG = TrainConfig(
    spec=replace(HOF_1, domain="cube"),
    encoder=small_network.ENCODER,
    framing=Framing(size=32),
)


def config_of(method: Method) -> TrainConfig:
    return replace(CONFIG, method=method, spec=replace(HOF_1, domain=METHOD_DOMAINS.get(method, "cube")))


def count(*modules: nn.Module) -> int:
    return sum(parameter.numel() for module in modules for parameter in module.parameters())


def test_decoders_have_the_parameters_of_the_paper() -> None:
    deepsdf, foldingnet = DeepSdf(CONFIG), FoldingNet(CONFIG)
    assert count(deepsdf.first, deepsdf.second) == 1_578_241
    assert count(foldingnet.first, foldingnet.second) == 1_056_775


@pytest.mark.parametrize("method", get_args(Method))
def test_network_gives_points_that_depend_on_image_and_canonical_points(method: Method) -> None:
    torch.manual_seed(0)
    network = make_network(config_of(method)).eval()
    images, canonical = torch.rand(2, 3, 32, 32), torch.rand(2, 50, 3)
    points = network(images, canonical)
    assert points.shape == (2, DIRECT_POINTS if method == "direct" else 50, 3)
    assert not torch.equal(points, network(1 - images, canonical))
    assert torch.equal(points, network(images, 1 - canonical)) == (method == "direct")


@pytest.mark.parametrize("method", get_args(Method))
def test_network_gives_every_weight_a_gradient(method: Method) -> None:
    network = make_network(config_of(method)).train()
    network(torch.rand(4, 3, 32, 32), torch.rand(4, 50, 3)).square().sum().backward()
    assert all(parameter.grad is not None for parameter in network.parameters())


def test_atlasnet_has_the_layers_of_its_paper() -> None:
    for inputs in (2, 3):
        width = inputs + 1024
        sizes = (width, width, width // 2, width // 4, 3)
        linear = sum(n_in * n_out + n_out for n_in, n_out in pairwise(sizes))
        assert count(Patch(inputs)) == linear + 2 * sum(sizes[1:4])
    many = AtlasNet(config_of("atlasnet_25"))
    assert count(many.patches) == PATCHES * count(Patch(2)) == 42_912_450


def test_atlasnet_deals_points_out_to_its_patches() -> None:
    torch.manual_seed(0)
    network = AtlasNet(config_of("atlasnet_25")).eval()
    images, canonical = torch.rand(1, 3, 32, 32), torch.rand(1, 30, 3)
    points = network(images, canonical)
    code = network.code(network.trunk(images))
    second = network.patches[1]((canonical[:, [1, 26], :2] + 1) / 2, code)
    assert torch.allclose(points[:, [1, 26]], second, atol=1e-6)
    assert network(images, canonical[:, :7]).shape == (1, 7, 3)
    with pytest.raises(ValueError, match="atlasnet_sphere takes its points from the domain 'sphere'"):
        make_network(replace(CONFIG, method="atlasnet_sphere"))


def test_lvc_with_one_code_is_the_code_at_every_point() -> None:
    torch.manual_seed(0)
    layers = Lvc([5, 16, 7])
    x, code = torch.rand(2, 9, 3), torch.rand(2, 2)
    plain = nn.Sequential(layers.first, nn.ReLU(), *layers.others)
    everywhere = torch.cat([x, code.unsqueeze(1).expand(-1, 9, -1)], dim=2)
    assert layers(x, code).detach().numpy() == pytest.approx(plain(everywhere).detach().numpy(), abs=1e-6)


def test_foldingnet_ignores_z_and_needs_the_cube() -> None:
    network = FoldingNet(CONFIG).eval()
    images, canonical = torch.rand(1, 3, 32, 32), torch.rand(1, 50, 3)
    moved = canonical + torch.tensor([0.0, 0.0, 0.3])
    assert torch.equal(network(images, canonical), network(images, moved))
    with pytest.raises(ValueError, match="cube"):
        make_network(replace(CONFIG, method="foldingnet", spec=HOF_1))


def test_make_network_is_decided_by_the_seed() -> None:
    first, again, other = (
        (torch.manual_seed(seed), make_network(CONFIG).state_dict()["encoder.head.linear.weight"].numpy())[1]
        for seed in (0, 0, 1)
    )
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
