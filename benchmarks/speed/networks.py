"""The networks that are timed: HOF's mapping functions, and the decoders that the paper compares with.

A decoder's latent code is the same for all points of an object, so its part of the first layer (and of
the skip) is folded into the bias: each decoder gets its best form.
"""

from dataclasses import dataclass

import numpy as np

from service.mapping.spec import Activation, Array, MappingSpec, layers


@dataclass(frozen=True)
class Layer:
    """y = W [x, skip] + b, then the activation; `skip`: the network's input is appended to x."""

    w: Array
    b: Array
    activation: Activation | None
    skip: bool = False


@dataclass(frozen=True)
class Network:
    """Layers, first to last. `parameters` counts what the architecture has before anything is folded."""

    name: str
    layers: tuple[Layer, ...]
    parameters: int

    @property
    def flops(self) -> int:
        """Floating point operations per point: two per weight, one per bias and per ReLU or tanh."""
        return sum(2 * layer.w.size + layer.b.size * (1 + bool(layer.activation)) for layer in self.layers)

    def reference(self, x: Array) -> Array:
        """Compute the plain forward pass, (n, input) -> (n, output)."""
        y = x
        for layer in self.layers:
            y = (np.concatenate([y, x], axis=1) if layer.skip else y) @ layer.w.T + layer.b
            if layer.activation:
                y = np.maximum(y, 0) if layer.activation == "relu" else np.tanh(y)
        return y


def mapping_network(spec: MappingSpec, theta: Array) -> Network:
    """Return f_theta^k as one network (paper, eq. 4)."""
    once = layers(spec, theta)
    steps = [Layer(w, b, spec.activation if index < len(once) - 1 else None) for index, (w, b) in enumerate(once)]
    return Network(f"{spec.name}, k = {spec.k}", tuple(steps) * spec.k, spec.size)


def deepsdf(seed: int = 0) -> Network:
    """Return DeepSDF: 259-512-512-512-253, skip of the 259 inputs, 512-512-512-512-4; 1,578,241 parameters."""
    widths = [(259, 512), (512, 512), (512, 512), (512, 253), (512, 512), (512, 512), (512, 512), (512, 4)]
    return _folded("DeepSDF", widths, latent=256, entries={0: 3, 4: 256}, linear={7}, skip={4}, seed=seed)


def foldingnet(seed: int = 0) -> Network:
    """Return FoldingNet: two folds, 514-512-512-3 and 515-512-512-4; 1,056,775 parameters."""
    widths = [(514, 512), (512, 512), (512, 3), (515, 512), (512, 512), (512, 4)]
    return _folded("FoldingNet", widths, latent=512, entries={0: 2, 3: 3}, linear={2, 5}, skip=set(), seed=seed)


def _folded(
    name: str,
    widths: list[tuple[int, int]],
    latent: int,
    entries: dict[int, int],
    linear: set[int],
    skip: set[int],
    seed: int,
) -> Network:
    """Return a decoder with random weights; `entries`: layer -> inputs that stay once the latent code is folded."""
    rng = np.random.default_rng(seed)
    code = rng.standard_normal(latent).astype(np.float32)
    steps, parameters = [], 0
    for index, (n_in, n_out) in enumerate(widths):
        w = (rng.standard_normal((n_out, n_in)) * (2 / n_in) ** 0.5).astype(np.float32)
        b = np.zeros(n_out, np.float32)
        parameters += w.size + b.size
        if index in entries:
            b = b + w[:, entries[index] :] @ code
            w = np.ascontiguousarray(w[:, : entries[index]])
        steps.append(Layer(w, b, None if index in linear else "relu", skip=index in skip))
    return Network(name, tuple(steps), parameters)
