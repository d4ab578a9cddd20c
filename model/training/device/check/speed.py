"""Speed of training on a device, and where its time goes, on random data of a real set's sizes."""

import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import torch
from torch import Tensor
from torch.profiler import ProfilerActivity, profile

from model.config import LITE0, TrainConfig
from model.data.packed.tensors import Tensors
from model.networks.mapping import power
from model.networks.ops.dispatch import nearest_index
from model.training.device.augment import Grounds
from model.training.device.draws import Draws, uniform_points
from model.training.device.pictures import Pictures, texture_pictures
from model.training.device.steps import WARM_STEPS, Steps
from model.training.losses import late_chamfer
from model.training.state import RunState
from service.encoding.framing import Framing

VIEWS, SHAPES, POINTS = 16_384, 1_024, 10_000
PHOTOGRAPHS: Final = 24
REPEATS: Final = 20
PROFILED: Final = 10  # steps
SHOWN: Final = 12  # kernels


def measure_training(device: torch.device, size: int, batch: int, steps: int, compiled: bool = False) -> str:
    """Return Markdown tables: images a second of whole steps, share of the time in kernels, the longest kernels."""
    lines = ["| loss | steps | images/s | ms a step | time in kernels | memory, GB |", "|---|---|---|---|---|---|"]
    kinds = [("kernel by kernel", False, False), ("CUDA graph", True, False)]
    kernels = ""
    for phase in ("early", "late"):
        for name, graphs, with_compiler in [*kinds, ("CUDA graph, compiled", True, True)] if compiled else kinds:
            taker = _steps(device, size, batch, phase == "late", graphs, with_compiler)
            seconds = _seconds(taker.take, steps)
            share, kernels = _profile(taker.take)
            memory = torch.cuda.max_memory_allocated() / 1e9
            figures = f"{batch / seconds:,.0f} | {1e3 * seconds:.2f} | {share:.0%} | {memory:.1f}"
            lines.append(f"| {phase} | {name} | {figures} |")
            del taker
            torch.cuda.empty_cache()
    return "\n".join(lines) + f"\n\nThe longest kernels of a late step, ms:\n\n{kernels}\n"


def measure_parts(device: torch.device, size: int, batch: int) -> str:
    """Return a Markdown table: milliseconds of a late step's parts, each by itself."""
    steps = _steps(device, size, batch, late=True, graphs=False, compiled=False)
    state, config = steps.state, steps.state.config
    units = steps.draws.units(0)
    images = torch.rand(batch, 3, size, size, device=device).contiguous(memory_format=torch.channels_last)
    theta = torch.randn(batch, config.spec.size, device=device).mul_(0.05).requires_grad_()
    canonical = uniform_points("ball", batch, config.late_points, device)
    true = torch.rand(batch, config.late_target_points, 3, device=device) - 0.5
    points = (torch.rand(batch, config.late_points, 3, device=device) - 0.5).requires_grad_()
    encoder = state.network.get_submodule("encoder").train()

    def step_optimizer() -> None:
        for weight in state.network.parameters():
            weight.grad = torch.ones_like(weight) if weight.requires_grad else None
        state.optimizer.step()

    parts: dict[str, Callable[[], object]] = {
        "batch drawn and augmented": lambda: steps.draws.batch(units, config.late_points, config.late_target_points),
        "encoder, forward": lambda: encoder(images),
        "encoder, forward and backward": lambda: _backward(encoder(images).square().mean()),
        "mapping function, forward": lambda: power(config.spec, theta.detach(), canonical),
        "mapping function, forward and backward": lambda: _backward(power(config.spec, theta, canonical).mean()),
        "nearest, predicted to true": lambda: nearest_index(points, true),
        "nearest, true to predicted": lambda: nearest_index(true[:, : 2 * config.late_points], points),
        "late loss, forward and backward": lambda: _backward(late_chamfer(points, true)),
        "optimizer": step_optimizer,
    }
    lines = ["| part of a late step | ms |", "|---|---|"]
    lines += [f"| {name} | {1e3 * _seconds(part, REPEATS):.2f} |" for name, part in parts.items()]
    return "\n".join(lines) + "\n"


