"""Clients that write to several processes of one service while these are killed, and check every answer.

Each client owns its objects: nobody else changes them, so the right answer to each of its calls is known. A call that
broke off is repeated elsewhere until it is answered; both may have been carried out.
"""

import asyncio
import hashlib
import itertools
import json
import random
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, Final

import aiohttp

from service.formats.weights import Weights, dump
from service.mapping.spec import MappingSpec, initial_theta
from service.storage.ids import composed_id
from service.storage.store import Store

SPEC: Final = MappingSpec("small", 3, (64,), 3, k=2)  # of what is imported
CALL_TIMEOUT_S: Final = 60.0
PAUSE_S: Final = 0.05  # after a refused connection
MAX_PAUSE_S: Final = 1.0  # after a 503 or 429, whatever its Retry-After says
ATTEMPTS: Final = 200  # of a call
PHOTOS_KEPT: Final = 8  # of a client, to be sent again
MAX_FAULTS: Final = 50


@dataclass
class Report:
    """Calls of all clients, and what was wrong.

    operations : done so far; each is a call and a read of what it did.
    statuses : number of answers by status.
    refused : attempts to connect that a killed process refused.
    broken : calls that broke off after they had been sent.
    faults : sentences, at most `MAX_FAULTS`.
    """

    operations: int = 0
    statuses: Counter[int] = field(default_factory=Counter)
    refused: int = 0
    broken: int = 0
    faults: list[str] = field(default_factory=list)

    def check(self, holds: bool, fault: str) -> None:
        """Record a fault unless a condition holds."""
        if not holds and len(self.faults) < MAX_FAULTS:
            self.faults.append(fault)

    @property
    def server_errors(self) -> int:
        """Number of answers of 5xx other than 503."""
        return sum(count for status, count in self.statuses.items() if status >= 500 and status != 503)


@dataclass
class Held:
    """An object as its owner knows it: the digest of an imported theta, its label, its word, and its points' digest."""

    theta: str | None = None
    label: str | None = None
    word: tuple[str, ...] = ()
    points: str | None = None


