"""The service beside bare FastAPI, LitServe and BentoML: the same model, framing and store, one core, in turn."""

import asyncio
import itertools
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.load.generator import Answers, closed_loop
from benchmarks.load.photos import photos
from benchmarks.targets import Target
from tests.support.processes import hof, serving

OURS, BARE, REPEATED = "ours", "bare FastAPI", "ours, a repeated photo"
LEVELS: Final = (1, 8, 64)  # clients at a time
WARM_UP_S: Final = 1.0

Runs = dict[tuple[str, int], list[Answers]]


def compare(targets: list[Target], core: int, rounds: int, seconds: float, others: Path | None) -> str:
    """Return a section with requests per second and p99 of POST /encode of each server, run in turn, round by round.

    Parameters
    ----------
    others : environment in which LitServe and BentoML are installed; None leaves them out.

    """
    runs: Runs = {}
    for round_ in range(rounds):
        for name, (command, ready) in _commands(others).items():
            with serving(command, {core}, ready) as (url, _):
                _measure(runs, name, f"{url}/encode", seconds, round_)
    rates = {key: np.array([answers.goodput for answers in loads]) for key, loads in runs.items()}
    for clients in LEVELS:
        for name in _commands(others):
            if name != OURS:
                ratio = float(np.median(rates[OURS, clients] / rates[name, clients]))
                targets.append(Target(f"{clients} clients: ours against {name}", ratio, 0.95 if name == BARE else 1))
    lost = sum(len(answers.statuses) - answers.count(200, 299) for loads in runs.values() for answers in loads)
    names = dict.fromkeys(name for name, _ in runs)
    head = " | ".join(f"{clients} clients: photos/s | p99, ms" for clients in LEVELS)
    return (
        f"## POST /encode beside others\n\nAll photos are distinct but for the last row, which is answered without "
        f"inference. Medians of {rounds} rounds of {seconds:g} s. Answers that were no 2xx: {lost}.\n\n"
        f"| server | {head} |\n|---|{'---|---|' * len(LEVELS)}\n" + "\n".join(_row(name, runs) for name in names)
    )


def _commands(others: Path | None) -> dict[str, tuple[list[str], str]]:
    """Return each server's command, and the path that answers once it is up."""
    commands = {
        OURS: (hof(threads=1), "/health/ready"),
        BARE: ([sys.executable, "-m", "benchmarks.load.peers.bare", "{port}"], "/health/ready"),
    }
    if others is not None:
        lit = [str(others / "bin" / "python"), "-m", "benchmarks.load.peers.litserve_peer", "{port}"]
        bento = [str(others / "bin" / "bentoml"), "serve", "benchmarks.load.peers.bentoml_peer:Peer", "--port={port}"]
        commands |= {"LitServe": (lit, "/health"), "BentoML": ([*bento, "--host=127.0.0.1"], "/readyz")}
    return commands


def _measure(runs: Runs, name: str, url: str, seconds: float, round_: int) -> None:
    def run(key: str, bodies: Iterator[bytes], clients: int) -> None:
        runs.setdefault((key, clients), []).append(asyncio.run(closed_loop(url, bodies, clients, seconds)))

    asyncio.run(closed_loop(url, photos(1000 + round_), max(LEVELS), WARM_UP_S))
    for clients in LEVELS:
        run(name, photos(100 * round_ + clients), clients)
        if name == OURS:
            run(REPEATED, itertools.repeat(next(photos(100 * round_ + clients))), clients)


def _row(name: str, runs: Runs) -> str:
    cells = []
    for clients in LEVELS:
        loads = runs[name, clients]
        cells.append(f"{np.median([answers.goodput for answers in loads]):.1f}")
        cells.append(f"{np.median([answers.p99_ms() for answers in loads]):.1f}")
    return f"| {name} | {' | '.join(cells)} |"
