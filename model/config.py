"""Everything that decides a training run. A checkpoint stores the config that produced it.

Each field is a flag of `hof-model train`, `hof-model color` or `hof-model heads`: defaults, limits and help live here
and nowhere else; `model.cli.flags` makes the flags from the fields.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, Final, Literal, TypeVar

from service.encoding.framing import Framing
from service.mapping.spec import HOF_1, HOF_3, Domain, MappingSpec

Method = Literal["hof", "deepsdf", "foldingnet", "direct", "atlasnet_sphere", "atlasnet_25"]
Trunk = Literal["dense", "lite0", "resnet18", "pointnet", "grid"]
Predicted = Literal["all", "first_layer", "biases", "first_bias"]
ProjectionForm = Literal["travel", "nearest"]
Frame = Literal["object", "camera"]
Device = Literal["auto", "cpu", "cuda"]
Part = TypeVar("Part")

POINT_TRUNKS: Final = ("pointnet", "grid")  # their input is points, not an image
METHOD_DOMAINS: Final[dict[str, Domain]] = {"foldingnet": "cube", "atlasnet_25": "cube", "atlasnet_sphere": "sphere"}


def option(
    default: object,
    text: str,
    *,
    least: float | None = None,
    above: float | None = None,
    most: float | None = None,
) -> Any:  # noqa: ANN401 - as dataclasses.field
    """Return a dataclass field with its help text and the limits of its flag.

    Parameters
    ----------
    least, most : smallest and largest value allowed.
    above : every value must exceed it, in place of `least`.
    """
    return field(default=default, metadata={"help": text, "least": least, "above": above, "most": most})


@dataclass(frozen=True)
class EncoderConfig:
    """The image encoder g_phi (paper, appendix: Network Architecture and Training)."""

    feature_maps: tuple[int, ...] = option((16, 32, 64), "feature maps of the DenseNet's blocks", least=1)
    convolutions: int = option(4, "convolutions of each dense block", least=1)
    fully_connected: tuple[int, ...] = option(
        (1024, 1024, 1024), "widths of the fully connected layers after the trunk", least=1
    )
    rank: int = option(256, "width of the bottleneck before theta; 0 is the paper's full rank, a 50 MB file", least=0)
    trunk: Trunk = option(  # noqa: RUF009 - a field
        "dense",
        "paper's DenseNet, its ResNet18, or EfficientNet-Lite0 trained on ImageNet; PointNet and grid, the DenseNet on "
        "a grid of cells, see points of a part of the surface in place of an image",
    )
    frozen: int = option(3, "first blocks of Lite0 that are not trained", least=0)
    joined_maps: int = option(96, "maps that Lite0's last maps are reduced to", least=1)
    fine_maps: int = option(0, "maps that Lite0's maps of half the stride are reduced to; 0: not used", least=0)
    predicted: Predicted = option(  # noqa: RUF009 - a field
        "all", "part of theta that depends on the image; the rest is learned, and the same for all images"
    )
    point_maps: tuple[int, ...] = option(
        (128, 256, 512, 1024), "maps of PointNet's four layers; its input is of 64 to 2,048 points", least=1
    )

    @property
    def takes_points(self) -> bool:
        """Return whether the encoder reads points, not an image."""
        return self.trunk in POINT_TRUNKS


DENSE: Final = EncoderConfig()
LITE0: Final = EncoderConfig(trunk="lite0", fully_connected=(1024,), fine_maps=16)
POINTNET: Final = EncoderConfig(trunk="pointnet", fully_connected=(1024,))
GRID: Final = EncoderConfig(trunk="grid", feature_maps=(32, 48, 64), fully_connected=(1024,))
LITE0_SIZE: Final = 128  # pixels


@dataclass(frozen=True)
class TrainConfig:
    """One training run.

    A compared method (`model.networks.decoders`) uses only the canonical domain of `spec`. A run that starts from a
    checkpoint takes from it, for another spec, the trunk's weights; for another trunk, the head's.
    """

    spec: MappingSpec = field(default_factory=lambda: HOF_1.with_k(2))
    method: Method = option("hof", "HOF, or the decoder behind the trunk it is compared with")  # noqa: RUF009 - a field
    encoder: EncoderConfig = field(default_factory=EncoderConfig)
    framing: Framing = field(default_factory=Framing)
    seed: int = option(0, "seed of initial weights, batches and augmentation", least=0)
    batch: int = option(32, "images per step", least=1)
    points: int = option(768, "predicted points per object in the loss", least=1)
    target_points: int = option(1_500, "true points per object in the loss", least=1)
    learning_rate: float = option(7e-4, "AdamW's learning rate after warm-up", least=0)
    pretrained_rate: float = option(0.3, "share of the learning rate for pretrained layers", least=0)
    weight_decay: float = option(1e-2, "AdamW's weight decay", least=0)
    gradient_clip: float = option(1.0, "largest norm of the gradients", above=0)
    projection: float = option(0.0, "lambda of the projection regularization (paper, eq. 6)", least=0)
    projection_form: ProjectionForm = option(  # noqa: RUF009 - a field
        "travel", "what it penalizes: how far points travel, or end from the true point nearest to their start"
    )
    minutes: float = option(64.0, "budget in minutes; the learning rate falls to 0 over the budget", above=0)
    steps: int | None = option(None, "budget in steps, instead of minutes", least=1)
    images: int | None = option(None, "budget in images, instead of minutes", least=1)
    late_from: float = option(
        1.0, "share of the budget after which the late loss, cd_epcg with a smooth F-score, applies; 1: never", least=0
    )
    late_points: int = option(1_536, "predicted points per object in the late loss", least=1)
    late_target_points: int = option(10_000, "true points per object in the late loss", least=1)
    frame: Frame = option("object", "frame of the points: the object's, or that of the camera")  # noqa: RUF009 - a field
    augmented: bool = option(default=True, text="change images as photographs differ, and mirror half of them")
    constant_rate: bool = option(default=False, text="keep the learning rate as it is: no warm-up, no decay")
    variants: bool = option(default=False, text="train on the variants of `hof-model data vary` too")
    own_share: float = option(
        0.0,
        "share of an object's draws reserved for its own shape, the rest being from all its shapes",
        least=0,
        most=1,
    )
    turn: float = option(
        0.0,
        "degrees about +Y, either way, by which objects of a point encoder are turned; 180: it needs no front",
        least=0,
        most=180,
    )
    stretch: float = option(
        1.0, "largest factor by which objects of a point encoder grow or shrink along each axis", least=1
    )
    made: bool = option(default=False, text="train on the procedural pieces of `hof-model data make` too")
    start: str | None = option(None, "checkpoint or exported model whose weights a new run starts from")

    def is_late(self, progress: float) -> bool:
        """Return whether the late loss applies at `progress` in [0, 1] of the budget."""
        return progress >= self.late_from

    def at(self, progress: float) -> "TrainConfig":
        """Return the config that a batch is drawn with at `progress` in [0, 1]: late batches have more points."""
        if not self.is_late(progress):
            return self
        return replace(self, points=self.late_points, target_points=self.late_target_points)

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON-able values; inverse of `from_dict`."""
        return asdict(self)

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> "TrainConfig":
        """Return the config of a checkpoint, of this version or another.

        Missing fields take their defaults. Unknown fields of the run are ignored: they tell how it was trained, not
        what its network is.

        Raises
        ------
        KeyError : the spec, the encoder or the framing is missing.
        TypeError : the encoder or the framing has an unknown field, which might change the network.
        """
        names = {each.name for each in fields(cls)}
        spec = {**stored["spec"], "hidden": list(stored["spec"]["hidden"])}
        return replace(
            cls(**{name: value for name, value in stored.items() if name in names}),
            spec=MappingSpec.from_dict(spec),
            encoder=_part(EncoderConfig, "encoder", stored),
            framing=_part(Framing, "framing", stored),
        )