class Owner:
    """A client with objects of its own."""

    def __init__(self, number: int, urls: Sequence[str], photos: Iterator[bytes], report: Report) -> None:
        self.objects: dict[str, Held] = {}
        self._urls, self._photos, self._report = urls, photos, report
        self._draw = random.Random(number)
        self._seeds = itertools.count(1_000_000 * number)
        self._sent: dict[str, bytes] = {}  # photos by id, also of deleted objects
        self._client: aiohttp.ClientSession

    async def work(self, is_over: Callable[[], bool]) -> None:
        """Call again and again. Each call has a connection of its own, so any process may get it."""
        timeout = aiohttp.ClientTimeout(total=CALL_TIMEOUT_S)
        connector, traces = aiohttp.TCPConnector(force_close=True), aiohttp.TraceConfig()
        traces.on_connection_create_end.append(_note_connection)
        async with aiohttp.ClientSession(connector=connector, timeout=timeout, trace_configs=[traces]) as self._client:
            while not is_over():
                await self._draw.choices([*OPERATIONS], [*OPERATIONS.values()])[0](self)
                self._report.operations += 1

    async def _import(self) -> None:
        theta = initial_theta(SPEC, next(self._seeds))
        status, body, again = await self._call("POST", "/objects", dump(Weights(SPEC, theta, "owner"), "safetensors"))
        self._expect(f"import: {status}", status == 201 or (again and status == 200))
        await self._hold(json.loads(body)["id"], Held(theta=_sha256(theta.tobytes())))

    async def _new_photo(self) -> None:
        photo = next(self._photos)
        status, body, again = await self._call("POST", "/encode", photo)
        self._expect(f"new photo: {status}", status == 201 or (again and status == 200))
        object_id = json.loads(body)["id"]
        self._sent[object_id] = photo
        while len(self._sent) > PHOTOS_KEPT:
            self._sent.pop(next(iter(self._sent)))
        await self._hold(object_id, Held())

    async def _repeated_photo(self) -> None:
        """Send a photo again: the same object, a new one only if it was deleted meanwhile."""
        if not self._sent:
            return await self._new_photo()
        object_id = self._draw.choice([*self._sent])
        status, body, again = await self._call("POST", "/encode", self._sent[object_id])
        expected = 200 if object_id in self.objects else 201
        self._expect(f"photo again: {status}, not {expected}", status == expected or (again and status == 200))
        self._expect("photo again: another id", json.loads(body)["id"] == object_id)
        return await self._hold(object_id, self.objects.get(object_id, Held()))

    async def _compose(self) -> None:
        imported = [object_id for object_id, held in self.objects.items() if held.theta]
        if len(imported) < SPEC.k:
            return await self._import()
        word = tuple(self._draw.choices(imported, k=SPEC.k))
        expected = 200 if composed_id(word) in self.objects else 201
        body = json.dumps({"mode": "compose", "objects": word}).encode()
        status, answer, again = await self._call("POST", "/compose", body)
        self._expect(f"compose: {status}, not {expected}", status == expected or (again and status == 200))
        object_id = json.loads(answer)["id"]
        self._expect("compose: another id", object_id == composed_id(word))
        return await self._hold(object_id, self.objects.get(object_id, Held(word=word)))

    async def _relabel(self) -> None:
        if not self.objects:
            return await self._import()
        object_id = self._draw.choice([*self.objects])
        label = f"label {next(self._seeds)}"
        status, _, _ = await self._call("PATCH", f"/objects/{object_id}", json.dumps({"label": label}).encode())
        self._expect(f"label: {status}", status == 200)
        self.objects[object_id].label = label
        return await self._read(object_id)

    async def _delete(self) -> None:
        if not self.objects:
            return await self._import()
        object_id = self._draw.choice([*self.objects])
        is_used = any(object_id in held.word for held in self.objects.values())
        expected = 409 if is_used else 204
        status, _, again = await self._call("DELETE", f"/objects/{object_id}")
        was_deleted = again and not is_used and status == 404
        self._expect(f"delete: {status}, not {expected}", status == expected or was_deleted)
        if not is_used:
            del self.objects[object_id]
            status, _, _ = await self._call("GET", f"/objects/{object_id}")
            self._expect(f"read after delete: {status}", status == 404)
        return None

    async def _read(self, object_id: str | None = None) -> None:
        """Read one of the objects and compare it."""
        if not self.objects:
            return await self._import()
        object_id = object_id or self._draw.choice([*self.objects])
        held = self.objects[object_id]
        status, body, _ = await self._call("GET", f"/objects/{object_id}")
        answer: dict[str, Any] = json.loads(body) if status == 200 else {}
        label, word = answer.get("label"), tuple(answer.get("word") or ())
        is_same = status == 200 and (label, word) == (held.label, held.word)
        return self._expect(f"read {object_id}: {status}, {label!r}, {word}, not {held}", is_same)

    async def _weights(self) -> None:
        imported = [object_id for object_id, held in self.objects.items() if held.theta]
        if not imported:
            return await self._import()
        object_id = self._draw.choice(imported)
        status, body, _ = await self._call("GET", f"/objects/{object_id}/weights?format=npy")
        is_same = status == 200 and _sha256(body[-4 * SPEC.size :]) == self.objects[object_id].theta
        return self._expect(f"weights of {object_id}: {status}, or other numbers", is_same)

    async def _points(self) -> None:
        """Read points: the same bytes from each process."""
        if not self.objects:
            return await self._import()
        object_id = self._draw.choice([*self.objects])
        status, body, _ = await self._call("GET", f"/objects/{object_id}/points?n=500&format=f32")
        held = self.objects[object_id]
        held.points = held.points or _sha256(body)
        is_same = status == 200 and _sha256(body) == held.points
        return self._expect(f"points of {object_id}: {status}, or other numbers", is_same)

    async def _hold(self, object_id: str, held: Held) -> None:
        """Remember an object that was written, and read it, perhaps from another process."""
        self.objects[object_id] = held
        await self._read(object_id)

    async def _call(self, method: str, path: str, body: bytes | None = None) -> tuple[int, bytes, bool]:
        """Call one of the processes, or the next, until there is an answer other than 503 and 429.

        Returns its status and body, and whether an earlier attempt may have been carried out.
        """
        again = False
        for _ in range(ATTEMPTS):
            url = self._draw.choice(self._urls)
            connections: list[object] = []  # aiohttp repeats some calls that broke off, by itself
            try:
                async with self._client.request(method, url + path, data=body, trace_request_ctx=connections) as answer:
                    content = await answer.read()
            except aiohttp.ClientConnectorError:
                again = again or bool(connections)  # refused when aiohttp repeated it
                self._report.refused += 1
                await asyncio.sleep(PAUSE_S)
                continue
            except (aiohttp.ClientError, TimeoutError) as error:
                self._report.check(not isinstance(error, TimeoutError), f"{method} {path}: no answer")
                self._report.broken += 1
                again = True
                continue
            again = again or len(connections) > 1
            self._report.statuses[answer.status] += 1
            if answer.status < 500 and answer.status != 429:
                return answer.status, content, again
            again = True
            seconds = answer.headers.get("Retry-After", "")
            self._expect(f"{method} {path}: {answer.status} {content[:200]!r}", answer.status in (429, 503))
            self._expect(f"{method} {path}: {answer.status} without Retry-After", seconds.isdigit())
            await asyncio.sleep(min(MAX_PAUSE_S, float(seconds or PAUSE_S)))
        raise AssertionError(f"{method} {path}: no answer in {ATTEMPTS} attempts; {self._report}")

    def _expect(self, fault: str, holds: bool) -> None:
        self._report.check(holds, fault)


