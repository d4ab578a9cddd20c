"""POST /compose over a real socket: words, means, what is refused, and what composed objects give."""

import io
import itertools
from concurrent.futures import ThreadPoolExecutor

import httpx
import numpy as np
import pytest

from service import mapping
from service.errors import InvalidParameter
from service.formats.weights import Weights, dump, load
from service.mapping.canonical import canonical_points
from service.mapping.spec import Array, MappingSpec, initial_theta
from service.runtime.composition import MAX_WORDS, Member, check_members
from tests.support.small.objects import SPEC, encode_discs
from tests.support.systems.postgres import EVERY_DATABASE

UNKNOWN = "0" * 32


def _post(client: httpx.Client, spec: MappingSpec = SPEC, seed: int = 0, model: str = "m", factor: float = 1) -> str:
    """Import an object and return its id."""
    theta = np.float32(factor) * initial_theta(spec, seed)
    answer = client.post("/objects", content=dump(Weights(spec, theta, model), "safetensors"))
    assert answer.status_code in (200, 201), answer.text
    return str(answer.json()["id"])


def _compose(client: httpx.Client, *ids: str, mode: str = "compose") -> httpx.Response:
    return client.post("/compose", json={"objects": ids, "mode": mode})


def _points(client: httpx.Client, object_id: str, n: int = 300) -> Array:
    answer = client.get(f"/objects/{object_id}/points", params={"n": n, "format": "npy", "frame": "raw"})
    points: Array = np.load(io.BytesIO(answer.content))
    return points


def _count(client: httpx.Client) -> int:
    return len(client.get("/objects").json()["items"])


# Composed and interpolated objects


def test_compose_applies_the_last_function_first(client: httpx.Client) -> None:
    ids = [_post(client, seed=seed) for seed in range(3)]
    answer = _compose(client, *ids)
    composed = answer.json()
    assert (answer.status_code, answer.headers["location"]) == (201, f"/objects/{composed['id']}")
    thetas = [initial_theta(SPEC, seed) for seed in range(3)]
    expected = mapping.compose(SPEC, thetas, canonical_points(SPEC.domain, 300, 0))
    np.testing.assert_allclose(_points(client, composed["id"]), expected, atol=1e-6)
    assert np.abs(_points(client, _compose(client, *ids[::-1]).json()["id"]) - expected).max() > 1e-3


def test_compose_returns_the_composed_object(client: httpx.Client) -> None:
    a, b = encode_discs(client, "red", "green")
    item = client.post("/compose", json={"objects": [a, b]}).json()
    one = client.get(f"/objects/{a}").json()
    assert item == {
        "id": item["id"],
        "kind": "composed",
        "created_at": item["created_at"],
        "model": "tiny-k2",
        "spec": one["spec"],
        "word": [a, b],
        "bytes": 2 * 460,
        "dimensions": item["dimensions"],
        "frame": item["frame"],
        "links": {key: link.replace(a, item["id"]) for key, link in one["links"].items()},
    }
    assert client.get(item["links"]["self"]).json() == item
    assert client.get("/objects").json()["items"][0] == item
    assert "word" not in one
    assert item["frame"] != one["frame"]
    assert max(item["dimensions"]) == 1
    for link in item["links"].values():
        assert client.get(link).status_code == 200


def test_compose_all_returns_words_in_lexicographic_order(client: httpx.Client) -> None:
    a, b = _post(client, seed=1), _post(client, seed=2)
    answer = _compose(client, a, b, mode="all")
    words = answer.json()["objects"]
    assert answer.status_code == 201
    assert "location" not in answer.headers
    assert [item["word"] for item in words] == [list(word) for word in itertools.product((a, b), repeat=3)]
    assert len({item["id"] for item in words}) == 8
    np.testing.assert_array_equal(_points(client, words[0]["id"]), _points(client, a))
    np.testing.assert_array_equal(_points(client, words[-1]["id"]), _points(client, b))
    aab = _compose(client, a, a, b)
    assert (aab.status_code, aab.json()) == (200, words[1])


def test_compose_all_makes_only_missing_words(client: httpx.Client) -> None:
    a, b = encode_discs(client, "red", "green")
    ab = _compose(client, a, b).json()
    answer = _compose(client, a, b, mode="all")
    assert answer.status_code == 201
    assert answer.json()["objects"][1] == ab
    assert _count(client) == 2 + 4


