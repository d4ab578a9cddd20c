"""`make load`: the service under load, beside others, killed, without database; writes benchmarks/LOAD.md.

The server has one core and one thread of each kind; the load comes from another core. About half an hour; each part
that ends is kept in benchmarks/load.json, so that one of them can be measured anew (`--parts`).
"""

import argparse
import asyncio
import json
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.load.beside_peers import compare
from benchmarks.load.fuzz import fuzz
from benchmarks.load.kills import faults
from benchmarks.load.outages import outages
from benchmarks.load.overload import compare_ways, overload
from benchmarks.speed.timing import in_turn
from benchmarks.targets import Target, targets_table
from model.provenance import provenance
from service.encoding.encoder import Encoder
from service.runtime.batcher import MAX_BATCH, Batcher
from service.settings import SHIPPED_MODEL
from tests.support.resources import SERVER_CORE, others, pin_to

FOLDER: Final = Path(__file__).resolve().parents[1]
PARTS: Final = ("batching", "overload", "tried", "peers", "faults", "outages", "fuzz")
SIZES: Final = (1, 2, 4, 8, 16)


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and write. `--quick` tries the program; its figures mean nothing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="seconds in place of minutes")
    parser.add_argument("--peers", type=Path, help="environment with LitServe and BentoML; default: without them")
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS, help="what to measure anew; default: all")
    parser.add_argument("-o", "--output", type=Path, default=FOLDER)
    arguments = parser.parse_args(argv)
    source = provenance(0)
    pin_to(others(SERVER_CORE))
    record: Path = arguments.output / "load.json"
    parts = json.loads(record.read_text("utf-8")) if record.exists() else {}
    for name in arguments.parts:
        targets: list[Target] = []
        text = _measure(name, targets, arguments.peers, quick=arguments.quick)
        parts[name] = {**source, "targets": [asdict(item) for item in targets], "text": text}
        record.write_text(json.dumps(parts, indent=1) + "\n", encoding="utf-8")
    page = _page([parts[name] for name in PARTS if name in parts])
    (arguments.output / "LOAD.md").write_text(page, encoding="utf-8")
    print(page)
    return 0


def _measure(name: str, targets: list[Target], peers: Path | None, *, quick: bool) -> str:
    """Measure one part and return its section."""
    match name:
        case "batching":
            return batching(targets, 3 if quick else 30)
        case "overload":
            return overload(targets, *((1, 2) if quick else (3, 60)))
        case "tried":
            return compare_ways(*((1, 2) if quick else (3, 20)))
        case "peers":
            return compare(targets, SERVER_CORE, 1 if quick else 5, 0.5 if quick else 5, peers)
        case "faults":
            return faults(targets, *((2, 1) if quick else (100, 10)))
        case "outages":
            return outages(targets, 1 if quick else 5)
    return fuzz(targets, 200 if quick else 10_000)


def _page(parts: Sequence[dict[str, Any]]) -> str:
    targets = [Target(**item) for part in parts for item in part["targets"]]
    sections = (f"{part['text']}\n\n{part['machine']}; {part['date']}, commit {part['commit']}.\n" for part in parts)
    return (
        "# Under load\n\nWritten by `make load`. The server has one core and `--threads 1`, the load comes from "
        f"another, over loopback. Photos are JPEGs of 512 x 512, each other bytes.\n\n{targets_table(targets)}\n\n"
        + "\n".join(sections)
    )


def batching(targets: list[Target], rounds: int) -> str:
    """Measure the gain of a shared call, and its cost for a single image."""
    encoder = Encoder.open(SHIPPED_MODEL, 1)
    side = encoder.framing.size
    images = np.random.default_rng(0).random((max(SIZES), 3, side, side), np.float32)
    times = in_turn({str(size): partial(encoder.encode, images[:size]) for size in SIZES}, rounds)
    per_image = {size: 1000 * float(np.median(times[str(size)])) / size for size in SIZES}
    gains = {size: float(np.median(times["1"] * size / times[str(size)])) for size in SIZES}
    added = _added_ms(encoder, images[:1], rounds)
    targets += [
        Target(f"batching: gain of a call of {MAX_BATCH} over {MAX_BATCH} calls", gains[MAX_BATCH], 1.2),
        Target("batching: added to one image alone, ms", added, 1, at_most=True),
    ]
    rows = "\n".join(f"| {size} | {per_image[size]:.2f} | {gains[size]:.2f} |" for size in SIZES)
    return (
        f"## Batching, {encoder.name}, one core\n\nA call takes the images that wait, up to {MAX_BATCH}.\n\n"
        f"| images a call | ms an image | gain |\n|---|---|---|\n{rows}"
    )


def _added_ms(encoder: Encoder, image: np.ndarray[tuple[int, ...], np.dtype[np.float32]], rounds: int) -> float:
    """Milliseconds that the batcher adds to a bare call on a worker thread, one call at a time: the median."""

    async def differences() -> list[float]:
        loop = asyncio.get_running_loop()
        with ThreadPoolExecutor(1) as executor:
            batcher = Batcher(encoder.encode, lambda function: loop.run_in_executor(executor, function))
            differences_s = []
            for _ in range(rounds):
                start = time.perf_counter()
                await loop.run_in_executor(executor, encoder.encode, image)
                between = time.perf_counter()
                await batcher.encode(image)
                differences_s.append(time.perf_counter() - between - (between - start))
            return differences_s

    return 1000 * float(np.median(asyncio.run(differences())))


if __name__ == "__main__":
    sys.exit(main())