def _backward(loss: Tensor) -> None:
    loss.backward()  # type: ignore[no-untyped-call]


def _steps(device: torch.device, size: int, batch: int, late: bool, graphs: bool, compiled: bool) -> Steps:
    """Return steps of a run from random weights on random data."""
    config = replace(
        TrainConfig(), encoder=LITE0, framing=Framing(size), batch=batch, steps=10**6, late_from=0.0 if late else 1.0
    )
    torch.cuda.reset_peak_memory_stats()
    draws = Draws(_data(device, size), _grounds(device, size), config, compiled)
    return Steps(RunState(config, device), draws, graphs, compiled)


def _data(device: torch.device, size: int) -> Tensors:
    """Return random views with an opaque square, of shapes of random points."""
    images = torch.randint(256, (VIEWS, size, size, 4), dtype=torch.uint8, device=device)
    images[..., 3] = 0
    images[:, size // 8 : -size // 8, size // 8 : -size // 8, 3] = 255
    per_shape = VIEWS // SHAPES
    firsts = torch.arange(0, VIEWS, per_shape, device=device)
    return Tensors(
        images=images,
        shape_of=torch.arange(VIEWS, device=device) // per_shape,
        points=torch.randint(-32_767, 32_768, (SHAPES * POINTS, 3), dtype=torch.int16, device=device),
        colors=None,
        starts=torch.arange(SHAPES, device=device) * POINTS,
        counts=torch.full((SHAPES,), POINTS, device=device),
        units=torch.stack([firsts, firsts + per_shape, firsts + per_shape], dim=1),
    )


def _grounds(device: torch.device, size: int) -> Grounds:
    photographs = [torch.randint(256, (3 * size, 4 * size, 3), dtype=torch.uint8) for _ in range(PHOTOGRAPHS)]
    return Grounds(texture_pictures(size, device), Pictures.join(photographs, device))


def _seconds(call: Callable[[], object], repeats: int) -> float:
    """Return the median over five runs of the seconds that one of `repeats` calls takes, after a warm-up."""
    for _ in range(WARM_STEPS + 2):
        call()
    torch.cuda.synchronize()
    times = []
    for _ in range(5):
        start = time.perf_counter()
        for _ in range(max(1, repeats // 5)):
            call()
        torch.cuda.synchronize()
        times.append((time.perf_counter() - start) / max(1, repeats // 5))
    return statistics.median(times)


def _profile(call: Callable[[], object]) -> tuple[float, str]:
    """Return the share of the time in which a kernel runs, and a Markdown table of the longest kernels."""
    torch.cuda.synchronize()
    with profile(activities=[ProfilerActivity.CUDA], acc_events=True) as profiler:
        start = time.perf_counter()
        for _ in range(PROFILED):
            call()
        torch.cuda.synchronize()
        wall_us = 1e6 * (time.perf_counter() - start)
    kernels = [event for event in profiler.events() or [] if event.device_type.name == "CUDA"]
    spans = sorted((event.time_range.start, event.time_range.end) for event in kernels)
    busy, until = 0.0, 0.0
    for begin, end in spans:
        busy += max(0.0, end - max(begin, until))
        until = max(until, end)
    totals: dict[str, list[float]] = {}
    for event in kernels:
        totals.setdefault(event.name[:70], []).append(event.time_range.elapsed_us())
    longest = sorted(totals.items(), key=lambda item: -sum(item[1]))[:SHOWN]
    rows = [f"| `{name}` | {len(each) // PROFILED} | {sum(each) / 1e3 / PROFILED:.2f} |" for name, each in longest]
    count = len(kernels) // PROFILED
    return busy / wall_us, "\n".join([f"| kernel, of {count} a step | calls | ms |", "|---|---|---|", *rows])