def test_compose_interpolate_averages_theta(client: httpx.Client) -> None:
    a, b = _post(client, seed=1, model="one"), _post(client, seed=2, model="two")
    answer = _compose(client, a, b, b, mode="interpolate")
    item = answer.json()
    assert (answer.status_code, answer.headers["location"]) == (201, item["links"]["self"])
    assert (item["kind"], item["parents"], item["model"]) == ("interpolated", [a, b, b], "one + two")
    assert "word" not in item
    weights = load(client.get(item["links"]["weights"]).content)
    mean = (initial_theta(SPEC, 1).astype(np.float64) + 2 * initial_theta(SPEC, 2).astype(np.float64)) / 3
    np.testing.assert_allclose(weights.theta, mean, rtol=1e-6)
    assert item["bytes"] == weights.theta.nbytes
    expected = mapping.power(SPEC, weights.theta, canonical_points(SPEC.domain, 300, 0))
    np.testing.assert_allclose(_points(client, item["id"]), expected, atol=1e-6)
    again = client.post("/objects", content=client.get(item["links"]["weights"]).content)
    assert again.json()["kind"] == "imported"


def test_compose_of_an_interpolated_object_makes_a_word(client: httpx.Client) -> None:
    a, b = encode_discs(client, "red", "green")
    mean = _compose(client, a, b, mode="interpolate").json()["id"]
    assert _compose(client, a, mean).json()["word"] == [a, mean]


@pytest.mark.parametrize("mode", ["compose", "interpolate", "all"])
def test_compose_repeated_answers_200_with_the_same_objects(client: httpx.Client, mode: str) -> None:
    a, b = encode_discs(client, "red", "green")
    first = _compose(client, a, b, mode=mode)
    count = _count(client)
    again = _compose(client, a, b, mode=mode)
    assert (first.status_code, again.status_code) == (201, 200)
    assert again.json() == first.json()
    assert "location" not in again.headers
    assert _count(client) == count


def test_compose_ids_differ_by_mode_and_order(client: httpx.Client) -> None:
    a, b = encode_discs(client, "red", "green")
    calls = [((a, b), "compose"), ((b, a), "compose"), ((a, b), "interpolate"), ((a, a, b), "interpolate")]
    assert len({_compose(client, *ids, mode=mode).json()["id"] for ids, mode in calls}) == 4


# What is refused


def _refused(answer: httpx.Response, status: int, field: str | None) -> str:
    problem = answer.json()
    assert (answer.status_code, problem["status"]) == (status, status), problem
    assert [error["field"] for error in problem.get("errors", [])] == ([field] if field else [])
    return str(problem["detail"])


@pytest.mark.parametrize("mode", ["compose", "interpolate", "all"])
@pytest.mark.parametrize("unknown", [UNKNOWN, "x", "", "\0", "A" * 32, "é" * 500])
def test_compose_with_an_unknown_id_answers_404_and_names_it(client: httpx.Client, mode: str, unknown: str) -> None:
    (a,) = encode_discs(client, "red")
    detail = _refused(_compose(client, a, unknown, mode=mode), 404, "objects[1]")
    assert detail == f"objects[1]: no object has the id {unknown!r}"
    assert _count(client) == 1


@pytest.mark.parametrize("mode", ["compose", "interpolate", "all"])
def test_compose_of_a_composed_object_is_refused(client: httpx.Client, mode: str) -> None:
    a, b = encode_discs(client, "red", "green")
    ab = _compose(client, a, b).json()["id"]
    assert "objects[1] is composed" in _refused(_compose(client, a, ab, mode=mode), 422, "objects[1]")


@pytest.mark.parametrize("mode", ["compose", "interpolate", "all"])
def test_compose_with_different_specs_is_refused(client: httpx.Client, mode: str) -> None:
    a, other = _post(client), _post(client, SPEC.with_k(2))
    detail = _refused(_compose(client, a, a, other, mode=mode), 422, "objects[2]")
    assert detail == "objects[2] has the k 2, objects[0] 3: specs must be equal"


def test_compose_with_a_wrong_number_of_objects_is_refused(client: httpx.Client) -> None:
    a = _post(client)
    for count in (1, 2, 4):
        assert _refused(_compose(client, *[a] * count), 422, "objects") == f"a word needs k = 3 objects, not {count}"
    for count in (1, 3):
        assert "two objects" in _refused(_compose(client, *[a] * count, mode="all"), 422, "objects")
    assert "two objects or more" in _refused(_compose(client, a, mode="interpolate"), 422, "objects")
    assert "objects[0]" in _refused(_compose(client, a, a, mode="all"), 422, "objects[1]")


