"""The configuration of a network that trains in seconds."""

from model.config import EncoderConfig, TrainConfig
from service.encoding.framing import Framing
from service.mapping.spec import MappingSpec

ENCODER = EncoderConfig(feature_maps=(4, 4, 4), convolutions=1, fully_connected=(32,), rank=8)
CONFIG = TrainConfig(spec=MappingSpec("small", 3, (32,), 3, k=2), encoder=ENCODER, framing=Framing(size=32), batch=8)