@dataclass(frozen=True)
class ColorConfig:
    """Training of a color head. Each drawn batch is used for several steps: drawing it costs more than they do."""

    seed: int = option(0, "seed of initial weights, batches and augmentation", least=0)
    minutes: float = option(12.0, "budget in minutes; the learning rate falls to 0 over the budget", above=0)
    points: int = option(256, "canonical points per image in the loss", least=1)
    target_points: int = option(4_000, "true points per image that give the canonical points their colors", least=1)
    kept_batches: int = option(400, "latest batches kept for further steps, 17 kB an image", least=1)
    steps_per_batch: int = option(6, "steps for each drawn batch: one on it, the others on kept ones", least=1)
    learning_rate: float = option(1e-3, "AdamW's learning rate after warm-up", least=0)
    weight_decay: float = option(1e-2, "AdamW's weight decay", least=0)


@dataclass(frozen=True)
class HeadsConfig:
    """Training of the heads for the fit of the shape and the camera, on observations of a finished encoder."""

    seed: int = option(0, "seed of views, initial weights and batches", least=0)
    views: int = option(6, "views observed of each object", least=2)
    members: int = option(5, "confidences that are averaged, each trained without a share of the objects", least=1)
    epochs: float = option(12.0, "times that each image is used", above=0)
    batch: int = option(64, "images per step", least=1)
    learning_rate: float = option(1e-3, "AdamW's highest learning rate", above=0)
    weight_decay: float = option(1e-2, "AdamW's weight decay", least=0)


