"""Load generators: closed loops, where each client waits for its answer, and open loops, where requests keep coming."""

import asyncio
import time
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass, field
from typing import Final

import aiohttp
import numpy as np

TIMEOUT: Final = aiohttp.ClientTimeout(total=60)
LOST: Final = 0  # the status of a request without an answer


@dataclass
class Answers:
    """Status and seconds of each request, and seconds of the whole load."""

    took_s: float = 0.0
    statuses: list[int] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)

    def add(self, status: int, seconds: float) -> None:
        """Record one answer."""
        self.statuses.append(status)
        self.seconds.append(seconds)

    def join(self, others: "Answers") -> None:
        """Merge the answers of another load."""
        self.took_s += others.took_s
        self.statuses += others.statuses
        self.seconds += others.seconds

    def count(self, low: int, high: int) -> int:
        """Return the number of answers with a status from low to high."""
        return sum(low <= status <= high for status in self.statuses)

    @property
    def goodput(self) -> float:
        """Answers of 2xx per second."""
        return self.count(200, 299) / self.took_s

    def p99_ms(self, low: int = 200, high: int = 299) -> float:
        """99th percentile, in ms, of the time of answers with a status from low to high; nan without any."""
        chosen = [took for took, status in zip(self.seconds, self.statuses, strict=True) if low <= status <= high]
        return 1000 * float(np.percentile(chosen, 99)) if chosen else float("nan")


def session() -> aiohttp.ClientSession:
    """Open a client session without a limit of connections."""
    return aiohttp.ClientSession(connector=aiohttp.TCPConnector(limit=0), timeout=TIMEOUT)


async def post(client: aiohttp.ClientSession, url: str, body: bytes, answers: Answers) -> None:
    """Send a photo, read the whole answer, and record it."""
    start = time.perf_counter()
    try:
        async with client.post(url, data=body, headers={"Content-Type": "image/jpeg"}) as answer:
            await answer.read()
            status = answer.status
    except (aiohttp.ClientError, TimeoutError):
        status = LOST
    answers.add(status, time.perf_counter() - start)


async def closed_loop(url: str, bodies: Iterator[bytes], clients: int, seconds: float) -> Answers:
    """Run so many clients, each sending its next photo when it has its answer."""
    answers = Answers()
    start = time.perf_counter()

    async def one(client: aiohttp.ClientSession) -> None:
        while time.perf_counter() - start < seconds:
            await post(client, url, next(bodies), answers)

    async with session() as client:
        await asyncio.gather(*(one(client) for _ in range(clients)))
    answers.took_s = time.perf_counter() - start
    return answers


async def each(count: int, clients: int, ask: Callable[[int], Awaitable[None]]) -> None:
    """Call `ask` with each number below `count`, `clients` at a time."""
    numbers = iter(range(count))

    async def one() -> None:
        for number in numbers:
            await ask(number)

    await asyncio.gather(*(one() for _ in range(clients)))


async def open_loop(url: str, bodies: Iterator[bytes], per_second: float, seconds: float) -> Answers:
    """Send photos at a rate, whether or not the earlier ones are answered; return after the last answer."""
    answers = Answers()
    pending: set[asyncio.Task[None]] = set()
    start = time.perf_counter()
    async with session() as client:
        for number in range(int(per_second * seconds)):
            await asyncio.sleep(max(0.0, start + number / per_second - time.perf_counter()))
            task = asyncio.create_task(post(client, url, next(bodies), answers))
            pending.add(task)
            task.add_done_callback(pending.discard)
        await asyncio.gather(*pending)
        answers.took_s = time.perf_counter() - start
    return answers


async def probe(url: str, every_s: float, until: "asyncio.Task[Answers]") -> Answers:
    """Call a probe again and again while a load runs."""
    answers = Answers()
    async with session() as client:
        while not until.done():
            start = time.perf_counter()
            async with client.get(url) as answer:
                await answer.read()
            answers.add(answer.status, time.perf_counter() - start)
            await asyncio.sleep(every_s)
    return answers
