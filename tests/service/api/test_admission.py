"""Gates that routes declare."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager

import httpx
import pytest

from service.api.admission import declared_gates
from service.api.app import ROUTERS
from service.runtime.admission import Admitted, Gate, Gates
from service.settings import Settings


def test_declared_gates_of_all_routes_are_those_of_calls_that_always_compute(settings: Settings) -> None:
    gates = Gates.of(settings)
    declared = declared_gates((route for router in ROUTERS for route in router.routes), gates)
    assert declared == {
        ("POST", "/encode"): gates.images,
        ("POST", "/v2/models/{name}/infer"): gates.images,
        ("POST", "/v2/models/{name}/versions/{version}/infer"): gates.images,
        ("POST", "/objects"): gates.points,
        ("POST", "/compose"): gates.points,
        ("POST", "/objects/{id}/path"): gates.points,
    }


@pytest.fixture
def clients(monkeypatch: pytest.MonkeyPatch) -> list[str | None]:
    """Return the clients for which gates admit work from now on."""
    clients, admit = list[str | None](), Gate.admit

    @contextmanager
    def recorded(gate: Gate, amount: int = 1, client: str | None = None) -> Iterator[Admitted]:
        clients.append(client)
        with admit(gate, amount, client) as admitted:
            yield admitted

    monkeypatch.setattr(Gate, "admit", recorded)
    return clients


def test_work_of_every_call_counts_for_its_client(
    client: httpx.Client, photo: bytes, clients: list[str | None]
) -> None:
    encoded = client.post("/encode", content=photo).json()
    link, weights = encoded["links"]["self"], client.get(encoded["links"]["weights"])
    answers = [
        weights,
        client.get(f"{link}/points"),
        client.get(f"{link}/mesh"),
        client.get(f"{link}/picture"),
        client.get("/openapi.json"),  # counts among the answers
        client.post(f"{link}/path", json={"start": [-0.9, 0, 0], "goal": [0.9, 0, 0]}),
        client.post("/objects", content=weights.content),
        client.post("/compose", json={"objects": [encoded["id"]] * 2}),
        client.post("/v2/models/tiny-k2/infer", content=b"{}"),
    ]
    assert [answer.status_code for answer in answers] == [200, 200, 200, 200, 200, 200, 201, 201, 422]
    assert len(clients) > len(answers)
    assert set(clients) == {"127.0.0.1"}


def test_measuring_an_object_of_an_older_version_counts_for_the_client_of_its_photo(
    client: httpx.Client, photo: bytes, clients: list[str | None], settings: Settings
) -> None:
    new = client.post("/encode", content=photo).json()
    with closing(sqlite3.connect(settings.database_url.removeprefix("sqlite:///"))) as connection, connection:
        connection.execute("UPDATE objects SET frame = NULL")
    clients.clear()
    assert client.post("/encode", content=photo).json() == new
    assert clients == ["127.0.0.1"] * 3  # image, upload, points of the box
