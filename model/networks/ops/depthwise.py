"""Depthwise convolution whose gradients are as fast as the convolution itself.

torch has fast gradients for kernels of 3 x 3. For kernels of 5 x 5 they take ten to forty times a forward pass, which
was a third of a step of Lite0. Here the gradient of a large kernel is assembled from windows of 3 x 3.
"""

from typing import Any, Final

import torch
import torch.nn.functional as nnf
from torch import Tensor

FAST: Final = 3  # side of a kernel with a fast gradient in torch


class Depthwise(torch.autograd.Function):
    """y = x * kernels + bias, each channel by itself, zeros around the image, in the precision set by autocast.

    `apply(x, kernels, bias, stride)`: x (b, c, h, w), kernels (c, 1, k, k) with k odd, bias (c,) ->
    (b, c, ceil(h / stride), ceil(w / stride)). Differentiable in x, kernels and bias.
    """

    @staticmethod
    def forward(ctx: Any, x: Tensor, kernels: Tensor, bias: Tensor, stride: int) -> Tensor:  # noqa: ANN401
        """Return the convolution."""
        y = nnf.conv2d(x, kernels, bias, stride, kernels.shape[-1] // 2, groups=len(kernels))
        ctx.save_for_backward(x.to(y.dtype), kernels.to(y.dtype))
        ctx.stride = stride
        return y

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:  # noqa: ANN401
        """Return the gradients of x, kernels and bias."""
        x, kernels = ctx.saved_tensors
        (g,) = gradients
        image, kernel = _image_gradient(x, kernels, g, ctx.stride), _kernel_gradient(x, kernels, g, ctx.stride)
        return image, kernel, g.sum((0, 2, 3)), None


def _image_gradient(x: Tensor, kernels: Tensor, g: Tensor, stride: int) -> Tensor:
    if stride > 1:  # in bfloat16 it takes fifty times as long
        x, kernels, g = x.float(), kernels.float(), g.float()
    return _gradient(g, x, kernels, stride, kernels.shape[-1] // 2, image=True)


def _kernel_gradient(x: Tensor, kernels: Tensor, g: Tensor, stride: int) -> Tensor:
    side = kernels.shape[-1]
    padded = nnf.pad(x, [side // 2] * 4)
    gradient = torch.empty_like(kernels)
    height, width = ((count - 1) * stride + FAST for count in g.shape[2:])
    small = kernels[:, :, :FAST, :FAST].contiguous()
    for top in {*range(0, side - FAST, FAST), side - FAST}:
        for left in {*range(0, side - FAST, FAST), side - FAST}:
            window = padded[:, :, top : top + height, left : left + width]
            part = _gradient(g, window, small, stride, 0, image=False)
            gradient[:, :, top : top + FAST, left : left + FAST] = part
    return gradient


def _gradient(g: Tensor, x: Tensor, kernels: Tensor, stride: int, padding: int, *, image: bool) -> Tensor:
    """Return the gradient of the image, or else of the kernels."""
    one = [1, 1]
    image_gradient, kernel_gradient, _ = torch.ops.aten.convolution_backward(
        g, x, kernels, None, [stride] * 2, [padding] * 2, one, False, [0, 0], len(kernels), [image, not image, False]
    )
    gradient: Tensor = image_gradient if image else kernel_gradient
    return gradient
