"""Experiments that train: the variants of each, and the paper's claims about them. Nothing heavy is imported here.

All variants of a suite share data, split, image encoder, number of images and seeds; they differ as listed. The
configs of `common` come from the command line.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final, Literal

from model.config import COMPARED_METHODS, EncoderConfig, Frame, Predicted, TrainConfig
from service.mapping.spec import DOMAIN_DIMS, HOF_1, HOF_3, Activation, Domain, MappingSpec

Change = Callable[[TrainConfig], TrainConfig]
Figures = tuple[float, float]  # CD(P,T), CD(T,P) of the paper

DEEP: Final = (128,) * 6
LAMBDA: Final = 0.01
TRAVEL: Final = "travel"
BOXY: Final = ("cabinet", "shelf", "appliance", "loudspeaker")
CD: Final = "cd"  # mean of both directions


@dataclass(frozen=True)
class Claim:
    """A claim of the paper about two variants of a suite.

    kind : lower, the figure of `one` is lower than that of `other`; close, it is not much of it away.
    classes : classes of objects that the claim is about; none, all.
    """

    text: str
    one: str
    other: str
    kind: Literal["lower", "close"] = "close"
    figure: str = CD
    classes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Suite:
    """One experiment.

    variants : change of the common config, by name; the first is the base.
    paper : the paper's two distances, by variant.
    is_by_class : figures by class too, beside image retrieval and the oracle nearest neighbor.
    """

    number: int
    title: str
    text: str
    variants: Mapping[str, Change]
    claims: tuple[Claim, ...]
    paper: Mapping[str, Figures] = field(default_factory=dict)
    is_by_class: bool = False


def _hof(
    spec: MappingSpec,
    domain: Domain = "ball",
    hidden: tuple[int, ...] | None = None,
    activation: Activation = "relu",
    k: int = 1,
) -> Change:
    """Return the change to a mapping function like `spec`."""
    shape = hidden or spec.hidden
    changed = replace(spec, input_dim=DOMAIN_DIMS[domain], domain=domain, hidden=shape, activation=activation, k=k)
    return lambda common: replace(common, method="hof", spec=changed)


def _with_encoder(change: Change, encoder: Callable[[EncoderConfig], EncoderConfig]) -> Change:
    def changed(common: TrainConfig) -> TrainConfig:
        own = change(common)
        return replace(own, encoder=encoder(own.encoder))

    return changed


def _resnet(encoder: EncoderConfig) -> EncoderConfig:
    return replace(encoder, trunk="resnet18", fine_maps=0)


def _predicting(part: Predicted) -> Change:
    return _with_encoder(_hof(HOF_3), lambda encoder: replace(encoder, predicted=part))


def _regularized(form: Literal["travel", "nearest"]) -> Change:
    return lambda common: replace(_hof(HOF_3)(common), projection=LAMBDA, projection_form=form)


def _framed(frame: Frame) -> Change:
    return lambda common: replace(_hof(HOF_3)(common), frame=frame, made=False)  # made pieces tell no cameras


TABLE_1: Final = Suite(
    1,
    "Table 1: reconstruction architectures",
    "HOF and the decoders it is compared with, behind the same image encoder.",
    {each.name: each.config for each in COMPARED_METHODS},
    (
        Claim("HOF-1 is on par with DeepSDF, with 220 times fewer parameters", "HOF-1", "DeepSDF"),
        Claim("HOF-3 is on par with DeepSDF", "HOF-3", "DeepSDF"),
        Claim("HOF-1 is better than FoldingNet", "HOF-1", "FoldingNet", "lower"),
        Claim("HOF-1 is better than a direct decoder", "HOF-1", "direct decoder", "lower"),
        Claim("HOF-1 is better than AtlasNet", "HOF-1", "AtlasNet, 25 patches", "lower"),
    ),
    {"HOF-1": (1.517, 1.021), "HOF-3": (1.480, 1.014), "DeepSDF": (1.521, 0.962), "FoldingNet": (1.563, 1.534)},
    is_by_class=True,
)
ARCHITECTURE: Final = Suite(
    2,
    "Architecture",
    "Variations of HOF-3 with k = 1. The deep function has 6 hidden layers; tanh is in the function alone.",
    {
        "base, HOF-3": _hof(HOF_3),
        "ResNet18 encoder": _with_encoder(_hof(HOF_3), _resnet),
        "deep": _hof(HOF_3, hidden=DEEP),
        "tanh": _hof(HOF_3, activation="tanh"),
    },
    (
        Claim("A ResNet18 encoder is competitive", "ResNet18 encoder", "base, HOF-3"),
        Claim("A deeper function is competitive", "deep", "base, HOF-3"),
        Claim("tanh is slightly worse than ReLU", "base, HOF-3", "tanh", "lower"),
    ),
    {
        "base, HOF-3": (1.480, 1.014),
        "ResNet18 encoder": (1.529, 0.989),
        "deep": (1.499, 0.998),
        "tanh": (1.652, 1.066),
    },
)
DOMAINS: Final = Suite(
    3,
    "Sampling domains",
    "HOF-3 with k = 1 on canonical points from the ball, its surface, the ball in four dimensions, and the cube.",
    {name: _hof(HOF_3, domain) for name, domain in (("ball", "ball"), ("sphere", "sphere"))}  # type: ignore[arg-type]
    | {"4D ball": _hof(HOF_3, "ball4"), "cube": _hof(HOF_3, "cube")},
    (
        Claim("The sphere's surface is worse than the ball", "ball", "sphere", "lower"),
        Claim("The 4D ball is better than the ball", "4D ball", "ball", "lower"),
        Claim("The cube is as good as the ball", "cube", "ball"),
    ),
    {"ball": (1.480, 1.014), "sphere": (1.494, 1.263), "4D ball": (1.478, 0.912), "cube": (1.481, 0.999)},
)
POWERS: Final = Suite(
    4,
    "Values of k",
    "HOF-1 behind ResNet18, its function applied k times.",
    {f"k = {k}": _with_encoder(_hof(HOF_1, k=k), _resnet) for k in (1, 2, 3, 4)},
    tuple(Claim(f"k = {k} performs like k = 1", f"k = {k}", "k = 1") for k in (2, 3, 4)),
    {"k = 1": (1.635, 1.008), "k = 2": (1.574, 1.000), "k = 3": (1.601, 1.081), "k = 4": (1.655, 0.953)},
)
PROJECTION: Final = Suite(
    5,
    "Projection regularization",
    f"HOF-3 with k = 1. lambda is {LAMBDA}; travel penalizes the squared distance between f(x) and x, nearest that "
    "between f(x) and the true point nearest to x. The figure travel is the mean distance between f(x) and x.",
    {"none": _hof(HOF_3), "travel": _regularized("travel"), "nearest": _regularized("nearest")},
    (
        Claim("The regularization changes the quality little", "travel", "none"),
        Claim("Points travel less with it", "travel", "none", "lower", TRAVEL),
        Claim("The nearest-point form is too constraining: worse than travel", "travel", "nearest", "lower"),
    ),
)
PARTS: Final = Suite(
    6,
    "Parts of theta",
    "HOF-3 with k = 1, of whose theta only a part depends on the image. The first of them is a latent vector that is "
    "concatenated at the first layer.",
    {
        "biases of the first layer": _predicting("first_bias"),
        "all biases": _predicting("biases"),
        "first layer": _predicting("first_layer"),
        "all of theta": _predicting("all"),
    },
    (
        Claim("All biases are better than the first layer's", "all biases", "biases of the first layer", "lower"),
        Claim("The first layer is better than its biases", "first layer", "biases of the first layer", "lower"),
        Claim("All of theta is better than all biases", "all of theta", "all biases", "lower"),
        Claim("All of theta is better than the first layer", "all of theta", "first layer", "lower"),
    ),
)
FRAME: Final = Suite(
    10,
    "Viewer-centered frame",
    "HOF-3 with k = 1, trained and measured on clouds in the object's frame, or turned into that of the camera by "
    "azimuth and elevation.",
    {"object frame": _framed("object"), "camera frame": _framed("camera")},
    (
        Claim("The camera's frame is better", "camera frame", "object frame", "lower"),
        Claim(f"It is better for boxy objects ({', '.join(BOXY)})", "camera frame", "object frame", "lower", CD, BOXY),
    ),
    {"object frame": (1.534, 1.046), "camera frame": (1.486, 0.979)},
)
PICTURED: Final = "projection"
SUITES: Final[dict[str, Suite]] = {
    "table1": TABLE_1,
    "architecture": ARCHITECTURE,
    "domains": DOMAINS,
    "powers": POWERS,
    "projection": PROJECTION,
    "parts": PARTS,
    "frame": FRAME,
}
