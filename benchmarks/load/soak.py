"""`make soak`: 200,000 mixed requests, and whether memory grows with them; writes benchmarks/SOAK.md.

About half an hour. Other work beside it slows it down and changes nothing else.
"""

import argparse
import asyncio
import json
import random
import time
from collections import Counter, deque
from collections.abc import Sequence
from http import HTTPStatus
from pathlib import Path
from typing import Final

import aiohttp
import numpy as np

from benchmarks.load.generator import each, session
from benchmarks.load.photos import photos
from benchmarks.targets import Target, targets_table
from model.provenance import provenance
from service.formats.weights import Weights, dump
from service.mapping.spec import HOF_1, initial_theta
from service.settings import MIB
from tests.support.processes import hof, serving
from tests.support.resources import SERVER_CORE, others, pin_to, status_bytes

CLIENTS: Final = 8
SAMPLES: Final = 400  # of resident memory
WARM_UP: Final = 0.3  # of the requests, all clients asking for the same: the allocators know every peak after that
BLOCKS: Final = 10  # of the samples; their slopes tell how sure the whole one is
LEAVE_AFTER_S: Final = 0.002
NO_ANSWER: Final = 599  # counts as 5xx
SPEC: Final = HOF_1.with_k(2)  # of what is imported


def main(argv: Sequence[str] | None = None) -> int:
    """Send requests of every kind and fit a line to the server's resident memory."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--requests", type=int, default=200_000)
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).resolve().parents[1])
    arguments = parser.parse_args(argv)
    requests: int = arguments.requests
    run = provenance(0)
    pin_to(others(SERVER_CORE))
    start = time.perf_counter()
    with serving(hof(threads=1), {SERVER_CORE}) as (url, pid):
        memory, statuses = asyncio.run(_drive(url, pid, requests))
    took = time.perf_counter() - start
    slope, error = _slope(memory[int(WARM_UP * len(memory)) :], int((1 - WARM_UP) * requests))
    targets = [
        Target("slope of resident memory over its standard error", slope / error, 2, at_most=True),
        Target("answers of 5xx", sum(count for status, count in statuses.items() if status >= 500), 0, at_most=True),
    ]
    counts = ", ".join(f"{status or 'left'}: {count:,}" for status, count in sorted(statuses.items()))
    page = (
        f"# Soak: {requests:,} mixed requests, {CLIENTS} clients, {took:.0f} s\n\nWritten by `make soak`. "
        f"{run['machine']}; {run['date']}, commit {run['commit']}. The server has one core and `--threads 1`.\n\n"
        f"{targets_table(targets)}\n\n"
        "New photos, repeats, points, surfaces, weights, lists, compositions, imports, deletions, bad bodies, "
        "unknown ids, clients that leave. "
        f"Answers by status: {counts}.\n\nResident memory after the first {WARM_UP:.0%}: {memory[-1] / MIB:.1f} "
        f"MiB at the end, {slope / MIB:+.2f} MiB per 100,000 requests, standard error {error / MIB:.2f}.\n"
    )
    (arguments.output / "SOAK.md").write_text(page, encoding="utf-8")
    print(page)
    return 0


def _slope(memory: list[int], requests: int) -> tuple[float, float]:
    """Return bytes per 100,000 requests and the standard error, from blocks, since neighboring samples are alike."""
    values = np.array(memory, np.float64)
    position = np.linspace(0, requests / 100_000, len(values))
    line = np.polyfit(position, values, 1)
    residuals = np.array([block.mean() for block in np.array_split(values - np.polyval(line, position), BLOCKS)])
    centers = np.array([block.mean() for block in np.array_split(position, BLOCKS)])
    spread = np.sqrt((residuals**2).sum() / (BLOCKS - 2) / ((centers - centers.mean()) ** 2).sum())
    return float(line[0]), max(float(spread), 1.0)


async def _drive(url: str, pid: int, requests: int) -> tuple[list[int], Counter[int]]:
    """Return resident memory at SAMPLES moments, and the number of answers by status (0: the client left)."""
    memory: list[int] = []
    statuses: Counter[int] = Counter()
    visitor = Visitor(url, warm_up=int(WARM_UP * requests))

    async with session() as client:

        async def ask(number: int) -> None:
            if number % max(1, requests // SAMPLES) == 0:
                memory.append(status_bytes(pid, "VmRSS"))
            try:
                statuses[await visitor.ask(client, number)] += 1
            except aiohttp.ClientError:
                statuses[NO_ANSWER] += 1

        await each(requests, CLIENTS, ask)
    return memory, statuses


class Visitor:
    """Client that draws its requests from fixed seeds. The first `warm_up` requests are alike, CLIENTS at a time."""

    def __init__(self, url: str, warm_up: int) -> None:
        self._url, self._warm_up = url, warm_up
        self._dice, self._objects = random.Random(0), random.Random(1)  # noqa: S311
        self._thrown = self._dice.getstate()
        self._photos = photos(7)
        self._repeated = next(self._photos)
        self._ids: deque[str] = deque(maxlen=500)

    async def ask(self, client: aiohttp.ClientSession, number: int) -> int:
        """Send one request. Returns its status, 0 where the client left."""
        if number < CLIENTS or not self._ids:
            return await self._new_photo(client)
        if number < self._warm_up and number % CLIENTS:
            self._dice.setstate(self._thrown)
        self._thrown = self._dice.getstate()
        ask = self._dice.choices([*KINDS], [*KINDS.values()])[0]
        return await ask(self, client)

    async def _new_photo(self, client: aiohttp.ClientSession) -> int:
        return await self._encode(client, next(self._photos))

    async def _repeat(self, client: aiohttp.ClientSession) -> int:
        return await self._encode(client, self._repeated)

    async def _points(self, client: aiohttp.ClientSession) -> int:
        n, fmt = self._dice.choice((500, 2_000, 8_000)), self._dice.choice(("ply", "npy", "json", "glb"))
        return await self._send(client, "GET", f"{self._any_path()}/points?n={n}&format={fmt}")

    async def _mesh(self, client: aiohttp.ClientSession) -> int:
        fmt = self._dice.choice(("glb", "gltf", "ply", "obj", "stl"))
        return await self._send(client, "GET", f"{self._any_path()}/mesh?resolution=8&format={fmt}")

    async def _weights(self, client: aiohttp.ClientSession) -> int:
        return await self._send(client, "GET", f"{self._any_path()}/weights")

    async def _list(self, client: aiohttp.ClientSession) -> int:
        return await self._send(client, "GET", "/objects?limit=20")

    async def _compose(self, client: aiohttp.ClientSession) -> int:
        body = {"mode": "compose", "objects": self._objects.choices(self._ids, k=2)}
        return await self._send(client, "POST", "/compose", json.dumps(body).encode())

    async def _import(self, client: aiohttp.ClientSession) -> int:
        theta = initial_theta(SPEC, seed=self._objects.getrandbits(31))
        return await self._send(client, "POST", "/objects", dump(Weights(SPEC, theta, "soak"), "safetensors"))

    async def _delete(self, client: aiohttp.ClientSession) -> int:
        """Delete an object. A 409 keeps one that a composed object names; it is not requested again."""
        name = self._objects.choice(self._ids)
        self._ids.remove(name)
        return await self._send(client, "DELETE", f"/objects/{name}")

    async def _bad_body(self, client: aiohttp.ClientSession) -> int:
        return await self._send(client, "POST", "/encode", b"no image")

    async def _unknown(self, client: aiohttp.ClientSession) -> int:
        return await self._send(client, "GET", f"/objects/{self._dice.getrandbits(128):032x}")

    async def _leave(self, client: aiohttp.ClientSession) -> int:
        """Begin a large cloud or a photo, and disconnect."""
        try:
            async with asyncio.timeout(LEAVE_AFTER_S):
                if self._dice.random() < 0.5:
                    return await self._new_photo(client)
                return await self._send(client, "GET", f"{self._any_path()}/points?n=1000000")
        except TimeoutError:
            return 0

    def _any_path(self) -> str:
        return f"/objects/{self._objects.choice(self._ids)}"

    async def _encode(self, client: aiohttp.ClientSession, photo: bytes) -> int:
        async with client.post(f"{self._url}/encode", data=photo) as answer:
            if answer.status == HTTPStatus.CREATED:
                self._ids.append((await answer.json())["id"])
            return answer.status

    async def _send(self, client: aiohttp.ClientSession, method: str, path: str, body: bytes | None = None) -> int:
        async with client.request(method, self._url + path, data=body) as answer:
            await answer.read()
            return answer.status


KINDS: Final = {  # each with its share of the requests, percent
    Visitor._new_photo: 14,
    Visitor._repeat: 12,
    Visitor._points: 33,
    Visitor._mesh: 4,
    Visitor._weights: 9,
    Visitor._list: 5,
    Visitor._compose: 3,
    Visitor._import: 3,
    Visitor._delete: 3,
    Visitor._bad_body: 5,
    Visitor._unknown: 4,
    Visitor._leave: 5,
}


if __name__ == "__main__":
    raise SystemExit(main())
