"""Depthwise convolution's own gradients against torch's."""

from collections.abc import Callable

import pytest
import torch
import torch.nn.functional as nnf
from torch import Tensor

from model.networks.ops.depthwise import Depthwise

Layer = Callable[..., Tensor]


def plain(x: Tensor, kernels: Tensor, bias: Tensor, stride: int) -> Tensor:
    return nnf.conv2d(x, kernels, bias, stride, kernels.shape[-1] // 2, groups=len(kernels))


def outcome(layer: Layer, inputs: list[Tensor], stride: int, half: bool) -> list[Tensor]:
    """Return the maps, and the gradients of all three inputs."""
    leaves = [each.clone().requires_grad_() for each in inputs]
    with torch.autocast("cpu", torch.bfloat16, enabled=half):
        maps = layer(*leaves, stride)
    assert maps.dtype == (torch.bfloat16 if half else torch.float32)
    weights = torch.randn(maps.shape, generator=torch.Generator().manual_seed(1))
    (maps * weights).sum().backward()  # type: ignore[no-untyped-call]
    return [maps.detach().float(), *(leaf.grad for leaf in leaves if leaf.grad is not None)]


@pytest.mark.parametrize("side", [3, 5, 7])
@pytest.mark.parametrize("stride", [1, 2])
@pytest.mark.parametrize("size", [(8, 8), (7, 9)])
@pytest.mark.parametrize(("half", "tolerance"), [(False, 1e-5), (True, 2e-2)])
def test_depthwise_gives_maps_and_gradients_of_torch(
    side: int, stride: int, size: tuple[int, int], half: bool, tolerance: float
) -> None:
    torch.manual_seed(0)
    inputs = [torch.randn(3, 6, *size), torch.randn(6, 1, side, side), torch.randn(6)]
    actual = outcome(Depthwise.apply, inputs, stride, half)
    expected = outcome(plain, inputs, stride, half=False)
    assert len(actual) == len(expected) == 4
    for ours, theirs in zip(actual, expected, strict=True):
        assert ours.numpy() == pytest.approx(theirs.numpy(), abs=tolerance * float(theirs.abs().max()))
