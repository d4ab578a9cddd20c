"""Send far more photos than the service can encode: photos that it still answers, and how it refuses the rest.

The host of a virtual machine gives its cores to others, now 1% of the time, now 20%. So rates are those of the time
that the server's core was given, and each flood stands between two peaks.
"""

import asyncio
import sys
import time
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from benchmarks.load.generator import Answers, closed_loop, open_loop, probe
from benchmarks.load.photos import photos
from benchmarks.targets import Target
from service.settings import MIB
from tests.support.processes import hof, serving
from tests.support.resources import SERVER_CORE, cpu_s, given_s, status_bytes, threads

OVERLOAD: Final = 3  # times the peak
CLIENTS: Final = (16, 64)  # of a closed loop
IMPATIENT: Final = (
    "import sys; from service.cli.main import main; from service.server import process; "
    "process.TURN_S = 0.005; main(sys.argv[1:])"
)
WAYS: Final = {  # commands of servers that might lose less to the photos that they refuse
    "as shipped": hof(threads=1),
    "a queue of 16 photos, not 128": hof(threads=1, max_queued_images=16),
    "no thread takes the core from another (SCHED_BATCH)": ["chrt", "--batch", "0", *hof(threads=1)],
    "Python's threads take turns after 5 ms, not 20": [sys.executable, "-c", IMPATIENT, *hof(threads=1)[1:]],
}


@dataclass
class Floods:
    """Answers of several floods, to the photos and to the probes beside them.

    by_clock, by_core : photos/s of each flood and the mean of its peaks, by the clock and by the time that the core
        was given.
    """

    photos: Answers = field(default_factory=Answers)
    live: Answers = field(default_factory=Answers)
    by_clock: list[tuple[float, float]] = field(default_factory=list)  # a flood's, and its peaks' mean
    by_core: list[tuple[float, float]] = field(default_factory=list)


def overload(targets: list[Target], rounds: int, seconds: int) -> str:
    """Measure rounds of a peak, an open loop far above it, and the peak again; idle processor time and threads too."""
    floods = Floods()
    with serving(hof(threads=1), {SERVER_CORE}) as (url, pid):
        asyncio.run(closed_loop(f"{url}/encode", photos(1), 8, seconds / 10))  # warm
        idle = _idle_share(pid, seconds / 12)
        _peak(url, 90, seconds)  # what a full service takes is no growth
        before = status_bytes(pid, "VmRSS")
        for number in range(rounds):
            _round(floods, url, 10 * number, seconds)
        growth = status_bytes(pid, "VmRSS") / before - 1
        count = threads(pid)
    targets += [
        Target("overload: goodput as a share of the peak", _share(floods.by_core), 0.95),
        Target("overload: answers of 5xx, or none", _failed(floods.photos), 0, at_most=True),
        Target("overload: p99 of 429, ms", floods.photos.p99_ms(429, 429), 20, at_most=True),
        Target("overload: p99 of /health/live, ms", floods.live.p99_ms(), 50, at_most=True),
        Target("overload: growth of resident memory, %", 100 * growth, 10, at_most=True),
        Target("idle: processor time from 100 ms after a request, %", 100 * idle, 1, at_most=True),
        Target("threads of the server after that", count, 8 + 4, at_most=True),
    ]
    return _section(floods, seconds, before)


def compare_ways(rounds: int, seconds: int) -> str:
    """Compare goodput of other ways to run the server with the shipped way, in turn."""
    floods = {name: Floods() for name in WAYS}
    for number in range(rounds):
        for name, command in WAYS.items():
            with serving(command, {SERVER_CORE}) as (url, _):
                asyncio.run(closed_loop(f"{url}/encode", photos(1), 8, seconds / 10))
                _round(floods[name], url, 10 * number, seconds)
    rows = "\n".join(
        f"| {name} | {_share(of.by_core):.3f} | {of.photos.p99_ms(429, 429):.1f} | {of.live.p99_ms():.1f} |"
        for name, of in floods.items()
    )
    return (
        f"## Overload: what was tried, {rounds} floods of {seconds} s each\n\n"
        "| server | goodput as a share of the peak | p99 of 429, ms | p99 of /health/live, ms |\n|---|---|---|---|\n"
        f"{rows}"
    )


