"""The compiled pair of layers against torch's own operations."""

from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from model.networks.ops.fused_mlp import TILE, FusedLayers
from service.mapping.spec import HOF_1, HOF_3, MappingSpec

Layers = Callable[..., Tensor]


def plain(w: Tensor, b: Tensor, v: Tensor, c: Tensor, x: Tensor) -> Tensor:
    hidden = (w.transpose(1, 2) @ x + b.unsqueeze(2)).relu()
    return v @ hidden + c.unsqueeze(2)


def outcome(layers: Layers, inputs: list[Tensor], weights: Tensor) -> list[Tensor]:
    """Return the points, and the gradients of all five inputs."""
    leaves = [each.clone().requires_grad_() for each in inputs]
    points = layers(*leaves)
    (points * weights).sum().backward()  # type: ignore[no-untyped-call]
    return [points.detach(), *(leaf.grad for leaf in leaves if leaf.grad is not None)]


@pytest.mark.parametrize("n", [1, TILE, 2 * TILE + 3])
def test_fused_layers_give_points_and_gradients_of_plain_operations(n: int) -> None:
    torch.manual_seed(0)
    shapes = [(3, 3, 40), (3, 40), (3, 3, 40), (3, 3), (3, 3, n)]
    inputs = [torch.randn(shape) for shape in shapes]
    weights = torch.randn(3, 3, n)
    fused = outcome(FusedLayers.apply, inputs, weights)
    expected = outcome(plain, inputs, weights)
    assert len(fused) == len(expected) == 6
    for ours, theirs in zip(fused, expected, strict=True):
        assert ours.numpy() == pytest.approx(theirs.numpy(), abs=1e-5 * float(theirs.abs().max()))


def test_is_one_relu_layer_needs_one_hidden_layer_on_three_inputs() -> None:
    assert HOF_1.is_one_relu_layer
    assert not HOF_3.is_one_relu_layer
    assert not MappingSpec("tanh", 3, (8,), 3, "tanh").is_one_relu_layer
    assert not MappingSpec("four", 4, (8,), 3, domain="ball4").is_one_relu_layer
