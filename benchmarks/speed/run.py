"""`make bench`: measure everything, write benchmarks/RESULTS.md and benchmarks/runtime.png.

One process on one core; whatever is compared runs in turn, and ratios are medians over the rounds. Every
time includes drawing the canonical points, by the same generator for all.
"""

import argparse
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import torch

from benchmarks.speed import bulk, clients, photos, serving
from benchmarks.speed.networks import Network, deepsdf, foldingnet, mapping_network
from benchmarks.speed.page import Report, draw_runtime
from benchmarks.speed.rivals import RIVALS, Evaluate, Make, numpy_tiles
from benchmarks.speed.timing import TILES, Seconds, best_tile, in_turn, pin, ratio, seconds
from benchmarks.targets import Target
from service.mapping import compiled, folding
from service.mapping.canonical import canonical_points
from service.mapping.sampler import CHUNK, sample
from service.mapping.spec import HOF_1, HOF_3, MappingSpec, initial_theta

FOLDER: Final = Path(__file__).resolve().parents[1]
TANH: Final = replace(HOF_1, name="HOF-1 with tanh", activation="tanh")
SPECS: Final = (HOF_1, HOF_1.with_k(2), HOF_3, TANH)
SIZES: Final = (100, 1_000, 10_000, 100_000, 1_000_000)
DECODER_POINTS: Final = 100_000
OTHERS_POINTS: Final = 100_000  # of networks that are not folded
FUSED_OPS: Final = 7  # vector operations per 16 point-hidden pairs: 3 + 3 fused multiply-adds, one maximum
OURS, PLAIN = "ours", "ours, NumPy alone"
PEAK, SIDE = "peak", 2048  # a square matrix product
WHOLE, PLAIN_WHOLE = "ours, not folded", "ours, NumPy alone, not folded"


def main() -> int:
    """Measure and write. `--quick` tries the program; its figures mean nothing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--quick", action="store_true", help="few points, few ways: to see that it runs")
    parser.add_argument("-o", "--output", type=Path, default=FOLDER)
    arguments = parser.parse_args()
    core = pin()
    torch.set_num_threads(1)
    report = Report(arguments.rounds)
    _sampler_table(report, arguments.rounds, arguments.quick)
    _decoder_table(report, arguments.rounds, arguments.quick, arguments.output)
    if not arguments.quick:
        _serving_table(report, core, arguments.rounds)
        _photos_table(report, core, arguments.rounds)
        report.points_in_clients(clients.measure(core, arguments.rounds))
    report.write(arguments.output / "RESULTS.md")
    print((arguments.output / "RESULTS.md").read_text("utf-8"), end="")
    return 0


def ours(spec: MappingSpec, *, compiles: bool = True, folded: bool = True) -> Callable[[int], None]:
    """Return the service's sampler as users call it: n -> all points drawn, mapped and dropped."""
    theta = initial_theta(spec)
    kernel = compiled.load() if compiles else None
    begin = folding.FROM if folded else sys.maxsize

    def run(n: int) -> None:
        loaded, start = compiled.load, folding.FROM
        vars(compiled).update(load=lambda: kernel)  # mock.patch takes as long as a hundred points
        vars(folding).update(FROM=begin)
        try:
            for _ in sample(spec, [theta] * spec.k, n):
                pass
        finally:
            vars(compiled).update(load=loaded)
            vars(folding).update(FROM=start)

    return run


def rival(evaluate: Evaluate, width: int) -> Callable[[int], None]:
    """Return a rival: the same canonical points in the same chunks, then its own evaluation."""

    def run(n: int) -> None:
        for start in range(0, n, CHUNK):
            points = canonical_points("ball", min(CHUNK, n - start), offset=start)
            evaluate(np.ascontiguousarray(points[:, :width]))

    return run