async def check_list(urls: Sequence[str], owners: Sequence[Owner], report: Report) -> None:
    """Compare the list of each process with what the clients hold: nothing lost, nothing left, nothing twice."""
    expected = Counter(object_id for owner in owners for object_id in owner.objects)
    async with aiohttp.ClientSession() as client:
        for url in urls:
            ids: Counter[str] = Counter()
            cursor: str | None = ""
            while cursor is not None:
                query = {"limit": 500} | ({"cursor": cursor} if cursor else {})
                async with client.get(f"{url}/objects", params=query) as answer:
                    page = await answer.json()
                ids.update(item["id"] for item in page["items"])
                cursor = page["next"]
            report.check(not expected - ids, f"lost: {sorted(expected - ids)[:10]}")
            report.check(not ids - expected, f"doubled, or back after a deletion: {sorted(ids - expected)[:10]}")


async def check_database(url: str, owners: Sequence[Owner], report: Report) -> None:
    """Compare the database itself with what the clients hold: thetas, words and labels."""
    expected = {object_id: held for owner in owners for object_id, held in owner.objects.items()}
    store = await Store.open(url)
    try:
        after, last = 0, await store.last_seq()
        while entries := await store.entries(after, last):
            after = entries[-1].seq
            for _, record, functions, _ in entries:
                held = expected.pop(record.id, None)
                report.check(held is not None, f"{record.id} is in the database, and no client holds it")
                if held:
                    theta = _sha256(functions.theta.tobytes()) if functions and held.theta else held.theta
                    kept = Held(theta, record.label, record.members, held.points)
                    report.check(kept == held, f"{record.id} is {kept}, not {held}")
    finally:
        await store.close()
    report.check(not expected, f"the database lacks {sorted(expected)[:10]}")


async def _note_connection(_: aiohttp.ClientSession, context: SimpleNamespace, __: object) -> None:
    context.trace_request_ctx.append(context)


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


OPERATIONS: Final = {  # each with its share, percent
    Owner._import: 20,
    Owner._new_photo: 10,
    Owner._repeated_photo: 6,
    Owner._compose: 9,
    Owner._relabel: 9,
    Owner._delete: 12,
    Owner._read: 10,
    Owner._weights: 12,
    Owner._points: 12,
}
