"""The stored objects over a real socket: list, get, delete."""

from datetime import UTC, datetime, timedelta

import httpx
import pytest

from service.settings import Settings
from tests.support.server import running
from tests.support.small.objects import compose, encode_discs


def test_object_read_returns_all_its_fields(client: httpx.Client) -> None:
    (object_id,) = encode_discs(client, "red")
    answer = client.get(f"/objects/{object_id}").json()
    created = datetime.fromisoformat(answer.pop("created_at"))
    assert abs(datetime.now(UTC) - created) < timedelta(minutes=1)
    assert max(answer.pop("dimensions")) == 1
    assert answer.pop("frame").keys() == {"low", "high"}
    image = answer.pop("image")
    assert (image["mask"], image["confidence"]) == ("border", 1)
    assert answer == {
        "id": object_id,
        "kind": "encoded",
        "model": "tiny-k2",
        "spec": {
            "name": "tiny",
            "input_dim": 3,
            "hidden": [16],
            "output_dim": 3,
            "activation": "relu",
            "k": 2,
            "domain": "ball",
        },
        "bytes": 460,
        "links": {
            "self": f"/objects/{object_id}",
            "points": f"/objects/{object_id}/points",
            "mesh": f"/objects/{object_id}/mesh",
            "weights": f"/objects/{object_id}/weights",
        },
    }
    for link in answer["links"].values():
        assert client.get(link).status_code == 200


def test_objects_list_is_newest_first_in_pages(client: httpx.Client) -> None:
    ids = encode_discs(client, "red", "green", "blue")
    first = client.get("/objects?limit=2").json()
    assert ([item["id"] for item in first["items"]], first["limit"]) == ([ids[2], ids[1]], 2)
    newer = encode_discs(client, "black")
    second = client.get("/objects", params={"limit": 2, "cursor": first["next"]}).json()
    assert ([item["id"] for item in second["items"]], second["next"]) == ([ids[0]], None)
    everything = client.get("/objects").json()
    assert [item["id"] for item in everything["items"]] == newer + ids[::-1]
    assert (everything["limit"], everything["next"]) == (50, None)


@pytest.mark.parametrize("query", ["limit=0", "limit=501", "limit=x", "cursor=x", "cursor=", "page=2"])
def test_objects_list_with_a_bad_page_is_refused(client: httpx.Client, query: str) -> None:
    answer = client.get(f"/objects?{query}")
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["field"] == query.split("=")[0]


def test_delete_of_an_object_removes_it_once(client: httpx.Client) -> None:
    red, green = encode_discs(client, "red", "green")
    answer = client.delete(f"/objects/{red}")
    assert (answer.status_code, answer.content) == (204, b"")
    for path in ("", "/points", "/weights"):
        assert client.get(f"/objects/{red}{path}").status_code == 404
    assert client.delete(f"/objects/{red}").status_code == 404
    assert [item["id"] for item in client.get("/objects").json()["items"]] == [green]
    assert encode_discs(client, "red") == [red]  # it can be made again


@pytest.mark.parametrize("object_id", ["0" * 32, "x", "0" * 31, "A" * 32, "%00", "0" * 32 + "%0A", "é", "a" * 5000])
@pytest.mark.parametrize("path", ["", "/points", "/weights"])
def test_object_with_an_unknown_id_answers_404(client: httpx.Client, object_id: str, path: str) -> None:
    answer = client.get(f"/objects/{object_id}{path}")
    assert (answer.status_code, answer.json()["title"]) == (404, "Not found")


def test_objects_after_a_restart_are_kept(settings: Settings, photo: bytes) -> None:
    clouds = []
    for _ in range(2):
        with running(settings) as server, httpx.Client(base_url=f"http://127.0.0.1:{server.port}") as client:
            answer = client.post("/encode", content=photo)
            clouds.append(client.get(answer.json()["links"]["points"]).content)
    assert answer.status_code == 200
    assert clouds[0] == clouds[1]


def test_delete_of_an_object_in_a_word_answers_409(client: httpx.Client) -> None:
    a, b, c = encode_discs(client, "red", "green", "blue")
    words = [compose(client, a, b)["id"], compose(client, b, b)["id"]]
    assert client.delete(f"/objects/{c}").status_code == 204
    refused = [client.delete(f"/objects/{each}") for each in (b, a)]
    assert [(answer.status_code, answer.json()["title"]) for answer in refused] == [(409, "In use")] * 2
    details = [answer.json()["detail"] for answer in refused]
    assert details[0] == f"composed objects use it: {words[0]}, {words[1]}; delete them first"
    assert words[1] not in details[1]
    for object_id in (*words, a, b):
        assert client.delete(f"/objects/{object_id}").status_code == 204
    assert client.get("/objects").json()["items"] == []


def test_interpolated_object_after_deleting_parents_is_kept(client: httpx.Client) -> None:
    a, b = encode_discs(client, "red", "green")
    mean = compose(client, a, b, mode="interpolate")
    before = client.get(mean["links"]["points"]).content
    assert [client.delete(f"/objects/{each}").status_code for each in (a, b)] == [204, 204]
    assert client.get(mean["links"]["self"]).json() == mean
    assert client.get(mean["links"]["points"]).content == before
