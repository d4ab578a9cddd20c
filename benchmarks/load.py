"""`make load`: the service under load, beside others, killed, and sent damaged images; writes benchmarks/LOAD.md.

The server has one core and one thread of each kind; the load comes from another core. About twenty minutes.
"""

import argparse
import asyncio
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.comparison import compare
from benchmarks.fuzz import fuzz
from benchmarks.generator import Answers, closed_loop, open_loop, probe
from benchmarks.kills import faults
from benchmarks.photos import photos
from benchmarks.processes import SERVER_CORE, cpu_s, hof, others, pin_to, serving, status_bytes, threads
from benchmarks.report import Asked, asked_table
from benchmarks.timing import in_turn
from model.provenance import provenance
from service.batcher import MAX_BATCH, Batcher
from service.encoder import Encoder
from service.settings import SHIPPED_MODEL

FOLDER: Final = Path(__file__).resolve().parent
MIB: Final = 2**20
OVERLOAD: Final = 3  # times the peak
SIZES: Final = (1, 2, 4, 8, 16)


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and write. `--quick` is for trying the program, not for figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="seconds in place of minutes")
    parser.add_argument("--peers", type=Path, help="environment with LitServe and BentoML; default: without them")
    parser.add_argument("-o", "--output", type=Path, default=FOLDER)
    arguments = parser.parse_args(argv)
    quick: bool = arguments.quick
    made = provenance(0)
    pin_to(others(SERVER_CORE))
    asked: list[Asked] = []
    sections = [batching(asked, 3 if quick else 30), overload(asked, 2 if quick else 60)]
    sections.append(compare(asked, SERVER_CORE, 1 if quick else 5, 0.5 if quick else 5, arguments.peers))
    sections.append(faults(asked, *((2, 1) if quick else (100, 10))))
    sections.append(fuzz(asked, 200 if quick else 10_000))
    page = (
        f"# Under load\n\nWritten by `make load`. {made['machine']}; {made['date']}, commit {made['commit']}. The "
        "server has one core and `--threads 1`, the load comes from another, over loopback. Photos are JPEGs of "
        f"512 x 512, each other bytes.\n\n{asked_table(asked)}\n\n"
    )
    (arguments.output / "LOAD.md").write_text(page + "\n\n".join(sections) + "\n", encoding="utf-8")
    print(page, *sections, sep="\n\n")
    return 0


def batching(asked: list[Asked], rounds: int) -> str:
    """What a shared call gains, and what it costs one who is alone."""
    encoder = Encoder.open(SHIPPED_MODEL, 1)
    side = encoder.framing.size
    images = np.random.default_rng(0).random((max(SIZES), 3, side, side), np.float32)
    times = in_turn({str(size): partial(encoder.encode, images[:size]) for size in SIZES}, rounds)
    per_image = {size: 1000 * float(np.median(times[str(size)])) / size for size in SIZES}
    gains = {size: float(np.median(times["1"] * size / times[str(size)])) for size in SIZES}
    added = _added_ms(encoder, images[:1], rounds)
    asked += [
        Asked(f"batching: gain of a call of {MAX_BATCH} over {MAX_BATCH} calls", gains[MAX_BATCH], 1.2),
        Asked("batching: added to one image alone, ms", added, 1, at_most=True),
    ]
    rows = "\n".join(f"| {size} | {per_image[size]:.2f} | {gains[size]:.2f} |" for size in SIZES)
    return (
        f"## Batching, {encoder.name}, one core\n\nA call takes the images that wait, up to {MAX_BATCH}.\n\n"
        f"| images a call | ms an image | gain |\n|---|---|---|\n{rows}"
    )


def _added_ms(encoder: Encoder, image: np.ndarray[tuple[int, ...], np.dtype[np.float32]], rounds: int) -> float:
    """What the batcher adds to a bare call on a worker thread, at concurrency 1: median of the differences."""

    async def differences() -> list[float]:
        loop = asyncio.get_running_loop()
        with ThreadPoolExecutor(1) as executor:
            batcher = Batcher(encoder.encode, lambda function: loop.run_in_executor(executor, function))
            found = []
            for _ in range(rounds):
                start = time.perf_counter()
                await loop.run_in_executor(executor, encoder.encode, image)
                between = time.perf_counter()
                await batcher.encode(image)
                found.append(time.perf_counter() - between - (between - start))
            return found

    return 1000 * float(np.median(asyncio.run(differences())))


def overload(asked: list[Asked], seconds: int) -> str:
    """The peak, an open loop far above it, and the peak again: a shared machine is not the same for two minutes. Idle
    processor time and threads on the way."""
    with serving(hof(threads=1), {SERVER_CORE}) as (url, pid):
        asyncio.run(closed_loop(f"{url}/encode", photos(1), 8, seconds / 10))  # warm
        peaks = [_peak(url, 2, seconds)]
        idle = _idle_share(pid, seconds / 12)
        before = status_bytes(pid, "VmRSS")
        answers, live = asyncio.run(_flood(url, OVERLOAD * peaks[0], seconds))
        growth = status_bytes(pid, "VmRSS") / before - 1
        count = threads(pid)
        peaks.append(_peak(url, 4, seconds))
    peak = sum(peaks) / len(peaks)
    asked += [
        Asked("overload: goodput as a share of the peak", answers.goodput / peak, 0.95),
        Asked("overload: answers of 5xx, or none", answers.count(500, 599) + answers.count(0, 0), 0, at_most=True),
        Asked("overload: p99 of 429, ms", answers.p99_ms(429, 429), 20, at_most=True),
        Asked("overload: p99 of /health/live, ms", live.p99_ms(), 50, at_most=True),
        Asked("overload: growth of resident memory, %", 100 * growth, 10, at_most=True),
        Asked("idle: processor time from 100 ms after a request, %", 100 * idle, 1, at_most=True),
        Asked("threads of the server after that", count, 8 + 4, at_most=True),
    ]
    return (
        f"## Overload: POST /encode, {OVERLOAD} times the peak, open loop, {seconds} s\n\n"
        f"- Peak of a closed loop (16 and 64 clients): {peaks[0]:.1f} photos/s before, {peaks[1]:.1f} after; their "
        "mean counts.\n"
        f"- Sent: {len(answers.statuses) / seconds:.1f} a second. Answered 2xx: {answers.goodput:.1f} a second, p99 "
        f"{answers.p99_ms():.0f} ms; 429: {answers.count(429, 429)}; other: "
        f"{len(answers.statuses) - answers.count(200, 299) - answers.count(429, 429)}.\n"
        f"- Memory before: {before / MIB:.0f} MiB."
    )


def _peak(url: str, seed: int, seconds: int) -> float:
    """The most that a closed loop gets, photos/s."""
    each_s = max(1.0, seconds / 6)
    found = (
        asyncio.run(closed_loop(f"{url}/encode", photos(seed + number), clients, each_s))
        for number, clients in enumerate((16, 64))
    )
    return max(answers.goodput for answers in found)


async def _flood(url: str, per_second: float, seconds: float) -> tuple[Answers, Answers]:
    load = asyncio.create_task(open_loop(f"{url}/encode", photos(100), per_second, seconds))
    live = await probe(f"{url}/health/live", 0.05, load)
    return await load, live


def _idle_share(pid: int, seconds: float) -> float:
    """Share of a core that a server takes from 100 ms after its last request on."""
    time.sleep(0.1)
    before, start = cpu_s(pid), time.perf_counter()
    time.sleep(seconds)
    return (cpu_s(pid) - before) / (time.perf_counter() - start)


if __name__ == "__main__":
    sys.exit(main())
