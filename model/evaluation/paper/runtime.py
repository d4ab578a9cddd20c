"""Experiment 7: time to map n canonical points, of HOF and of the decoders it is compared with (paper, section 4.2).

Image encoders are left out, as in the paper: theta and latent codes are there. All networks run in torch, float32, with
random weights. On the CPU it is the processor time of the process, which other work on the machine hardly changes; on a
GPU the time until the device has finished. Needs torch and NumPy alone.
"""

import time
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
import torch
from torch import Tensor, nn

from model.config import COMPARED_METHODS, EncoderConfig, TrainConfig
from model.evaluation.paper.record import PaperRecord, Trial, rounded
from model.networks.decoders import make_network
from model.networks.fixed_features import FixedFeatures
from model.provenance import provenance
from service.encoding.framing import Framing
from service.mapping.canonical import canonical_points

EXPERIMENT: Final = "runtime"
REPEATS: Final = 7
CHUNK: Final = 10_000  # points at once
COUNTS: Final[Mapping[str, tuple[int, ...]]] = {
    "cpu": (100, 1_000, 10_000, 100_000),
    "cuda": (100, 1_000, 10_000, 100_000, 1_000_000),
}
LEFT_OUT: Final = ("direct", "atlasnet_sphere")  # 1,024 points, whatever n; AtlasNet is timed with 25 patches
TINY: Final = EncoderConfig(feature_maps=(4, 4, 4), convolutions=1, fully_connected=(8,), rank=0)


def measure_runtime(device: str, seed: int = 0, counts: tuple[int, ...] | None = None) -> PaperRecord:
    """Time all networks on "cpu" or "cuda" for each count of points, REPEATS times in turn."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    counts = counts or COUNTS[device]
    try:
        calls = {name: mapper(config, torch.device(device)) for name, config in configs().items()}
        times: dict[str, dict[str, list[float]]] = {name: {str(n): [] for n in counts} for name in calls}
        for n in counts:
            points = {
                name: torch.from_numpy(canonical_points(config.spec.domain, n, seed)).unsqueeze(0).to(device)
                for name, config in configs().items()
            }
            for repeat in range(REPEATS + 1):
                for name, call in calls.items():
                    spent = elapsed_ms(call, points[name], device)
                    if repeat:  # the first warms up
                        times[name][str(n)].append(spent)
    finally:
        torch.set_num_threads(threads)
    trials = [Trial(name, {n: rounded(values) for n, values in columns.items()}) for name, columns in times.items()]
    hardware = torch.cuda.get_device_name() if device == "cuda" else "one thread"
    setting = {"device": device, "hardware": hardware, "counts": list(counts), "repeats": REPEATS, "chunk": CHUNK}
    setting["torch"] = torch.__version__
    ids = [str(repeat) for repeat in range(REPEATS)]
    return PaperRecord(experiment_of(device), setting, provenance(seed), ids, ["repeat"] * REPEATS, trials)


def experiment_of(device: str) -> str:
    """Return the record's name for a device: each has its own."""
    return EXPERIMENT if device == "cpu" else f"{EXPERIMENT}-{device}"


def configs() -> dict[str, TrainConfig]:
    """Return the config of each timed network."""
    common = TrainConfig(encoder=TINY, framing=Framing(32))
    return {each.name: each.config(common) for each in COMPARED_METHODS if each.method not in LEFT_OUT}


def mapper(config: TrainConfig, device: torch.device) -> Callable[[Tensor], None]:
    """Return a function that maps canonical points (1, n, d), CHUNK at a time, its image encoded before."""
    torch.manual_seed(0)
    network: nn.Module = make_network(config).eval().to(device)
    image = torch.ones(1, 3, 32, 32, device=device)
    before = "encoder" if config.method == "hof" else "trunk"
    with torch.no_grad():
        setattr(network, before, FixedFeatures(network.get_submodule(before)(image)))

    @torch.no_grad()
    def call(canonical: Tensor) -> None:
        for part in canonical.split(CHUNK, dim=1):  # type: ignore[no-untyped-call]
            network(image, part)

    return call


def elapsed_ms(call: Callable[[Tensor], None], points: Tensor, device: str) -> float:
    """Return the milliseconds of a call."""
    if device == "cuda":
        torch.cuda.synchronize()
        start = time.perf_counter()
        call(points)
        torch.cuda.synchronize()
        return 1000 * (time.perf_counter() - start)
    start = time.process_time()
    call(points)
    return 1000 * (time.process_time() - start)


def median(trial: Trial, n: int) -> float:
    """Return the median milliseconds of a network for n points."""
    return float(np.median(trial.column(str(n))))
