"""Plain torch against the compiled operations: what runs on a device without Triton."""

import pytest
import torch
from torch import Tensor

from model.networks.ops import plain
from model.networks.ops.fused_mlp import FusedLayers
from model.networks.ops.nearest import nearest_index


def relative(value: Tensor, reference: Tensor) -> float:
    return float((value - reference).norm() / reference.norm())


@pytest.mark.parametrize("pairs", [1, 100, 1 << 26])
def test_nearest_of_plain_torch_finds_what_the_grid_finds(pairs: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plain, "PAIRS", pairs)
    torch.manual_seed(0)
    queries, targets = torch.rand(2, 40, 3) - 0.5, torch.rand(2, 60, 3) - 0.5
    assert torch.equal(plain.nearest_index(queries, targets), nearest_index(queries, targets))


@pytest.mark.parametrize("pairs", [1, 2_000, 1 << 26])
def test_recomputed_layers_have_the_values_and_gradients_of_the_compiled_ones(
    pairs: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plain, "PAIRS", pairs)
    torch.manual_seed(0)
    b, h, n = 2, 70, 45
    arguments = [torch.randn(*shape, requires_grad=True) for shape in ((b, 3, h), (b, h), (b, 3, h), (b, 3), (b, 3, n))]
    results = []
    for layers in (FusedLayers, plain.RecomputedLayers):
        y = layers.apply(*arguments)  # type: ignore[no-untyped-call]
        loss = (y * torch.linspace(-1, 1, y.numel()).view_as(y)).sum()
        results.append([y.detach(), *torch.autograd.grad(loss, arguments)])
    assert max(map(relative, *results)) < 1e-5
