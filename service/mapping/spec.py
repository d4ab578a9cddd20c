"""The mapping function f_theta: the layout of its weights, and its plain NumPy forward pass.

`theta` is one flat float32 vector: layer by layer, W row-major (out, in), then b (out). The forward
pass here is the readable reference; `service.mapping.sampler` holds the fast one.
"""

import itertools
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import Any, Final, Literal, get_args

import numpy as np
import numpy.typing as npt

from service.errors import InvalidSpec

Activation = Literal["relu", "tanh"]
Domain = Literal["ball", "sphere", "ball4", "cube"]
Array = npt.NDArray[np.float32]
Colors = npt.NDArray[np.uint8]  # (n, 3), sRGB: red, green, blue

DOMAIN_DIMS: Final[dict[Domain, int]] = {"ball": 3, "sphere": 3, "ball4": 4, "cube": 3}
MAX_WIDTH: Final = 65_536
MAX_HIDDEN_LAYERS: Final = 64
MAX_K: Final = 16
MAX_SIZE: Final = 16_777_216  # numbers in theta: 64 MiB
CACHED_SPECS: Final = 64  # specs whose JSON is cached: enough for those of the models, whatever users import


@dataclass(frozen=True)
class MappingSpec:
    """The shape and canonical domain of a mapping function f: R^input_dim -> R^output_dim.

    Parameters
    ----------
    name : a label for people, for example "HOF-1".
    input_dim, output_dim : dimensions of the canonical domain and of the object's space.
    hidden : widths of the hidden layers, first to last.
    activation : the nonlinearity after every hidden layer; the last layer is affine.
    k : number of applications of f: the object is f^k(X) (paper, section 3.3). k above 1 needs
        ``input_dim == output_dim``.
    domain : the canonical set X: `ball` and `sphere` of radius 1 in 3D, `ball4` of radius 1 in 4D,
        `cube` [-1, 1]^3; always sampled uniformly.

    Raises
    ------
    InvalidSpec : the fields contradict each other, or one exceeds its limit.
    """

    name: str
    input_dim: int
    hidden: tuple[int, ...]
    output_dim: int
    activation: Activation = "relu"
    k: int = 1
    domain: Domain = "ball"

    def __post_init__(self) -> None:
        if self.activation not in get_args(Activation):
            raise InvalidSpec(f"activation must be one of {get_args(Activation)}", field="activation")
        if self.domain not in DOMAIN_DIMS:
            raise InvalidSpec(f"domain must be one of {tuple(DOMAIN_DIMS)}", field="domain")
        if self.input_dim != DOMAIN_DIMS[self.domain]:
            raise InvalidSpec(
                f"domain {self.domain!r} has {DOMAIN_DIMS[self.domain]} dimensions, input_dim is {self.input_dim}",
                field="input_dim",
            )
        if self.output_dim != 3:
            raise InvalidSpec(f"output_dim is {self.output_dim}, it must be 3", field="output_dim")
        if not 1 <= len(self.hidden) <= MAX_HIDDEN_LAYERS:
            raise InvalidSpec(
                f"hidden has {len(self.hidden)} widths, the limit is 1 to {MAX_HIDDEN_LAYERS}", field="hidden"
            )
        if not all(1 <= width <= MAX_WIDTH for width in self.hidden):
            raise InvalidSpec(f"each hidden width must lie in 1 to {MAX_WIDTH}", field="hidden")
        if not 1 <= self.k <= MAX_K:
            raise InvalidSpec(f"k is {self.k}, it must lie in 1 to {MAX_K}", field="k")
        if self.k > 1 and self.input_dim != self.output_dim:
            raise InvalidSpec("k above 1 needs input_dim equal to output_dim", field="k")
        if self.size > MAX_SIZE:
            raise InvalidSpec(f"theta would have {self.size} numbers, the limit is {MAX_SIZE}", field="hidden")

    @property
    def is_one_relu_layer(self) -> bool:
        """Return whether f is x -> V relu(W x + b) + c on three inputs, for which there is a faster algorithm."""
        return self.input_dim == 3 and len(self.hidden) == 1 and self.activation == "relu"

    @property
    def shapes(self) -> list[tuple[int, int]]:
        """Shapes (out, in) of each layer's W, first to last."""
        dims = [self.input_dim, *self.hidden, self.output_dim]
        return [(n_out, n_in) for n_in, n_out in itertools.pairwise(dims)]

    @property
    def size(self) -> int:
        """Number of weights in theta: 7,171 for HOF-1."""
        return sum(n_out * n_in + n_out for n_out, n_in in self.shapes)

    @lru_cache(CACHED_SPECS)  # noqa: B019 - specs are values, and the cache is small
    def to_json(self) -> str:
        """Return the spec as one line of JSON with sorted keys: equal specs give equal text."""
        return json.dumps(asdict(self), sort_keys=True, separators=(",", ":"))

    @classmethod
    def from_dict(cls, fields: object) -> "MappingSpec":
        """Return the spec of a decoded JSON object.

        Raises
        ------
        InvalidSpec : a field is missing, unknown or of the wrong type.
        """
        if not isinstance(fields, dict):
            raise InvalidSpec("a spec must be a JSON object", field="spec")
        _check_fields(fields)
        return cls(**{**fields, "hidden": tuple(fields["hidden"])})

    @classmethod
    def from_json(cls, text: str) -> "MappingSpec":
        """Read the text that `to_json` returns. Raises InvalidSpec."""
        try:
            fields = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise InvalidSpec(f"the spec is not JSON: {error}", field="spec") from error
        return cls.from_dict(fields)

    def with_k(self, k: int) -> "MappingSpec":
        """Return the spec of the same function, applied k times."""
        return replace(self, k=k)


