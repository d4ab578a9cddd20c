"""The device's operations against the CPU's: equal losses within 1e-4, equal gradients within 1e-3."""

from collections.abc import Iterator
from typing import Final

import torch
from torch import Tensor

from model.networks.mapping import power
from model.networks.ops import plain
from model.networks.ops.dispatch import fused_layers, nearest_index
from model.training.losses import chamfer, late_chamfer
from service.mapping.spec import HOF_1, initial_theta

LOSS_LIMIT: Final = 1e-4  # relative
GRADIENT_LIMIT: Final = 1e-3  # relative, of the whole gradient's norm
OBJECTS: Final = 3


def check_parity(device: torch.device) -> tuple[str, bool]:
    """Return a Markdown table of relative differences, and whether all are within their limits."""
    lines, holds = ["| operation | relative difference | limit |", "|---|---|---|"], True
    for name, difference, limit in _differences(device):
        lines.append(f"| {name} | {difference:.1e} | {limit:.0e} |")
        holds &= difference <= limit
    return "\n".join(lines) + "\n", holds


def _differences(device: torch.device) -> Iterator[tuple[str, float, float]]:
    torch.manual_seed(0)
    for n, m in ((777, 10_000), (1_500, 61)):
        queries, targets = torch.rand(OBJECTS, n, 3) - 0.5, torch.rand(OBJECTS, m, 3) - 0.5
        expected = torch.cdist(queries.double(), targets.double()).amin(2)
        for form, search in (("on the device", nearest_index), ("in plain torch", plain.nearest_index)):
            index = search(queries.to(device), targets.to(device)).cpu()
            distance = (targets.double().gather(1, index.unsqueeze(2).expand(-1, -1, 3)) - queries).norm(dim=2)
            yield f"nearest of {m:,}, {form}: distance", _relative(distance, expected), LOSS_LIMIT
    yield from _layer_differences(device)
    yield from _loss_differences(device)


def _layer_differences(device: torch.device) -> Iterator[tuple[str, float, float]]:
    """Compare the fused layers' values and gradients with those in float64."""
    b, h, n = OBJECTS, 1_000, 1_111
    arguments = [torch.randn(*shape) for shape in ((b, 3, h), (b, h), (b, 3, h), (b, 3), (b, 3, n))]
    expected = _layers(plain.RecomputedLayers, [each.double() for each in arguments])
    for form, layers in (("on the device", fused_layers(device)), ("in plain torch", plain.RecomputedLayers)):
        values = _layers(layers, [each.to(device) for each in arguments])
        yield f"mapping function, {form}: points", _relative(values[0], expected[0]), LOSS_LIMIT
        worst = max(map(_relative, values[1:], expected[1:]))
        yield f"mapping function, {form}: gradients", worst, GRADIENT_LIMIT


def _layers(layers: type[torch.autograd.Function], arguments: list[Tensor]) -> list[Tensor]:
    """Return y and the gradients of all arguments for a fixed gradient of y."""
    inputs = [each.detach().requires_grad_() for each in arguments]
    y = layers.apply(*inputs)  # type: ignore[no-untyped-call]
    slope = torch.linspace(-1, 1, y.numel(), dtype=y.dtype, device=y.device).view_as(y)
    return [each.detach().cpu() for each in (y, *torch.autograd.grad(y, inputs, slope))]


def _loss_differences(device: torch.device) -> Iterator[tuple[str, float, float]]:
    """Yield how both losses through f^2, and their gradients by theta, differ from the CPU loop's operations."""
    spec = HOF_1.with_k(2)
    theta = torch.from_numpy(initial_theta(spec)) + 0.05 * torch.randn(OBJECTS, spec.size)
    canonical, true = torch.rand(OBJECTS, 1_536, 3) * 2 - 1, torch.rand(OBJECTS, 10_000, 3) - 0.5
    for name, loss in (("early", chamfer), ("late", late_chamfer)):
        results = []
        for place in (torch.device("cpu"), device):
            weights = theta.to(place).requires_grad_()
            value = loss(power(spec, weights, canonical.to(place)), true.to(place))
            results.append((value.detach().cpu(), torch.autograd.grad(value, weights)[0].cpu()))
        (expected, slope), (value, gradient) = results
        yield f"{name} loss", _relative(value, expected), LOSS_LIMIT
        yield f"{name} loss: gradient by theta", _relative(gradient, slope), GRADIENT_LIMIT


def _relative(value: Tensor, expected: Tensor) -> float:
    difference = float((value.double() - expected.double()).norm() / expected.double().norm())
    return difference if difference == difference else float("inf")  # NaN never passes
