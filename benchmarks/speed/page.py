"""benchmarks/RESULTS.md and the runtime figure."""

import os
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.speed import bulk, clients, photos
from benchmarks.speed.serving import LARGE, MIB, STREAMED, Figures
from benchmarks.speed.timing import Seconds
from benchmarks.targets import Target, targets_table
from model.provenance import provenance

SEED = 0
LINE_BITS_S = 20e6  # of a mobile connection


@dataclass
class Report:
    """Tables and figures of one run, to be written as a page."""

    rounds: int
    targets: list[Target] = field(default_factory=list)
    run: dict[str, str | int] = field(default_factory=lambda: provenance(SEED))  # before any file is written
    _sections: list[str] = field(default_factory=list)

    def sampler(self, name: str, times: dict[int, dict[str, Seconds]], tiles: dict[str, int]) -> None:
        """Add Mpoints/s of every way at every n."""
        ways = list(next(iter(times.values())))
        rows = [
            f"| {way} | {tiles.get(way, '')} | "
            + " | ".join(f"{n / np.median(row[way]) / 1e6:.2f}" for n, row in times.items())
            + " |"
            for way in ways
        ]
        head = f"| way | tile | {' | '.join(f'n = {n:,}' for n in times)} |\n|---|---|{'---|' * len(times)}"
        self._sections.append(f"## {name}: Mpoints/s, one core\n\n{head}\n" + "\n".join(rows))

    def roofline(self, peak: float, fused_limit: float, rates: dict[str, float], flops: int) -> None:
        """Add each way's share of the core's float32 peak."""
        rows = "\n".join(
            f"| {name} | {rate / 1e6:.2f} | {rate * flops / 1e9:.0f} | {rate * flops / peak:.0%} | "
            f"{rate / fused_limit:.0%} |"
            for name, rate in rates.items()
        )
        self._sections.append(
            f"## Roofline, HOF-1, k = 1\n\nThis core's float32 peak, by a 2048 x 2048 matrix product: {peak / 1e9:.0f} "
            f"GFLOP/s. The fused limit, 7 vector operations per 16 point-hidden pairs: {fused_limit / 1e6:.1f} "
            "Mpoints/s. Operations are counted as the whole network has them: a folded one does the same with fewer "
            "and may pass the limit.\n\n"
            f"| way | Mpoints/s | GFLOP/s | of the peak | of the fused limit |\n|---|---|---|---|---|\n"
            f"{rows}"
        )

    def decoders(self, times: dict[int, dict[str, Seconds]], forms: dict[str, tuple[str, int]]) -> None:
        """Add milliseconds over n of HOF and of the decoders."""
        best = "; ".join(f"{name} ({parameters:,} parameters): {form}" for name, (form, parameters) in forms.items())
        head = f"| network | {' | '.join(f'n = {n:,}' for n in times)} |\n|---|{'---|' * len(times)}"
        rows = [
            f"| {name} | " + " | ".join(f"{1000 * np.median(row[name]):.2f}" for row in times.values()) + " |"
            for name in next(iter(times.values()))
        ]
        self._sections.append(
            "## The paper's runtime figure: ms to draw n points, one core\n\n"
            f"The decoders in their best form: {best}. Their latent code is folded into the biases.\n\n{head}\n"
            + "\n".join(rows)
            + "\n\n![Time over the number of points](runtime.png)"
        )

    def serving(self, figures: Figures) -> None:
        """Add the figures that a client sees."""
        rate = STREAMED / float(np.median(figures.http_s)) / 1e6
        bare = STREAMED / float(np.median(figures.bare_s)) / 1e6
        first = "\n".join(f"| {name} | {1000 * took:.1f} |" for name, took in figures.first_byte_s.items())
        self._sections.append(
            "## HTTP over loopback, HOF-1, k = 2, server on one core\n\n"
            f"- {STREAMED:,} points as PLY: {rate:.2f} Mpoints/s; the bare sampler on that core: {bare:.2f}.\n"
            f"- Resident memory: {figures.idle_bytes / MIB:.0f} MiB idle, {figures.extra_bytes / MIB:.1f} MiB more at "
            f"the peak of streaming {LARGE:,} points.\n\n"
            f"| format | first byte, ms (n = {STREAMED:,}; JSON 100,000) |\n|---|---|\n{first}"
        )

    def photos_over_http(self, figures: photos.Figures) -> None:
        """Add the processor time of photos, and what a start takes."""
        rows = "\n".join(
            f"| {name} | {1000 * np.median(took):.2f} |"
            for name, took in (
                ("`GET /health/live`", figures.live_s),
                ("`POST /encode`, a repeated photo", figures.repeat_s),
                ("`POST /encode`, a new photo", figures.new_s),
                (f"the encoder alone, calls of {photos.CLIENTS} images", figures.encode_s),
            )
        )
        self._sections.append(
            "## Photos of 512 x 512 over HTTP, both shipped models\n\n"
            f"From the start to ready: {np.median(figures.ready_s):.1f} s; resident memory then: "
            f"{figures.idle_bytes / MIB:.0f} MiB.\n\n"
            f"| call | processor time, ms |\n|---|---|\n{rows}"
        )

    def many_photos(self, figures: bulk.Figures) -> None:
        """Add photos per second of `hof encode-many`."""
        ways = {"a plain loop": figures.loop, "one process": figures.one}
        ways |= {} if figures.two is None else {"two processes": figures.two}
        rows = "\n".join(f"| {name} | {1 / np.median(took):.1f} |" for name, took in ways.items())
        self._sections.append(
            f"## `hof encode-many`, {bulk.PHOTOS} photos of 512 x 512\n\n| way | photos/s |\n|---|---|\n{rows}"
        )

    def points_in_clients(self, figures: clients.Figures) -> None:
        """Add bytes and milliseconds of points that are downloaded, or drawn where they are needed."""
        ways = {
            "points, downloaded": (figures.points_bytes, figures.download_s),
            "weights, drawn in Node": (dict.fromkeys(figures.points_bytes, figures.weights_bytes), figures.draw_s),
            "weights, drawn by WebGL2": (dict.fromkeys(figures.points_bytes, figures.weights_bytes), figures.card_s),
        }
        rows = "\n".join(
            f"| {name} | {n:,} | {sizes[n]:,} | {1000 * np.median(times[n]):.1f} "
            f"| {8000 * sizes[n] / LINE_BITS_S:.0f} |"
            for n in figures.points_bytes
            for name, (sizes, times) in ways.items()
        )
        self._sections.append(
            "## Points in a JavaScript client: downloaded, or drawn from the weights\n\n"
            f"Over loopback; weights are fetched each time. WebGL2 of Chromium: {figures.renderer}. The last column is "
            f"what the bytes alone take on a line of {LINE_BITS_S / 1e6:.0f} Mbit/s.\n\n"
            f"| way | n | bytes | ms | ms of the line |\n|---|---|---|---|---|\n{rows}"
        )

    def write(self, path: Path) -> None:
        """Write the page."""
        run = self.run
        page = (
            "# Benchmarks\n\n"
            f"Written by `make bench`. {run['machine']}; pinned to one core; {run['date']}, seed {run['seed']}, "
            f"commit {run['commit']}. Medians of {self.rounds} rounds (decoders: at most 5), in which all ways run in "
            "turn; every time includes drawing the canonical points, by the same generator for all. "
            f"OPENBLAS_NUM_THREADS={os.environ.get('OPENBLAS_NUM_THREADS', 'unset')}.\n"
            "Many clients, overload and peers: [LOAD.md](LOAD.md). Memory over 200,000 requests: [SOAK.md](SOAK.md)."
            "\n\n"
            f"{targets_table(self.targets)}\n\n"
        )
        path.write_text(page + "\n\n".join(self._sections) + "\n", encoding="utf-8")


def draw_runtime(times: dict[int, dict[str, Seconds]], output: Path) -> None:
    """Plot time over n, both logarithmic, as in the paper's runtime figure."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(7, 4.5))
    for name in next(iter(times.values())):
        axes.plot(list(times), [1000 * np.median(row[name]) for row in times.values()], marker="o", label=name)
    axes.set(xscale="log", yscale="log", xlabel="points", ylabel="ms, one core")
    axes.grid(visible=True, alpha=0.3)
    axes.legend()
    figure.tight_layout()
    figure.savefig(output, dpi=110)
    plt.close(figure)