@dataclass(frozen=True, eq=False)
class Color:
    """The color of an object: functions from its canonical points to red, green, blue.

    The color of the canonical point x is the mean of the functions' values at x, each clipped to [0, 1]; sRGB.

    spec : the functions' common shape.
    weights : (spec.size,) float32, laid out like theta. A composed object has (m, spec.size): a row for each of
        its k functions that has a color.
    """

    spec: MappingSpec
    weights: Array


@dataclass(frozen=True, eq=False)
class Functions:
    """The functions of one object.

    theta : (spec.size,) float32; for a composed object (k, spec.size), the last row applied first.
    color : None if the object has no color.
    """

    theta: Array
    color: Color | None = None


def join_functions(word: Sequence[Functions]) -> Functions:
    """Stack the functions of a word, in order, into those of the composed object. Their specs must be equal."""
    colors = [functions.color for functions in word if functions.color]
    color = Color(colors[0].spec, np.stack([each.weights for each in colors])) if colors else None
    return Functions(np.stack([functions.theta for functions in word]), color)


def mean_of(functions: Sequence[Functions], weights: npt.NDArray[np.float64] | None = None) -> Functions:
    """Average thetas, the paper's baseline for composition ("Object Interpolation"), and the colors that there are.

    Parameters
    ----------
    weights : (len(functions),); by default all are equal.
    """
    every = join_functions(functions)
    shares = np.ones(len(functions)) if weights is None else weights

    def mean(rows: Array, shares: npt.NDArray[np.float64]) -> Array:
        average: Array = np.average(rows, axis=0, weights=shares).astype(np.float32)
        return average

    has_color = [each.color is not None for each in functions]
    color = Color(every.color.spec, mean(every.color.weights, shares[has_color])) if every.color else None
    return Functions(mean(every.theta, shares), color)


