"""ETag, If-None-Match and Cache-Control over a real socket."""

import httpx
import pytest

from service.api.wire.caching import CACHE_CONTROL, accepts_gzip, etag, is_fresh
from service.mapping.cloud import Cloud, Part
from service.mapping.spec import Array

KINDS = ["points", "weights"]


@pytest.fixture
def links(client: httpx.Client, photo: bytes) -> dict[str, str]:
    links: dict[str, str] = client.post("/encode", content=photo).json()["links"]
    return links


@pytest.mark.parametrize("kind", KINDS)
def test_file_with_a_matching_etag_answers_304_without_a_body(
    client: httpx.Client, links: dict[str, str], kind: str
) -> None:
    first = client.get(links[kind])
    assert first.headers["ETag"].startswith('W/"')
    assert first.headers["Cache-Control"] == CACHE_CONTROL
    again = client.get(links[kind], headers={"If-None-Match": first.headers["ETag"]})
    assert (again.status_code, again.content) == (304, b"")
    assert again.headers["ETag"] == first.headers["ETag"]
    assert again.headers["Cache-Control"] == CACHE_CONTROL
    assert client.get(links[kind], headers={"If-None-Match": '"other"'}).content == first.content


def test_points_with_a_matching_etag_sample_nothing(
    client: httpx.Client, links: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    tag = client.get(links["points"]).headers["ETag"]

    def fail(self: Cloud, part: Part) -> Array:
        raise AssertionError("a point was sampled")

    monkeypatch.setattr(Cloud, "points", fail)
    assert client.get(links["points"], headers={"If-None-Match": tag}).status_code == 304


@pytest.mark.parametrize("name", ["safetensors", "npy", "json", "onnx"])
def test_head_of_weights_computes_no_file(
    client: httpx.Client, links: dict[str, str], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    link = f"{links['weights']}?format={name}"
    full = client.get(link)

    def fail(*_: object) -> bytes:
        raise AssertionError("a file was computed")

    monkeypatch.setattr("service.api.routes.weights.dump", fail)
    head = client.head(link)
    assert (head.status_code, head.content) == (200, b"")
    for header in ("etag", "cache-control", "content-type", "content-disposition"):
        assert head.headers[header] == full.headers[header]
    assert client.head(link, headers={"If-None-Match": full.headers["ETag"]}).status_code == 304


def test_etag_differs_for_every_parameter(client: httpx.Client, links: dict[str, str]) -> None:
    queries = ["", "?n=11", "?seed=1", "?offset=5", "?scale=2", "?format=npy", "?format=f32", "?format=f16"]
    tags = {client.head(links["points"] + query).headers["ETag"] for query in queries}
    assert len(tags) == len(queries)


def test_etag_follows_the_negotiated_format(client: httpx.Client, links: dict[str, str]) -> None:
    ply, glb = (client.head(links["points"], headers={"Accept": a}) for a in ("model/ply", "model/gltf-binary"))
    assert ply.headers["ETag"] != glb.headers["ETag"]
    assert ply.headers["Vary"] == "Accept, Accept-Encoding"
    assert glb.headers["ETag"] == client.head(links["points"] + "?format=glb").headers["ETag"]


@pytest.mark.parametrize("kind", KINDS)
def test_file_of_a_deleted_object_with_an_etag_answers_404(
    client: httpx.Client, links: dict[str, str], kind: str
) -> None:
    tag = client.get(links[kind]).headers["ETag"]
    client.delete(links["self"])
    assert client.get(links[kind], headers={"If-None-Match": tag}).status_code == 404


@pytest.mark.parametrize(
    ("header", "fresh"),
    [
        ('W/"a"', True),
        ('"a"', True),
        ('"b", W/"a"', True),
        ("*", True),
        ('"b"', False),
        ('W/"ab"', False),
        ("a", False),
        ("", False),
        (None, False),
    ],
)
def test_is_fresh_compares_weakly(header: str | None, fresh: bool) -> None:
    assert is_fresh(header, 'W/"a"') is fresh


@pytest.mark.parametrize("name", ["xyz", "json"])
def test_text_points_with_accept_encoding_gzip_are_compressed(
    client: httpx.Client, links: dict[str, str], name: str
) -> None:
    path = f"{links['points']}?format={name}&n=20000"
    plain, squeezed = (client.get(path, headers={"Accept-Encoding": coding}) for coding in ("identity", "gzip"))
    assert "content-encoding" not in plain.headers
    assert squeezed.headers["content-encoding"] == "gzip"
    assert squeezed.content == plain.content  # httpx unpacks it
    assert squeezed.num_bytes_downloaded < 0.6 * plain.num_bytes_downloaded
    assert squeezed.headers["ETag"] != plain.headers["ETag"]
    assert client.head(path, headers={"Accept-Encoding": "gzip"}).headers["content-encoding"] == "gzip"


@pytest.mark.parametrize("kind", ["points?format=json", "points?format=xyz", "mesh?resolution=8"])
def test_head_of_a_file_of_unknown_length_has_no_content_length(
    client: httpx.Client, links: dict[str, str], kind: str
) -> None:
    link, query = kind.split("?")
    answer = client.head(f"{links[link]}?{query}", headers={"Accept-Encoding": "identity"})
    assert answer.status_code == 200
    assert "content-length" not in answer.headers
    assert client.get("/health/live").status_code == 200  # on the same connection


def test_binary_points_with_accept_encoding_gzip_are_not_compressed(
    client: httpx.Client, links: dict[str, str]
) -> None:
    for name in ("ply", "npy", "glb", "f32"):
        answer = client.get(f"{links['points']}?format={name}", headers={"Accept-Encoding": "gzip"})
        assert "content-encoding" not in answer.headers
        assert int(answer.headers["content-length"]) == len(answer.content)


@pytest.mark.parametrize(
    ("header", "accepted"),
    [
        ("gzip", True),
        ("br, GZIP;q=0.5", True),
        ("x-gzip", True),
        ("gzip;q=0", False),
        ("gzip; q=0.0", False),
        ("br, zstd", False),
        ("", False),
        (None, False),
    ],
)
def test_accepts_gzip_returns_whether_gzip_is_allowed(header: str | None, accepted: bool) -> None:
    assert accepts_gzip(header) is accepted


def test_etag_differs_for_different_parts() -> None:
    assert etag("a", 1) != etag("a", 2) != etag("a", "2")
    assert etag("a", 1) == etag("a", 1)