def _sampler_table(report: Report, rounds: int, quick: bool) -> None:
    sizes = SIZES[:2] if quick else SIZES
    for spec in SPECS[:1] if quick else SPECS:
        network = mapping_network(spec, initial_theta(spec))
        ways = {OURS: ours(spec), PLAIN: ours(spec, compiles=False)}
        if spec.is_one_relu_layer:
            ways[WHOLE] = ours(spec, folded=False)
            ways[PLAIN_WHOLE] = ours(spec, compiles=False, folded=False)
        tiles = {}
        for name, make in RIVALS.items():
            if quick and name not in ("naive NumPy", "onnxruntime"):
                continue
            tile, evaluate = best_tile(make, network, (1024,) if make is RIVALS["naive NumPy"] else _tiles(quick))
            tiles[name] = tile
            ways[name] = rival(evaluate, 3)
        times = {n: in_turn({name: _at(way, n) for name, way in ways.items()}, rounds) for n in sizes}
        report.sampler(network.name, times, tiles)
        if not spec.is_one_relu_layer:
            report.targets += _beside_the_best_rival(spec, times[OTHERS_POINTS])
        if spec is HOF_1:
            runs = {name: _at(ways[name], sizes[-1]) for name in (OURS, WHOLE, PLAIN, PLAIN_WHOLE)}
            _judge_sampler(report, times[sizes[-1]])
            report.targets += [_ahead(times[n], n) for n in sizes]
            _roofline(report, network, in_turn(runs | {PEAK: _square_product()}, rounds), sizes[-1])


def _judge_sampler(report: Report, times: dict[str, Seconds]) -> None:
    """Compare with the targets of HOF-1, k = 1 at the largest n."""
    rivals = [name for name in times if name in RIVALS and name != "naive NumPy"]
    best = min(rivals, key=lambda name: float(np.median(times[name])))
    report.targets += [
        Target(f"HOF-1, k = 1, NumPy alone against the best rival ({best})", ratio(times[best], times[PLAIN]), 1.8),
        Target("HOF-1, k = 1, NumPy alone against naive NumPy", ratio(times["naive NumPy"], times[PLAIN]), 15),
        Target("HOF-1, k = 1 against NumPy alone", ratio(times[PLAIN], times[OURS]), 2),
    ]


def _beside_the_best_rival(spec: MappingSpec, times: dict[str, Seconds]) -> list[Target]:
    """Compare a network that is not folded with the best rival, with the kernel and without."""
    best = _best_rival(times)
    name = f"{spec.name}, k = {spec.k}"
    return [
        Target(f"{name} against the best rival ({best})", ratio(times[best], times[OURS]), 2),
        Target(f"{name}, NumPy alone against the best rival ({best})", ratio(times[best], times[PLAIN]), 1.2),
    ]


def _best_rival(times: dict[str, Seconds]) -> str:
    return min((name for name in times if name in RIVALS), key=lambda name: float(np.median(times[name])))


def _ahead(times: dict[str, Seconds], n: int) -> Target:
    """Compare a plain installation with the best rival, which has packed its weights before."""
    best = _best_rival(times)
    return Target(f"HOF-1, k = 1 against the best rival ({best}), n = {n:,}", ratio(times[best], times[OURS]), 1)


def _roofline(report: Report, network: Network, times: dict[str, Seconds], n: int) -> None:
    """Compare the service's ways with the core's float32 peak, which runs in turn with them."""
    peak = 2 * SIDE**3 / float(np.median(times.pop(PEAK)))
    fused_limit = peak / 2 / (FUSED_OPS * len(network.layers[0].w))  # a fused multiply-add is two operations
    rates = {name: n / float(np.median(took)) for name, took in times.items()}
    report.targets.append(Target("stretch: share of the fused limit", rates[OURS] / fused_limit, 0.75))
    report.roofline(peak, fused_limit, rates, network.flops)


def _square_product() -> Callable[[], None]:
    """Return a matrix product that reaches the core's peak."""
    a = np.random.default_rng(0).random((SIDE, SIDE), np.float32)
    out = np.empty_like(a)

    def run() -> None:
        np.matmul(a, a, out=out)

    return run