def check_color_spec(spec: MappingSpec, color_spec: MappingSpec) -> None:
    """Raise InvalidSpec if a color function does not fit the canonical points of a mapping function."""
    if color_spec.k != 1:
        raise InvalidSpec(f"the color's k is {color_spec.k}, it must be 1", field="color_spec")
    if color_spec.domain != spec.domain:
        raise InvalidSpec(
            f"the color's domain is {color_spec.domain!r}, it must be that of the points, {spec.domain!r}",
            field="color_spec",
        )


HOF_1: Final = MappingSpec("HOF-1", input_dim=3, hidden=(1024,), output_dim=3)
HOF_3: Final = MappingSpec("HOF-3", input_dim=3, hidden=(128, 128, 128), output_dim=3)


def _check_fields(fields: dict[str, Any]) -> None:
    """Raise InvalidSpec for a missing or unknown key or a wrong type, before the dataclass is built."""
    kinds = {"name": str, "input_dim": int, "hidden": list, "output_dim": int}
    optional = {"activation": str, "k": int, "domain": str}
    for key in kinds.keys() - fields.keys():
        raise InvalidSpec(f"the spec lacks {key!r}", field=key)
    for key, value in fields.items():
        kind = {**kinds, **optional}.get(key)
        if kind is None:
            raise InvalidSpec(f"the spec has an unknown field {key!r}", field=key)
        if not isinstance(value, kind) or isinstance(value, bool):
            raise InvalidSpec(f"{key} must be of type {kind.__name__}", field=key)
    if not all(isinstance(width, int) and not isinstance(width, bool) for width in fields["hidden"]):
        raise InvalidSpec("hidden must be a list of integers", field="hidden")


def layers(spec: MappingSpec, theta: Array) -> list[tuple[Array, Array]]:
    """Split theta into views [(W (out, in), b (out,)), ...], first layer first.

    Raises
    ------
    InvalidSpec : theta is not a vector of ``spec.size`` numbers.
    """
    if theta.shape != (spec.size,):
        raise InvalidSpec(f"theta has shape {theta.shape}, {spec.name} needs ({spec.size},)", field="theta")
    views, start = [], 0
    for n_out, n_in in spec.shapes:
        middle, end = start + n_out * n_in, start + n_out * n_in + n_out
        views.append((theta[start:middle].reshape(n_out, n_in), theta[middle:end]))
        start = end
    return views


def apply(spec: MappingSpec, theta: Array, x: Array) -> Array:
    """Apply f_theta once: x (n, input_dim) -> (n, output_dim), float32 (paper, eq. 2)."""
    *hidden, (w_last, b_last) = layers(spec, theta)
    for w, b in hidden:
        x = x @ w.T + b  # (n, out)
        x = np.maximum(x, 0) if spec.activation == "relu" else np.tanh(x)
    return x @ w_last.T + b_last


def compose(spec: MappingSpec, word: Sequence[Array], x: Array) -> Array:
    """Compute f_word[0](f_word[1](... f_word[-1](x))): the last function is applied first (paper, eq. 5)."""
    for theta in reversed(word):
        x = apply(spec, theta, x)
    return x


def word_of(spec: MappingSpec, theta: Array) -> tuple[Array, ...]:
    """Return an object's k functions, the last one applied first: theta (size,) k times, or theta's k rows."""
    return (theta,) * spec.k if theta.ndim == 1 else tuple(theta)


def power(spec: MappingSpec, theta: Array, x: Array) -> Array:
    """Compute f^k(x) with ``k = spec.k`` (paper, eq. 4)."""
    return compose(spec, [theta] * spec.k, x)


def initial_theta(spec: MappingSpec, seed: int = 0) -> Array:
    """Draw initial weights, float32: W and b uniform in +-1/sqrt(in), from a seed."""
    rng = np.random.default_rng(seed)
    parts = []
    for n_out, n_in in spec.shapes:
        bound = 1 / math.sqrt(n_in)
        parts += [rng.uniform(-bound, bound, n_out * n_in), rng.uniform(-bound, bound, n_out)]
    return np.concatenate(parts).astype(np.float32)
