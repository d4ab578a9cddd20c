"""Everything that decides a training run; a checkpoint stores the config that made it."""

from dataclasses import asdict, dataclass, field, replace
from typing import Any, Final, Literal

from service.encoding.framing import Framing
from service.mapping.spec import HOF_1, MappingSpec

Method = Literal["hof", "deepsdf", "foldingnet", "direct"]


@dataclass(frozen=True)
class EncoderConfig:
    """The image encoder g_phi (paper, appendix: Network Architecture and Training).

    feature_maps, convolutions : of the DenseNet's blocks.
    fully_connected : widths of the layers behind the trunk.
    rank : width of a bottleneck with LayerNorm before the layer that outputs theta; 0 is the paper's
        full-rank layer (a 50 MB file for HOF-1, trainable and exportable).
    trunk : the paper's DenseNet, or the convolutions of EfficientNet-Lite0 as ImageNet taught it.
    """

    feature_maps: tuple[int, ...] = (16, 32, 64)
    convolutions: int = 4  # per dense block
    fully_connected: tuple[int, ...] = (1024, 1024, 1024)
    rank: int = 256
    trunk: Literal["dense", "lite0"] = "dense"
    frozen: int = 3  # blocks of Lite0 that are not trained
    joined_maps: int = 96  # what Lite0's last maps are brought down to
    fine_maps: int = 0  # and those of half their stride, which tell better where things are


DENSE: Final = EncoderConfig()
LITE0: Final = EncoderConfig(trunk="lite0", fully_connected=(1024,), fine_maps=16)


@dataclass(frozen=True)
class TrainConfig:
    """One training run.

    method : what stands behind the image encoder's trunk: HOF, or a decoder it is compared with
        (`model.networks.decoders`). Of `spec`, a decoder uses the canonical domain only.
    points, target_points : predicted and true points per object in the loss.
    minutes : budget; the learning rate falls to 0 over it along a cosine.
    steps : budget in steps instead, for methods that are compared.
    late_from : share of the budget after which `late_chamfer` takes the place of the squared loss, on
        `late_points` and `late_target_points`; 1 is never.
    variants : draw from the stretched shapes too, not from the data set's own alone.
    own_share : of an object's draws, set aside for its own shape; the rest is from all views, its variants' included.
    made : draw from the furniture made by rule too.
    pretrained_rate : share of the learning rate that a pretrained trunk has.
    start : checkpoint or exported encoder whose weights the run starts from: for another spec those of its trunk, for
        another trunk those of its head; None starts anew.
    """

    spec: MappingSpec = field(default_factory=lambda: HOF_1.with_k(2))
    method: Method = "hof"
    encoder: EncoderConfig = field(default_factory=EncoderConfig)
    framing: Framing = field(default_factory=Framing)
    seed: int = 0
    batch: int = 32
    points: int = 768
    target_points: int = 1_500
    learning_rate: float = 7e-4
    pretrained_rate: float = 0.3
    weight_decay: float = 1e-2
    gradient_clip: float = 1.0
    projection: float = 0.0  # lambda of the projection regularisation (paper, eq. 6)
    minutes: float = 70.0
    steps: int | None = None
    late_from: float = 1.0
    late_points: int = 1_536
    late_target_points: int = 10_000
    variants: bool = False
    own_share: float = 0.0
    made: bool = False
    start: str | None = None

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON-able values; inverse of `from_dict`."""
        return asdict(self)

    @classmethod
    def from_dict(cls, fields: dict[str, Any]) -> "TrainConfig":
        """The config of a checkpoint."""
        encoder = {**fields["encoder"]}
        for key in ("feature_maps", "fully_connected"):
            encoder[key] = tuple(encoder[key])
        spec = {**fields["spec"], "hidden": list(fields["spec"]["hidden"])}
        return replace(
            cls(**fields),
            spec=MappingSpec.from_dict(spec),
            encoder=EncoderConfig(**encoder),
            framing=Framing(**fields["framing"]),
        )