@dataclass(frozen=True)
class MatteConfig:
    """Training of the matte network."""

    seed: int = option(0, "seed of initial weights and pictures", least=0)
    minutes: float = option(50.0, "budget in minutes; the learning rate falls to 0 over the budget", above=0)
    size: int = option(192, "pixels of a picture's side, a multiple of 32", least=32)
    batch: int = option(32, "pictures per step", least=1)
    learning_rate: float = option(2e-3, "AdamW's learning rate after warm-up", above=0)
    pretrained_rate: float = option(0.5, "share of the learning rate for pretrained layers", least=0)
    weight_decay: float = option(1e-2, "AdamW's weight decay", least=0)


@dataclass(frozen=True)
class DistillConfig:
    """Training of an exported encoder to give the same answer with a background as over white."""

    seed: int = option(0, "seed of views and augmentation", least=0)
    minutes: float = option(35.0, "budget in minutes; the learning rate falls to 0 over the budget", above=0)
    batch: int = option(64, "images per step", least=1)
    learning_rate: float = option(3e-4, "AdamW's learning rate after warm-up", above=0)
    weight_decay: float = option(1e-2, "AdamW's weight decay", least=0)


@dataclass(frozen=True)
class DeviceOptions:
    """Device and manner of a run's training. None of it decides what is learned, so no checkpoint stores it."""

    device: Device = option("auto", "device to train on; auto: CUDA if there is one")  # noqa: RUF009 - a field
    packed: str | None = option(None, "folder of `hof-model data pack` to train from, in place of --data")
    graphs: bool = option(default=True, text="replay each step as one CUDA graph")
    compile: bool = option(default=False, text="compile convolutions and augmentation: quicker steps, a slower start")
    checkpoint_parts: bool = option(default=False, text="write checkpoints as files of at most 14 MB")
    stop_after: float | None = option(None, "minutes after which this call ends; a later call resumes the run", above=0)
    workers: int | None = option(None, "processes that decode a packed data set; default: one per core", least=1)


ON_CPU: Final = DeviceOptions(device="cpu")
PAPER_EPOCHS: Final = 4
PAPER_SCHEDULE: Final = TrainConfig(  # paper, appendix: Implementation Details; its budget depends on the data
    encoder=EncoderConfig(rank=0),
    batch=1,
    points=1_000,
    target_points=10_000,
    learning_rate=1e-5,
    weight_decay=0.0,
    gradient_clip=1e9,
    augmented=False,
    constant_rate=True,
)
COMPARED_RUN: Final = TrainConfig(  # common to the networks of `hof-model paper`
    steps=1_500, variants=True, late_from=0.5, late_points=1_024, late_target_points=4_000
)


@dataclass(frozen=True)
class ComparedMethod:
    """A method of the comparison (paper, Table 1), by its name in tables."""

    name: str
    method: Method
    spec: MappingSpec

    def config(self, common: TrainConfig) -> TrainConfig:
        """Return the config of the method that is `common` otherwise."""
        return replace(common, method=self.method, spec=self.spec)


def _decoder(name: str, method: Method) -> ComparedMethod:
    return ComparedMethod(name, method, replace(HOF_1, domain=METHOD_DOMAINS.get(method, "ball")))


COMPARED_METHODS: Final = (
    ComparedMethod("HOF-1", "hof", HOF_1),
    ComparedMethod("HOF-1, k = 2", "hof", HOF_1.with_k(2)),
    ComparedMethod("HOF-3", "hof", HOF_3),
    _decoder("DeepSDF", "deepsdf"),
    _decoder("FoldingNet", "foldingnet"),
    _decoder("direct decoder", "direct"),
    _decoder("AtlasNet, sphere", "atlasnet_sphere"),
    _decoder("AtlasNet, 25 patches", "atlasnet_25"),
)


def _part(kind: type[Part], name: str, stored: Mapping[str, Any]) -> Part:
    """Return the stored dataclass `name`; JSON's lists become tuples."""
    values = {key: tuple(value) if isinstance(value, list) else value for key, value in stored[name].items()}
    try:
        return kind(**values)
    except TypeError as error:
        raise TypeError(f"unusable {name} in the config, perhaps written by another version: {error}") from None
