"""Gates that routes declare."""

from collections.abc import Iterator
from contextlib import contextmanager

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


def test_work_of_every_call_counts_for_its_client(
    client: httpx.Client, photo: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    clients, admit = list[str | None](), Gate.admit

    @contextmanager
    def recorded(gate: Gate, amount: int = 1, client: str | None = None) -> Iterator[Admitted]:
        clients.append(client)
        with admit(gate, amount, client) as admitted:
            yield admitted

    monkeypatch.setattr(Gate, "admit", recorded)
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
