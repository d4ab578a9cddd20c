"""Depthwise convolution whose gradients are as quick as the convolution itself.

torch has quick gradients for kernels of 3 x 3; for those of 5 x 5 they take ten to forty times a forward pass, which
was a third of a step of Lite0. Here the gradient of a large kernel is put together from windows of 3 x 3.
"""

from typing import Any, Final

import torch
import torch.nn.functional as nnf
from torch import Tensor

QUICK: Final = 3  # side of a kernel whose gradient torch finds quickly


class Depthwise(torch.autograd.Function):
    """y = x * kernels + bias, each channel by itself, zeros around the image; in the precision that autocast says.

    `apply(x, kernels, bias, stride)`: x (b, c, h, w), kernels (c, 1, k, k) with k odd, bias (c,) ->
    (b, c, ceil(h / stride), ceil(w / stride)). Differentiable in all but the stride.
    """

    @staticmethod
    def forward(ctx: Any, x: Tensor, kernels: Tensor, bias: Tensor, stride: int) -> Tensor:  # noqa: ANN401
        """The convolution."""
        y = nnf.conv2d(x, kernels, bias, stride, kernels.shape[-1] // 2, groups=len(kernels))
        ctx.save_for_backward(x.to(y.dtype), kernels.to(y.dtype))
        ctx.stride = stride
        return y

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:  # noqa: ANN401
        """The gradients of x, kernels and bias."""
        x, kernels = ctx.saved_tensors
        (g,) = gradients
        return _of_image(x, kernels, g, ctx.stride), _of_kernels(x, kernels, g, ctx.stride), g.sum((0, 2, 3)), None


def _of_image(x: Tensor, kernels: Tensor, g: Tensor, stride: int) -> Tensor:
    if stride > 1:  # in bfloat16 these take fifty times as long
        x, kernels, g = x.float(), kernels.float(), g.float()
    return _gradients(g, x, kernels, stride, kernels.shape[-1] // 2, image=True)


def _of_kernels(x: Tensor, kernels: Tensor, g: Tensor, stride: int) -> Tensor:
    side = kernels.shape[-1]
    padded = nnf.pad(x, [side // 2] * 4)
    found = torch.empty_like(kernels)
    height, width = ((count - 1) * stride + QUICK for count in g.shape[2:])
    small = kernels[:, :, :QUICK, :QUICK].contiguous()
    for top in {*range(0, side - QUICK, QUICK), side - QUICK}:
        for left in {*range(0, side - QUICK, QUICK), side - QUICK}:
            window = padded[:, :, top : top + height, left : left + width]
            found[:, :, top : top + QUICK, left : left + QUICK] = _gradients(g, window, small, stride, 0, image=False)
    return found


def _gradients(g: Tensor, x: Tensor, kernels: Tensor, stride: int, padding: int, *, image: bool) -> Tensor:
    """The gradient of the image, or else of the kernels."""
    one = [1, 1]
    of_image, of_kernels, _ = torch.ops.aten.convolution_backward(
        g, x, kernels, None, [stride] * 2, [padding] * 2, one, False, [0, 0], len(kernels), [image, not image, False]
    )
    found: Tensor = of_image if image else of_kernels
    return found
