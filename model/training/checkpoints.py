"""Read a run's checkpoints: the network, the encoder alone, or any method as a function of images."""

from collections.abc import Callable
from pathlib import Path
from pickle import UnpicklingError
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import torch
from torch import nn

from model.config import TrainConfig
from model.networks.decoders import Hof, make_network
from model.networks.encoder import ImageEncoder, channels_last
from model.training.parts import has_checkpoint, load_checkpoint
from service.mapping.canonical import canonical_points

Floats = npt.NDArray[np.float32]
Predictor = Callable[[Floats, int, int], Floats]

CHUNK: Final = 10_000  # points that a predictor computes at once


def chosen_checkpoint(run: Path) -> Path:
    """Return a run's best checkpoint on the validation split (F@1% + F@2%), or its last where none was chosen."""
    best = run / "best.pt"
    return best if has_checkpoint(best) else run / "last.pt"


def load_network(checkpoint: Path) -> tuple[nn.Module, TrainConfig, dict[str, Any]]:
    """Return the averaged network of a checkpoint in evaluation mode, its config, and `step` and `elapsed_s`.

    Both counts include the runs that it started from. An ONNX file of `model.export` is a checkpoint too, with
    matrices rounded to float16.

    Raises
    ------
    FileNotFoundError : no such checkpoint.
    InvalidModel : an ONNX file that is no image encoder.
    ValueError : no checkpoint, or an ONNX file without a config in its card or without all weights by name.
    """
    if checkpoint.suffix == ".onnx":
        return _read_exported(checkpoint)
    try:
        saved = load_checkpoint(checkpoint)
        config, weights = TrainConfig.from_dict(saved["config"]), saved["average"]
    except (UnpicklingError, RuntimeError, KeyError, TypeError, EOFError) as error:
        raise ValueError(f"{checkpoint} is no checkpoint of `hof-model train`: {error!r}") from None
    network = make_network(config)
    network.load_state_dict(weights)
    before = saved.get("before", {"step": 0, "elapsed_s": 0.0})  # a blend has none
    return network.eval(), config, {key: before[key] + saved[key] for key in ("step", "elapsed_s")}


def _read_exported(file: Path) -> tuple[nn.Module, TrainConfig, dict[str, Any]]:
    """Return the network that an ONNX file was exported from, by its weights and card."""
    import onnx  # not needed by runs from checkpoints, on machines that have neither
    from onnx import numpy_helper

    from service.encoding.encoder import Encoder

    card = Encoder.open(file, threads=1).card
    try:
        training = card["training"]
        config = TrainConfig.from_dict(training["config"])
    except (KeyError, TypeError) as error:
        raise ValueError(f"the card of {file} does not tell how it was trained: {error!r}") from None
    initializers = onnx.load(file).graph.initializer
    stored = {each.name.removesuffix(".float16"): numpy_helper.to_array(each) for each in initializers}
    is_colored = any(name.startswith("encoder.") for name in stored)
    network = make_network(config)
    weights = {}
    for name, value in network.state_dict().items():
        source = name if is_colored else name.removeprefix("encoder.")
        if source in stored:
            weights[name] = torch.from_numpy(stored[source].astype(np.float32))
        elif name.endswith("num_batches_tracked"):  # a counter that nothing reads
            weights[name] = value
        else:
            raise ValueError(f"{file} lacks {source}, perhaps merged with an equal weight: start from a .pt file")
    network.load_state_dict(weights)
    return network.eval(), config, {"step": training["steps"], "elapsed_s": 60 * training["minutes"]}


def load_encoder(checkpoint: Path) -> tuple[ImageEncoder, TrainConfig, dict[str, Any]]:
    """Return the image encoder of a HOF checkpoint; the rest as `load_network`.

    Raises
    ------
    FileNotFoundError : no such checkpoint.
    ValueError : the checkpoint's method has no theta.
    """
    network, config, run = load_network(checkpoint)
    if not isinstance(network, Hof):
        raise ValueError(  # noqa: TRY004 - a file of the wrong kind, not an argument of the wrong type
            f"{checkpoint} is a {config.method} network: only hof has an encoder to export"
        )
    return network.encoder, config, run


def predictor(network: nn.Module, config: TrainConfig) -> Predictor:
    """Return a function (images (b, 3, s, s) in [0, 1], n, seed) -> points (b, n, 3), float32, for any method.

    `direct` has 1,024 points of its own: it gives them in a seeded order, repeated where n is larger.
    """

    @torch.no_grad()
    def predict(images: Floats, n: int, seed: int) -> Floats:
        batch = channels_last(torch.from_numpy(images))
        canonical = torch.from_numpy(canonical_points(config.spec.domain, n, seed)).expand(len(images), -1, -1)
        if config.method == "direct":
            own: Floats = network(batch, canonical).numpy()
            return own[:, np.resize(np.random.default_rng(seed).permutation(own.shape[1]), n)]
        chunks = [network(batch, canonical[:, start : start + CHUNK]) for start in range(0, n, CHUNK)]
        points: Floats = torch.cat(chunks, dim=1).numpy()
        return points

    return predict
