"""Mixed operations on a fleet whose processes are killed one after another."""

import asyncio
import random
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from tests.support.systems.fleets import Fleet
from tests.support.systems.owners import Owner, Report, check_database, check_list

CLIENTS: Final = 8
POLL_S: Final = 0.01


@dataclass(frozen=True)
class Turmoil:
    """Operations that were done while processes were killed: what the clients saw, kills, and seconds."""

    report: Report
    kills: int
    took_s: float
    objects: int


def turmoil(
    fleet: Fleet,
    database_url: str,
    operations: int,
    kills: int,
    photos: Callable[[int], Iterator[bytes]],
    seed: int = 0,
) -> Turmoil:
    """Do at least so many operations, kill processes meanwhile, and compare lists and database with the clients.

    Parameters
    ----------
    kills : each at a random moment, once the process killed before it serves again; operations go on until the last.
    photos : returns the photos of the client with a number; no two photos are alike.
    """
    return asyncio.run(_turmoil(fleet, database_url, operations, kills, photos, seed))


async def _turmoil(
    fleet: Fleet,
    database_url: str,
    operations: int,
    kills: int,
    photos: Callable[[int], Iterator[bytes]],
    seed: int,
) -> Turmoil:
    report = Report()
    numbers = range(seed * CLIENTS, (seed + 1) * CLIENTS)
    owners = [Owner(number, fleet.urls, photos(number), report) for number in numbers]
    start = time.perf_counter()
    killer = asyncio.create_task(_kill(fleet, report, operations, kills, random.Random(seed)))

    def is_over() -> bool:
        return killer.done() and report.operations >= operations

    try:
        await asyncio.gather(*(owner.work(is_over) for owner in owners))
        await killer
    finally:
        killer.cancel()
    took_s = time.perf_counter() - start
    await check_list(fleet.urls, owners, report)
    await check_database(database_url, owners, report)
    return Turmoil(report, kills, took_s, sum(len(owner.objects) for owner in owners))


async def _kill(fleet: Fleet, report: Report, operations: int, kills: int, draw: random.Random) -> None:
    """Kill processes, each after a random number of operations since the one before serves again."""
    for _ in range(kills):
        then = report.operations + draw.randint(1, max(1, 2 * operations // (kills + 1)))
        while report.operations < min(then, operations):
            await asyncio.sleep(POLL_S)
        await asyncio.to_thread(fleet.kill_one, draw)
