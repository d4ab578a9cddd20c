"""Cost of a method: its decoder's size, and median milliseconds on one core."""

import statistics
import time
from collections.abc import Callable
from typing import Final

import numpy as np
import torch
from torch import nn

from model.config import TrainConfig
from model.evaluation.evaluate import PREDICTED_POINTS, draw
from model.evaluation.records import Decoder
from model.networks.atlasnet import AtlasNet
from model.networks.decoders import Hof
from model.networks.fixed_features import FixedFeatures
from model.training.checkpoints import predictor
from service.encoding.encoder import Encoder

REPEATS: Final = 50


def median_ms(call: Callable[[], object], repeats: int = REPEATS) -> float:
    """Return the median milliseconds of a call, after one warm-up call."""
    call()
    times = []
    for _ in range(repeats):
        started = time.perf_counter()
        call()
        times.append(time.perf_counter() - started)
    return round(1000 * statistics.median(times), 2)


def encoder_ms(data: bytes) -> float:
    """Return the milliseconds of one image through an ONNX file, onnxruntime on one thread."""
    return median_ms(Encoder(data, threads=1).warm_up)


def mapping_decoder(encoder: Encoder) -> Decoder:
    """Measure the mapping function, applied k times, as the service samples it."""
    spec = encoder.spec
    gray = np.full((1, 3, encoder.framing.size, encoder.framing.size), 0.5, np.float32)
    theta = encoder.encode(gray)[0].theta
    return Decoder(spec.size, len(spec.hidden) + 1, median_ms(lambda: draw(spec, theta)))


def network_decoder(network: nn.Module, config: TrainConfig) -> Decoder:
    """Measure a trained network's decoder in torch on one thread, canonical points included."""
    images = np.ones((1, 3, config.framing.size, config.framing.size), np.float32)
    before = "encoder" if isinstance(network, Hof) else "trunk"
    part = network.get_submodule(before)
    with torch.no_grad():
        setattr(network, before, FixedFeatures(part(torch.from_numpy(images))))
    predict, threads = predictor(network, config), torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        ms = median_ms(lambda: predict(images, PREDICTED_POINTS, 0))
    finally:
        torch.set_num_threads(threads)
        setattr(network, before, part)
    if isinstance(network, Hof):
        return Decoder(config.spec.size, len(config.spec.hidden) + 1, ms)
    own = [(name, part) for name, part in network.named_modules() if not name.startswith(("trunk", "code"))]
    layers = sum(isinstance(part, nn.Linear) for _, part in own)
    size = sum(p.numel() for name, p in network.named_parameters() if not name.startswith(("trunk", "code")))
    return Decoder(size, network.depth if isinstance(network, AtlasNet) else layers, ms)