def _decoder_table(report: Report, rounds: int, quick: bool, output: Path) -> None:
    """Measure the paper's runtime figure: time over n of HOF and of the decoders, each in its best form."""
    ways = {f"HOF-1, k = {k}": ours(HOF_1.with_k(k)) for k in (1, 2)}
    ways |= {f"HOF-1, k = {k}, NumPy alone": ours(HOF_1.with_k(k), compiles=False) for k in (1, 2)}
    ways["HOF-3"] = ours(HOF_3)
    forms = {}
    for network in (deepsdf(), foldingnet()):
        form, evaluate = _best_form(network, quick)
        forms[network.name] = (form, network.parameters)
        ways[network.name] = rival(evaluate, network.layers[0].w.shape[1])
    sizes = (1_000, 2_000) if quick else (1_000, 3_000, 10_000, 30_000, DECODER_POINTS)
    times = {n: in_turn({name: _at(way, n) for name, way in ways.items()}, min(rounds, 5)) for n in sizes}
    report.decoders(times, forms)
    draw_runtime(times, output / "runtime.png")
    at = times[sizes[-1]]
    for name, limit in (("HOF-1, k = 1, NumPy alone", 50), ("HOF-1, k = 1", 120)):
        report.targets.append(
            Target(f"{name} against DeepSDF, n = {sizes[-1]:,}", ratio(at["DeepSDF"], at[name]), limit)
        )


def _best_form(network: Network, quick: bool) -> tuple[str, Evaluate]:
    """Return the fastest way to compute a decoder, with its best tile."""
    makes: dict[str, Make] = {"NumPy tiles": numpy_tiles, **RIVALS}
    if quick:
        makes = {"NumPy tiles": numpy_tiles}
    x = canonical_points("ball", 8192)[:, : network.layers[0].w.shape[1]].copy()
    candidates = []
    for name, make in makes.items():
        tile, evaluate = best_tile(make, network, _tiles(quick))
        candidates.append((min(seconds(lambda e=evaluate: e(x)) for _ in range(3)), f"{name}, {tile} points", evaluate))  # type: ignore[misc]
    _, form, evaluate = min(candidates, key=lambda candidate: candidate[0])
    return form, evaluate


def _serving_table(report: Report, core: int, rounds: int) -> None:
    figures = serving.measure(core, rounds)
    report.serving(figures)
    report.targets += [
        Target("HTTP, 1 M points as PLY: share of the bare sampler", ratio(figures.bare_s, figures.http_s), 0.7),
        Target("HTTP: extra memory for 10 M points, MiB", figures.extra_bytes / serving.MIB, 16, at_most=True),
    ]
    for name in ("ply", "npy", "xyz", "f32", "pcd"):
        first_ms = 1000 * figures.first_byte_s[name]
        report.targets.append(
            Target(f"HTTP: first byte of 1 M points as {name.upper()}, ms", first_ms, 20, at_most=True)
        )


def _photos_table(report: Report, core: int, rounds: int) -> None:
    """Measure photos over HTTP, and many photos without a server."""
    figures, many = photos.measure(core, rounds), bulk.measure(core, rounds)
    report.photos_over_http(figures)
    report.many_photos(many)
    report.targets += [
        Target("HTTP: a repeated photo against /health/live, calls/s", ratio(figures.live_s, figures.repeat_s), 0.5),
        Target(
            "HTTP: processor time of a new photo over the encoder's",
            ratio(figures.new_s, figures.encode_s),
            1.7,
            at_most=True,
        ),
        Target("hof serve: s until it is ready", float(np.median(figures.ready_s)), 1.5, at_most=True),
        Target("hof serve: resident memory idle, MiB", figures.idle_bytes / serving.MIB, 250, at_most=True),
        Target("encode-many: one process against a plain loop", ratio(many.loop, many.one), 0.9),
    ]
    if many.two is not None:
        report.targets.append(Target("encode-many: two processes against one", ratio(many.one, many.two), 1.8))


def _tiles(quick: bool) -> tuple[int, ...]:
    return (256,) if quick else TILES


def _at(way: Callable[[int], None], n: int) -> Callable[[], None]:
    return lambda: way(n)


if __name__ == "__main__":
    sys.exit(main())
