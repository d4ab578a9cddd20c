"""Export a matte network to an ONNX file, compressed and checked as an encoder is (`model.export`)."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import torch
from onnx import helper
from torch import Tensor, nn

from model.export import PARITY_IMAGES, TOLERANCE, halve, round_matrices, to_onnx
from model.networks.matte import MatteNetwork
from service.encoding.matting import INPUT, OUTPUT
from service.encoding.network import open_session
from service.files import whole_file


class _Matte(nn.Module):
    """The network with its matte in [0, 1] in place of logits."""

    def __init__(self, network: MatteNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, image: Tensor) -> Tensor:
        logits: Tensor = self.network(image)
        return logits.sigmoid()


@torch.no_grad()
def export_matte(network: MatteNetwork, size: int, card: dict[str, Any], output: Path) -> float:
    """Write `output`, whole or not at all; return the largest difference of torch and onnxruntime on random images.

    Raises
    ------
    ValueError : the difference is above TOLERANCE.
    """
    round_matrices(network)
    whole = _Matte(network).eval()
    graph = halve(to_onnx(whole, size, OUTPUT))
    helper.set_model_props(graph, {"hof.card": json.dumps(card, ensure_ascii=False)})
    data = graph.SerializeToString()
    images = np.random.default_rng(0).random((PARITY_IMAGES, 3, size, size), np.float32)
    mattes = open_session(data, threads=1).run([OUTPUT], {INPUT: images})[0]
    difference = float(np.abs(mattes - whole(torch.from_numpy(images)).numpy()).max())
    if difference > TOLERANCE:
        raise ValueError(f"torch and onnxruntime disagree by {difference}, the limit is {TOLERANCE}")
    output.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(output) as file:
        file.write(data)
    return difference
