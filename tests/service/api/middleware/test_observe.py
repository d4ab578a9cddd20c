"""Observation of requests: ids, and metrics whose series do not grow."""

import re
import socket
import uuid

import httpx
import pytest
from prometheus_client.parser import text_string_to_metric_families

from service.api.middleware.observe import Templates
from tests.support.photos import disc, image_file
from tests.support.server import Server
from tests.support.slow import until


def figures(client: httpx.Client) -> dict[tuple[str, ...], float]:
    """/metrics as {(name, label values ...): value}."""
    families = text_string_to_metric_families(client.get("/metrics").text)
    return {(s.name, *s.labels.values()): s.value for family in families for s in family.samples}


def test_metrics_series_for_any_path_grow_with_routes_only(client: httpx.Client) -> None:
    def ask() -> None:
        client.get(f"/objects/{uuid.uuid4().hex}")
        client.get(f"/objects/{uuid.uuid4().hex}/points")
        client.get(f"/{uuid.uuid4().hex}")
        client.get(f"/viewer/{uuid.uuid4().hex}.js")
        client.request("PROPFIND", f"/objects/{uuid.uuid4().hex}")

    for _ in range(2):  # the second has the figures of /metrics itself
        ask()
        before = figures(client)
    for _ in range(50):
        ask()
    after = figures(client)
    assert after.keys() == before.keys()
    assert after["hof_http_requests_total", "GET", "/objects/{id}", "404"] == 52
    assert after["hof_http_requests_total", "GET", "unknown", "404"] == 52


def test_templates_of_ten_thousand_ids_give_one_template() -> None:
    templates = Templates(["/", "/objects", "/objects/{id}", "/objects/{id}/points", "/viewer/{path:path}"])
    assert {templates.of(f"/objects/{index:032x}") for index in range(10_000)} == {"/objects/{id}"}
    assert {templates.of(f"/{index:032x}") for index in range(10_000)} == {None}
    assert templates.of("/objects") == "/objects"
    assert templates.of("/objects/x/points") == "/objects/{id}/points"
    assert templates.of("/objects/x/points/y") is None
    assert templates.of("/viewer/a/b.js") == "/viewer/{path:path}"


def test_metrics_of_a_request_separate_waiting_from_computing(client: httpx.Client, photo: bytes) -> None:
    before = figures(client)
    link = client.post("/encode", content=photo).json()["links"]["points"]
    encoded = figures(client)
    client.get(link, params={"n": 100_000})
    sampled = figures(client)
    counts = [each["hof_compute_seconds_count",] for each in (before, encoded, sampled)]
    assert counts[0] < counts[1] < counts[2]
    assert sampled["hof_queue_seconds_count",] == counts[2]
    assert sampled["hof_queue_seconds_sum",] > 0
    assert sampled["hof_compute_seconds_sum",] > 0
    assert sampled["hof_http_requests_in_flight",] == 1  # /metrics itself
    assert sampled["hof_http_requests_total", "POST", "/encode", "201"] == 1


def test_metrics_of_a_client_that_leaves_count_it_as_cancelled(
    server: Server, client: httpx.Client, photo: bytes
) -> None:
    link = client.post("/encode", content=photo).json()["links"]["points"]
    with socket.create_connection(("127.0.0.1", server.port)) as leaver:
        leaver.sendall(f"GET {link}?n=10000000 HTTP/1.1\r\nHost: x\r\n\r\n".encode())
        assert leaver.recv(100).startswith(b"HTTP/1.1 200 OK")
    left = ("hof_http_requests_total", "GET", "/objects/{id}/points", "499")
    while left not in (values := figures(client)):
        pass
    assert values[left] == values["hof_http_unserved_total", "cancelled"] == 1
    assert values["hof_http_unserved_total", "failed"] == 0
    assert ("hof_http_requests_total", "GET", "/objects/{id}/points", "200") not in values


def test_fault_is_counted_and_answered_with_the_request_id(
    client: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def broken(*_: object) -> None:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr("service.storage.store.Store.page", broken)
    answer = client.get("/objects", headers={"X-Request-ID": "mine"})
    assert (answer.status_code, answer.headers["x-request-id"]) == (500, "mine")
    assert answer.headers["x-content-type-options"] == "nosniff"
    until(lambda: figures(client)["hof_http_unserved_total", "failed"] == 1)  # it counts after it has answered
    assert figures(client)["hof_http_requests_total", "GET", "/objects", "500"] == 1


@pytest.mark.parametrize(
    "path", ["/", "/objects", "/objects/x", "/nope", "/viewer/js/main.js", "/health/live", "/metrics"]
)
def test_request_id_is_on_every_answer(client: httpx.Client, path: str) -> None:
    assert client.get(path, headers={"X-Request-ID": "a-1_2.3:4"}).headers["x-request-id"] == "a-1_2.3:4"
    ids = [client.get(path).headers["x-request-id"] for _ in range(2)]
    assert ids[0] != ids[1]
    assert all(re.fullmatch("[0-9a-f]{32}", each) for each in ids)


@pytest.mark.parametrize("odd", ["", "a b", "<script>", "x" * 129, "a\tb", "é".encode().decode("latin-1")])
def test_request_id_that_is_unsafe_is_replaced(client: httpx.Client, odd: str) -> None:
    answer = client.get("/health/live", headers={b"X-Request-ID": odd.encode("latin-1")})
    assert re.fullmatch("[0-9a-f]{32}", answer.headers["x-request-id"])


def test_metrics_with_accept_openmetrics_answer_openmetrics(client: httpx.Client) -> None:
    assert client.get("/metrics").headers["content-type"].startswith("text/plain")
    answer = client.get("/metrics", headers={"Accept": "application/openmetrics-text; version=1.0.0"})
    assert answer.headers["content-type"].startswith("application/openmetrics-text")
    assert answer.text.endswith("# EOF\n")


def test_metrics_include_build_and_process(client: httpx.Client) -> None:
    values = figures(client)
    assert any(name[0] == "hof_build_info" for name in values)
    assert values["process_resident_memory_bytes",] > 0
    client.post("/encode", content=image_file(disc("blue")))
    assert values["hof_http_unserved_total", "shed"] == 0
