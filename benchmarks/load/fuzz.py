"""Send damaged images to a real server; none may cause a fault. `python -m benchmarks.load.fuzz --count 10000`.

Failures are listed by number: `tests.support.mutations.mutant(number)` makes the image again.
"""

import argparse
import asyncio
import io
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import aiohttp

from benchmarks.load.generator import LOST, each, session
from benchmarks.targets import Target, targets_table
from service.settings import MIB
from tests.support.mutations import mutant
from tests.support.processes import hof, serving
from tests.support.resources import SERVER_CORE, status_bytes

CLIENTS: Final = 8
WARM_UP: Final = 0.2  # of the images: from then on memory is compared
QUERIES: Final = ("", "?background=keep", "?store=false", "?foreground_ratio=0.1")


@dataclass
class Outcome:
    """Answers to the images by status and problem, and the numbers of the images that failed.

    memory : resident bytes of the server after the warm-up and at the end.
    """

    answers: Counter[tuple[int, str]] = field(default_factory=Counter)
    failed: list[int] = field(default_factory=list)
    memory: list[int] = field(default_factory=list)
    is_live: bool = False


def fuzz(targets: list[Target], count: int) -> str:
    """Send `count` damaged images, count the answers, and return the page's section."""
    start = time.perf_counter()
    with serving(hof(threads=1), {SERVER_CORE}) as (url, pid):
        outcome = asyncio.run(_drive(url, pid, count))
    took_s = time.perf_counter() - start
    growth = outcome.memory[-1] / outcome.memory[0] - 1
    targets += [
        Target("fuzz: answers of 5xx, or none", len(outcome.failed), 0, at_most=True),
        Target("fuzz: the server lives at the end", outcome.is_live, 1),
        Target("fuzz: growth of resident memory, %", 100 * growth, 10, at_most=True),
    ]
    rows = "\n".join(
        f"| {status} | {kind} | {number:,} |" for (status, kind), number in sorted(outcome.answers.items())
    )
    failures = f"\n\nFailed, by number: {', '.join(map(str, outcome.failed[:100]))}." if outcome.failed else ""
    return (
        f"## Fuzzing: POST /encode, {count:,} damaged images, {CLIENTS} clients, {took_s:.0f} s\n\n"
        "PNG, JPEG and WebP of every sort, with bits flipped, bytes lost, chunks out of place, lengths that lie, "
        f"or two files joined.\n\n| status | problem | images |\n|---|---|---|\n{rows}\n\n"
        f"Resident memory: {outcome.memory[0] / MIB:.1f} MiB after the first {WARM_UP:.0%}, "
        f"{outcome.memory[-1] / MIB:.1f} MiB at the end.{failures}"
    )


async def _drive(url: str, pid: int, count: int) -> Outcome:
    outcome = Outcome()

    async with session() as client:

        async def ask(number: int) -> None:
            if number == int(WARM_UP * count):
                outcome.memory.append(status_bytes(pid, "VmRSS"))
            status, kind = await _send(client, url, number)
            outcome.answers[status, kind] += 1
            if status == LOST or status >= 500:
                outcome.failed.append(number)

        await each(count, CLIENTS, ask)
        outcome.memory.append(status_bytes(pid, "VmRSS"))
        async with client.get(f"{url}/health/live") as answer:
            outcome.is_live = answer.status == 200
    return outcome


async def _send(client: aiohttp.ClientSession, url: str, number: int) -> tuple[int, str]:
    """Return the answer's status, LOST without one, and the title of its problem. Every eighth image goes as a form."""
    image, path = mutant(number), f"{url}/encode{QUERIES[number % len(QUERIES)]}"
    data = aiohttp.FormData({"image": io.BytesIO(image)}) if number % 8 == 0 else image
    try:
        async with client.post(path, data=data) as answer:
            body = await answer.json(content_type=None)
            return answer.status, body.get("title", "")
    except (aiohttp.ClientError, TimeoutError, ValueError):
        return LOST, ""


def main(argv: Sequence[str] | None = None) -> int:
    """Fuzz and print. Return 1 if a target was missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000, help="images; default: 10,000")
    targets: list[Target] = []
    section = fuzz(targets, parser.parse_args(argv).count)
    print(section, targets_table(targets), sep="\n\n")
    return 0 if all(item.met for item in targets) else 1


if __name__ == "__main__":
    sys.exit(main())