def test_compose_with_k_of_1_allows_interpolate_only(client: httpx.Client) -> None:
    a, b = _post(client, SPEC.with_k(1), 1), _post(client, SPEC.with_k(1), 2)
    assert "k is 1" in _refused(_compose(client, a), 422, "objects")
    assert "k is 1" in _refused(_compose(client, a, b, mode="all"), 422, "objects")
    assert _compose(client, a, b, mode="interpolate").status_code == 201


def test_check_members_with_too_many_words_raises() -> None:
    members = [Member(name, SPEC.with_k(8), is_composed=False) for name in "ab"]
    check_members(members, "all")
    members = [Member(name, SPEC.with_k(9), is_composed=False) for name in "ab"]
    with pytest.raises(InvalidParameter, match=f"2\\^9 words, at most {MAX_WORDS}"):
        check_members(members, "all")


@pytest.mark.parametrize("mode", ["compose", "all"])
def test_compose_over_float32_is_refused_and_keeps_nothing(client: httpx.Client, mode: str) -> None:
    spec = MappingSpec("tiny", 3, (16,), 3, k=2)
    ids = []
    for gain, constant in ((1e5, 0), (0, 1e20)):  # f_A f_A and f_B f_B are finite, f_A f_B is not
        theta = np.zeros(spec.size, np.float32)
        (w, _), (v, c) = mapping.layers(spec, theta)
        w[:], v[:], c[:] = gain, gain, constant
        answer = client.post("/objects", content=dump(Weights(spec, theta, "m"), "safetensors"))
        ids.append(answer.json()["id"])
    assert "exceed float32" in _refused(_compose(client, *ids, mode=mode), 422, "objects")
    assert _count(client) == 2


@pytest.mark.parametrize(
    ("body", "status", "field"),
    [
        (b"", 400, None),
        (b"{", 400, None),
        (b'{"objects": ["\\ud800"]}', 400, None),
        (b"[" * 10_000, 400, None),
        (b"\xff", 400, None),
        (b"[]", 422, ""),
        (b"{}", 422, "objects"),
        (b'{"objects": []}', 422, "objects"),
        (b'{"objects": "ab"}', 422, "objects"),
        (b'{"objects": ["a", 7]}', 422, "objects[1]"),
        (b'{"objects": [null]}', 422, "objects[0]"),
        (b'{"objects": [' + b",".join([b'"a"'] * 17) + b"]}", 422, "objects"),
        (b'{"objects": ["a", "b"], "mode": "mix"}', 422, "mode"),
        (b'{"objects": ["a", "b"], "mode": null}', 422, "mode"),
        (b'{"objects": ["a", "b"], "k": 2}', 422, "k"),
        (b" " * 20_000, 413, None),
    ],
    ids=lambda value: str(value)[:40],
)
def test_compose_with_a_bad_body_is_refused(client: httpx.Client, body: bytes, status: int, field: str | None) -> None:
    answer = client.post("/compose", content=body)
    problem = answer.json()
    assert (answer.status_code, problem["status"]) == (status, status), problem
    assert [error["field"] for error in problem.get("errors", [])] == ([] if field is None else [field])


def test_compose_with_a_query_is_refused(client: httpx.Client) -> None:
    a, b = encode_discs(client, "red", "green")
    answer = client.post("/compose?mode=all", json={"objects": [a, b]})
    _refused(answer, 422, "mode")


# While others delete


@EVERY_DATABASE
def test_compose_during_a_deletion_leaves_no_dangling_word(client: httpx.Client) -> None:
    (b,) = encode_discs(client, "green")
    outcomes = set()
    with ThreadPoolExecutor(4) as pool:
        for _ in range(20):
            (a,) = encode_discs(client, "red")
            composing = [pool.submit(_compose, client, a, b, mode="all") for _ in range(2)]
            deleting = [pool.submit(client.delete, f"/objects/{a}") for _ in range(2)]
            composed, deleted = ({each.result().status_code for each in calls} for calls in (composing, deleting))
            outcomes |= {(status, other) for status in composed for other in deleted}
            kept = client.get("/objects").json()["items"]
            there = {item["id"] for item in kept}
            for item in kept:
                assert set(item.get("word", [])) <= there
                assert client.get(item["links"]["points"], params={"n": 1}).status_code == 200
            for object_id in (*(item["id"] for item in kept if item["kind"] == "composed"), a):
                client.delete(f"/objects/{object_id}")
    assert {status for pair in outcomes for status in pair} <= {200, 201, 204, 404, 409}
