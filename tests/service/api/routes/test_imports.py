"""POST /objects over a real socket."""

import httpx
import numpy as np
import pytest

from service.formats.weights import Weights, dump, load
from service.mapping.spec import MappingSpec, initial_theta
from tests.support.small.objects import SPEC, compose, encode_discs, weights_file


def test_import_of_exported_weights_gives_an_object(client: httpx.Client) -> None:
    (object_id,) = encode_discs(client, "red")
    answer = client.get(f"/objects/{object_id}/weights")
    assert answer.headers["content-disposition"] == f'attachment; filename="hof-{object_id}.safetensors"'
    posted = client.post("/objects", content=answer.content)
    item = posted.json()
    assert (posted.status_code, posted.headers["location"]) == (201, f"/objects/{item['id']}")
    assert (item["kind"], item["model"]) == ("imported", "tiny-k2")
    assert item["id"] != object_id
    points = [client.get(f"/objects/{each}/points?n=100").content for each in (object_id, item["id"])]
    assert points[0] == points[1]
    again = client.post("/objects", content=answer.content)
    assert (again.status_code, again.json()) == (200, item)


def test_import_keeps_the_spec_and_model_of_the_file(client: httpx.Client) -> None:
    item = client.post("/objects", content=weights_file()).json()
    assert (item["model"], item["spec"]["k"], item["spec"]["domain"]) == ("elsewhere", 3, "cube")
    weights = load(client.get(item["links"]["weights"]).content)
    assert (weights.spec, weights.model) == (SPEC, "elsewhere")
    np.testing.assert_array_equal(weights.theta, initial_theta(SPEC))
    other = client.post("/objects", content=weights_file(1)).json()
    assert other["id"] != item["id"]


def test_import_again_adds_the_label_that_the_object_lacks_and_changes_none(client: httpx.Client) -> None:
    files = [
        dump(Weights(SPEC, initial_theta(SPEC), "elsewhere", label=label), "safetensors")
        for label in (None, "👩‍🚀 stool", "chair")
    ]
    plain = client.post("/objects", content=files[0]).json()
    labeled = client.post("/objects", content=files[1])
    assert (labeled.status_code, labeled.json()) == (200, plain | {"label": "👩‍🚀 stool"})
    assert client.post("/objects", content=files[2]).json() == labeled.json()
    assert client.get(f"/objects/{plain['id']}").json()["label"] == "👩‍🚀 stool"


@pytest.mark.parametrize("label", ["x" * 81, "two\nlines", "\x1b[31m", "\ud800"])
def test_import_of_a_faulty_label_is_refused(client: httpx.Client, label: str) -> None:
    file = dump(Weights(SPEC, initial_theta(SPEC), "elsewhere", label=label), "safetensors")
    answer = client.post("/objects", content=file)
    assert (answer.status_code, answer.json()["title"]) == (400, "Corrupt weights")
    assert '"label" in the metadata: the label' in answer.json()["detail"]
    assert client.get("/objects").json()["items"] == []


RELU = MappingSpec("relu", 3, (8,), 3, k=4)


@pytest.mark.parametrize(
    ("body", "status"),
    [
        (b"", 400),
        (b"nonsense", 400),
        (weights_file()[:-1], 400),
        (weights_file() + b"x", 400),
        (bytes(100_001), 413),
        (weights_file().replace(b'\\"k\\":3', b'\\"k\\":0'), 422),
        (weights_file().replace(b"cube", b"conn"), 422),
        (dump(Weights(RELU, np.full(RELU.size, 1e30, np.float32), "overflows"), "safetensors"), 400),
    ],
)
def test_import_of_bad_weights_is_refused_and_stores_nothing(client: httpx.Client, body: bytes, status: int) -> None:
    answer = client.post("/objects", content=body)
    assert (answer.status_code, answer.json()["status"]) == (status, status)
    assert client.get("/objects").json()["items"] == []


def test_import_of_a_composed_file_is_refused(client: httpx.Client) -> None:
    item = compose(client, *encode_discs(client, "red", "green"))
    answer = client.post("/objects", content=client.get(item["links"]["weights"]).content)
    assert answer.status_code == 422
    assert "composed" in answer.json()["detail"]
    assert {item["kind"] for item in client.get("/objects").json()["items"]} == {"encoded", "composed"}