def _round(floods: Floods, url: str, seed: int, seconds: int) -> None:
    """Run a flood between two peaks. A round shares no peak with the next, since the store grows."""
    peaks = [_peak(url, seed + 2, seconds)]
    rate = OVERLOAD * peaks[0][1]
    began = given_s(SERVER_CORE)
    answers, live = asyncio.run(_flood(url, seed + 4, rate, seconds))
    by_core = answers.count(200, 299) / (given_s(SERVER_CORE) - began)
    peaks.append(_peak(url, seed + 6, seconds))
    by_clock_peak, by_core_peak = np.mean(peaks, axis=0).tolist()
    floods.by_clock.append((answers.goodput, by_clock_peak))
    floods.by_core.append((by_core, by_core_peak))
    floods.photos.join(answers)
    floods.live.join(live)


def _peak(url: str, seed: int, seconds: int) -> tuple[float, float]:
    """Return the highest rate of a closed loop, photos/s: by the clock, and by the time that the core was given."""
    rates = []
    for number, clients in enumerate(CLIENTS):
        began = given_s(SERVER_CORE)
        answers = asyncio.run(closed_loop(f"{url}/encode", photos(seed + number), clients, max(1.0, seconds / 6)))
        rates.append((answers.goodput, answers.count(200, 299) / (given_s(SERVER_CORE) - began)))
    return max(rates, key=lambda rate: rate[1])


async def _flood(url: str, seed: int, per_second: float, seconds: float) -> tuple[Answers, Answers]:
    load = asyncio.create_task(open_loop(f"{url}/encode", photos(seed), per_second, seconds))
    live = await probe(f"{url}/health/live", 0.05, load)
    return await load, live


def _idle_share(pid: int, seconds: float) -> float:
    """Share of a core that a server takes from 100 ms after its last request on."""
    time.sleep(0.1)
    before, start = cpu_s(pid), time.perf_counter()
    time.sleep(seconds)
    return (cpu_s(pid) - before) / (time.perf_counter() - start)


def _share(pairs: list[tuple[float, float]]) -> float:
    """Median share of its peaks that a flood reaches."""
    return float(np.median([flood / peak for flood, peak in pairs]))


def _failed(answers: Answers) -> int:
    return answers.count(500, 599) + answers.count(0, 0)


def _section(floods: Floods, seconds: int, before: int) -> str:
    answers = floods.photos
    rows = "\n".join(
        f"| {flood:.1f} | {peak:.1f} | {flood / peak:.3f} | {clock_flood:.1f} | {clock_peak:.1f} |"
        for (flood, peak), (clock_flood, clock_peak) in zip(floods.by_core, floods.by_clock, strict=True)
    )
    others = len(answers.statuses) - answers.count(200, 299) - answers.count(429, 429)
    return (
        f"## Overload: POST /encode, {OVERLOAD} times the peak, open loop, {seconds} s\n\n"
        f"The peak is that of closed loops of {CLIENTS[0]} and {CLIENTS[1]} clients before and after the flood: the "
        "better one of either time, their mean. A second is one that the host gave the server's core; by the clock, "
        f"which counts what it gave to others, the median share is {_share(floods.by_clock):.2f}.\n\n"
        "| goodput, photos/s | peak | share | goodput by the clock | peak by the clock |\n|---|---|---|---|---|\n"
        f"{rows}\n\n"
        f"Answered 2xx: {answers.count(200, 299):,}, p99 {answers.p99_ms():.0f} ms; 429: {answers.count(429, 429):,}; "
        f"other: {others}. Memory before: {before / MIB:.0f} MiB."
    )
