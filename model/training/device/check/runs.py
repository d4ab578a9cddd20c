"""Whole runs on a device: steps as a graph are the steps taken kernel by kernel, and a run in two pieces works."""

import json
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import torch
from torch import Tensor, nn

from model.config import LITE0, DeviceOptions, TrainConfig
from model.data.packed.options import IMAGENET
from model.data.packed.shards import PackedShape, Row, quantize, write_shard
from model.data.packed.strips import encode_strip
from model.networks.lite0 import Lite0
from model.training.checkpoints import load_network
from model.training.device.data import load_data
from model.training.device.draws import Draws
from model.training.device.loop import train_on_device
from model.training.device.steps import Steps
from model.training.state import RunState
from service.encoding.framing import Framing

OBJECTS, VIEWS, POINTS = 48, 16, 3_000
STEPS: Final = 8  # compared; WARM_STEPS of them before the capture
UPDATE_LIMIT: Final = 0.3  # relative: sums in bfloat16 come in any order, other random numbers give about 1
CONFIG: Final = TrainConfig(
    encoder=replace(LITE0, frozen=0),
    framing=Framing(64),
    batch=32,
    images=3_200,
    late_from=0.5,
    late_target_points=POINTS,
)


def check_runs(device: torch.device) -> tuple[str, bool]:
    """Return a Markdown table of what was checked, and whether all of it holds."""
    lines, holds = ["| run | result | limit |", "|---|---|---|"], True
    with tempfile.TemporaryDirectory() as folder:
        write_random(Path(folder))
        options = DeviceOptions(device="cuda" if device.type == "cuda" else "cpu", packed=folder, workers=2)
        for name, value, limit in (*_graph_difference(options), *_pieces(options, Path(folder) / "run")):
            lines.append(f"| {name} | {value:.3g} | {limit:.3g} |")
            holds &= value <= limit
    return "\n".join(lines) + "\n", holds


def write_random(folder: Path) -> None:
    """Write a packed data set of ellipsoids whose pictures show their sides, and a pretrained trunk that is not."""
    torch.save(Lite0(frozen=0).state_dict(), folder / IMAGENET)
    rng = np.random.default_rng(0)
    size = CONFIG.framing.size
    y, x = np.mgrid[-1 : 1 : size * 1j, -1 : 1 : size * 1j]
    shapes = []
    for number in range(OBJECTS):
        sides = rng.uniform(0.2, 1, 3)
        sides /= sides.max()
        views = np.zeros((VIEWS, size, size, 4), np.uint8)
        inside = (x / sides[0]) ** 2 + (y / sides[1]) ** 2 < 0.7
        views[:, inside] = [*(255 * sides).astype(int), 255]
        points = rng.normal(size=(POINTS, 3))
        points *= sides / 2 / np.linalg.norm(points, axis=1, keepdims=True)
        split = "val" if number < 4 else "train"
        row = Row(f"{number}", f"{number}", "random", split, 0, tuple(range(VIEWS)), POINTS, colored=False)
        packed = quantize(points.astype(np.float32))
        shapes.append(PackedShape(row, encode_strip(views, None), packed, np.zeros_like(packed, np.uint8)))
    with (folder / "shard-000.npz").open("wb") as file:
        write_shard(file, shapes, {})


def _graph_difference(options: DeviceOptions) -> Iterator[tuple[str, float, float]]:
    """Compare the weights' way over STEPS as a graph with that of steps kernel by kernel, and with itself."""
    ways, loaded = [], load_data(Path("none"), CONFIG, options)
    for graphs in (False, True):
        state = RunState(CONFIG, loaded.train.images.device)
        before = _weights(state.network)
        steps = Steps(state, Draws(loaded.train, loaded.grounds, CONFIG), graphs)
        for _ in range(STEPS):
            steps.take()
        steps.mean_loss()
        ways.append(_weights(state.network) - before)
    eager, graph = ways
    yield (
        "graph against kernel by kernel: updates differ by",
        float((graph - eager).norm() / eager.norm()),
        UPDATE_LIMIT,
    )


def _weights(network: nn.Module) -> Tensor:
    return torch.cat([weight.detach().flatten().double().cpu() for weight in network.parameters()])


def _pieces(options: DeviceOptions, run: Path) -> Iterator[tuple[str, float, float]]:
    """Train in two pieces with checkpoints in parts, and see the loss fall."""
    start, in_parts = time.monotonic(), replace(options, checkpoint_parts=True)
    train_on_device(Path("none"), run, CONFIG, replace(in_parts, stop_after=1e-3))
    cut = json.loads((run / "log.jsonl").read_text().splitlines()[-1])["step"]
    chosen = train_on_device(Path("none"), run, CONFIG, in_parts)
    records = [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]
    steps = CONFIG.images // CONFIG.batch if CONFIG.images else 0
    yield "first piece: steps taken", cut, steps - 1
    yield "both pieces: steps lacking", steps - records[-1]["step"], 0
    vals = [record["val"] for record in records if "val" in record]
    yield "validation loss, last against first", vals[-1] / vals[0], 0.9
    network, _, _ = load_network(chosen)
    broken = sum(int((~torch.isfinite(weight)).sum()) for weight in network.state_dict().values())
    yield f"chosen checkpoint, read on the CPU: numbers not finite (all in {time.monotonic() - start:.0f} s)", broken, 0
    largest = max(path.stat().st_size for path in run.iterdir())
    yield "largest file of the run, MB", largest / 1e6, 15
