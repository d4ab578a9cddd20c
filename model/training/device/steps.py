"""Training steps without the host: drawing, network, loss, optimizer and average as one sequence on the device."""

from typing import Final

import numpy as np
import torch
from torch import Tensor, nn

from model.networks.densenet import DenseMaps
from model.networks.encoder import LiteMaps, channels_last
from model.networks.resnet18 import ResNetMaps
from model.training.average import ema_decay
from model.training.device.draws import Draws, seed_step
from model.training.losses import training_loss
from model.training.optimization import schedule
from model.training.state import RunState

WARM_STEPS: Final = 3  # taken one kernel at a time before a step is captured: compilers and allocators settle


class Steps:
    """Takes the steps of a run. The host sets a few numbers per step and waits only where the mean loss is read.

    On CUDA each phase, early and late, becomes a graph after WARM_STEPS; a step is then one replay. Random numbers
    come from torch's default generator, seeded by (seed, step), so a resumed run makes the same steps.
    """

    def __init__(self, state: RunState, draws: Draws, graphs: bool = True, compiled: bool = False) -> None:
        self.state = state
        self.draws = draws
        if compiled:
            _compile_convolutions(state.network)
        self._device = next(state.network.parameters()).device
        self._graphs = graphs and self._device.type == "cuda"
        self._graph: torch.cuda.CUDAGraph | None = None
        self._phase: tuple[int, int] | None = None
        self._warm = 0
        self._units = torch.zeros(state.config.batch, dtype=torch.int64, device=self._device)
        self._share = torch.zeros((), device=self._device)  # of the network in the average
        self._loss = torch.zeros((), device=self._device)  # sum since it was read
        self._count = 0
        self._weights = [weight for weight in state.network.parameters() if weight.requires_grad]
        self._averages = _pairs(state.average, state.network)
        for group in state.optimizer.param_groups:
            group["lr"] = torch.tensor(0.0, device=self._device)
            group["capturable"] = self._device.type == "cuda"

    def take(self) -> None:
        """Take the run's next step; returns before the device has finished it."""
        state = self.state
        progress = state.progress
        self._set_inputs(progress)
        sizes = state.config.at(progress)
        if (sizes.points, sizes.target_points) != self._phase:
            self._phase, self._graph, self._warm = (sizes.points, sizes.target_points), None, 0
        if self._graph is None and self._graphs and self._warm >= WARM_STEPS:
            self._graph = torch.cuda.CUDAGraph()
            with torch.cuda.graph(self._graph):
                self._compute(progress)
        if self._graph is not None:
            self._graph.replay()
        elif self._graphs:
            self._compute_aside(progress)
        else:
            self._compute(progress)
        state.step += 1
        self._count += 1

    def mean_loss(self) -> tuple[float, int]:
        """Return the mean loss since the last call and the steps that it is over: the host waits for the device.

        Raises
        ------
        FloatingPointError : it is not finite.
        """
        count, self._count = self._count, 0
        loss = float(self._loss) / max(1, count)
        self._loss.zero_()
        if not np.isfinite(loss):
            raise FloatingPointError(
                f"the loss is {loss} at step {self.state.step}: resume with a lower --learning-rate"
            )
        return loss, count

    def _set_inputs(self, progress: float) -> None:
        """Set what differs from step to step: objects, learning rates, the average's share, the random seed."""
        state = self.state
        self._units.copy_(self.draws.units(state.step))
        for group in state.optimizer.param_groups:
            share = schedule(progress, state.config.constant_rate)
            group["lr"].fill_(group["rate"] * state.config.learning_rate * share)
        self._share.fill_(1 - ema_decay(state.step))
        seed_step(state.config.seed, state.step)

    def _compute(self, progress: float) -> None:
        """Run one step's kernels; the shapes depend on the phase alone."""
        state = self.state
        config = state.config.at(progress)
        batch = self.draws.batch(self._units, config.points, config.target_points)
        state.network.train()
        state.optimizer.zero_grad(set_to_none=True)
        predicted = state.network(channels_last(batch.images), batch.canonical)
        if batch.scale is not None:
            predicted = predicted * batch.scale
        loss = training_loss(state.config, predicted, batch.canonical, batch.points, progress)
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self._weights, config.gradient_clip, foreach=True)
        state.optimizer.step()
        self._update_average()
        self._loss += loss.detach()

    def _compute_aside(self, progress: float) -> None:
        """Run one step on another stream, as CUDA asks for before a capture."""
        stream = torch.cuda.Stream()  # type: ignore[no-untyped-call]
        stream.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(stream):
            self._compute(progress)
        torch.cuda.current_stream().wait_stream(stream)
        self._warm += 1

    @torch.no_grad()
    def _update_average(self) -> None:
        """Move the average towards the network: `model.training.average.update_average` in three kernels."""
        (averages, weights), (counts, current) = self._averages
        difference = torch._foreach_sub(weights, averages)
        torch._foreach_mul_(difference, self._share)
        torch._foreach_add_(averages, difference)
        if counts:
            torch._foreach_copy_(counts, current)


def _compile_convolutions(network: nn.Module) -> None:
    """Compile the trunk's convolutions in place: biases and activations then join the kernels around them."""
    for module in network.modules():
        if isinstance(module, (DenseMaps, LiteMaps, ResNetMaps)):
            module.compile()


def _pairs(average: nn.Module, network: nn.Module) -> list[tuple[list[Tensor], list[Tensor]]]:
    """Return the tensors of both networks in the same order: floating-point ones, then the others."""
    own, other = average.state_dict(), network.state_dict()
    floating = [name for name, value in own.items() if value.is_floating_point()]
    counts = [name for name in own if name not in set(floating)]
    return [([own[name] for name in names], [other[name] for name in names]) for names in (floating, counts)]
