"""POST /objects/{id}/path over a real socket."""

import io
import struct
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import trimesh

from service.api.routes.paths import PlannedPath
from service.planning.path import CELLS, points_for
from service.settings import Settings
from tests.support.gltf import check_valid
from tests.support.server import check_refused, running
from tests.support.small.ball import ball_file
from tests.support.small.model import CARD

AROUND: dict[str, Any] = {"start": [-0.9, 0.1, 0.01], "goal": [0.9, 0.1, 0.01]}
PAST: dict[str, Any] = {"start": [-0.9, 0.8, 0], "goal": [0.9, 0.8, 0]}


@pytest.fixture
def link(client: httpx.Client) -> str:
    return str(client.post("/objects", content=ball_file()).json()["links"]["self"])


def _plan(client: httpx.Client, link: str, **body: object) -> dict[str, Any]:
    answer = client.post(f"{link}/path", json=body)
    assert answer.status_code == 200, answer.text
    assert PlannedPath.model_validate_json(answer.content, extra="forbid")
    planned: dict[str, Any] = answer.json()
    return planned


def test_path_around_an_object_leads_from_start_to_goal(client: httpx.Client, link: str) -> None:
    planned = _plan(client, link, **AROUND)
    waypoints = np.array(planned["path"])
    assert [planned["path"][0], planned["path"][-1]] == [AROUND["start"], AROUND["goal"]]
    assert (planned["straight"], planned["reason"]) == (False, None)
    assert planned["length"] == pytest.approx(np.linalg.norm(np.diff(waypoints, axis=0), axis=1).sum())
    assert 2 < planned["length"] < 2.6


def test_path_past_an_object_is_straight(client: httpx.Client, link: str) -> None:
    planned = _plan(client, link, **PAST, cells=32.0)
    assert (planned["path"], planned["straight"]) == ([PAST["start"], PAST["goal"]], True)


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        (AROUND | {"start": [0.49, 0, 0]}, "start inside"),
        (AROUND | {"goal": [0, 0.49, 0]}, "goal inside"),
        (AROUND | {"goal": [0, 0, 0]}, "enclosed"),
        (AROUND | {"clearance": 5}, "start inside"),
    ],
)
def test_path_without_a_way_is_null_with_a_reason(
    client: httpx.Client, link: str, body: dict[str, Any], reason: str
) -> None:
    assert _plan(client, link, **body) == {"path": None, "length": None, "straight": False, "reason": reason}
    check_refused(
        client.post(f"{link}/path?format=glb", json=body), reason.split()[0].replace("enclosed", "goal"), "json"
    )


def test_path_keeps_the_clearance_from_the_points_that_it_names(client: httpx.Client, link: str) -> None:
    cells, clearance = 32, 0.2
    planned = _plan(client, link, **AROUND, cells=cells, clearance=clearance)
    query: dict[str, Any] = {"n": points_for(cells), "sampling": "sobol", "format": "npy"}
    points = np.load(io.BytesIO(client.get(f"{link}/points", params=query).content))
    places = np.concatenate(
        [np.linspace(a, b, 50) for a, b in zip(planned["path"][:-1], planned["path"][1:], strict=True)]
    )
    nearest = min(float(np.linalg.norm(points - place, axis=1).min()) for place in places)
    assert clearance - 1e-5 <= nearest < clearance + 0.15


def test_path_with_scale_is_the_same_path_scaled(client: httpx.Client, link: str) -> None:
    single = _plan(client, link, **AROUND, clearance=0.1)
    double = _plan(client, link, start=[-1.8, 0.2, 0.02], goal=[1.8, 0.2, 0.02], clearance=0.2, scale=2)
    np.testing.assert_allclose(double["path"], 2 * np.array(single["path"]))
    assert double["length"] == pytest.approx(2 * single["length"])


def test_path_in_the_raw_frame_is_the_same_path_in_the_functions_numbers(client: httpx.Client) -> None:
    center, radius = np.array([3.0, -1.0, 2.0]), 4.0  # longest side 8
    link = client.post("/objects", content=ball_file((3, -1, 2), radius)).json()["links"]["self"]
    framed = _plan(client, link, **AROUND)
    ends = {name: (8 * np.array(AROUND[name]) + center).tolist() for name in ("start", "goal")}
    raw = _plan(client, link, **ends, frame="raw")
    assert [raw["path"][0], raw["path"][-1]] == [ends["start"], ends["goal"]]
    np.testing.assert_allclose(raw["path"], 8 * np.array(framed["path"]) + center, atol=0.02)
    check_refused(client.post(f"{link}/path", json=AROUND | {"frame": "raw", "start": [12, 0, 0]}), "start", "11")


def test_path_as_glb_is_a_line_through_the_waypoints(client: httpx.Client, link: str, tmp_path: Path) -> None:
    planned = _plan(client, link, **AROUND)
    answer = client.post(f"{link}/path?format=glb", json=AROUND)
    assert (answer.headers["content-type"], answer.headers["vary"]) == ("model/gltf-binary", "Accept")
    assert client.post(f"{link}/path", json=AROUND, headers={"Accept": "model/gltf-binary"}).content == answer.content
    report = check_valid(answer.content, tmp_path)
    assert report["info"]["totalVertexCount"] == 2 * (len(planned["path"]) - 1)
    scene = trimesh.load(io.BytesIO(answer.content), file_type="glb")
    (line,) = scene.geometry.values()
    assert isinstance(line, trimesh.path.Path3D)
    assert line.length == pytest.approx(planned["length"], rel=1e-5)
    (size,) = struct.unpack_from("<I", answer.content, 8)
    assert size == len(answer.content)


@pytest.mark.parametrize(
    ("body", "field", "limit"),
    [
        ({"goal": [0, 0, 0]}, "start", "required"),
        (AROUND | {"start": [0, 0]}, "start[2]", "required"),
        (AROUND | {"start": [0, 0, 0, 0]}, "start", "at most 3"),
        (AROUND | {"start": "0 0 0"}, "start", "array"),
        (AROUND | {"start": [0, "a", 0]}, "start[1]", "number"),
        (AROUND | {"start": [0, True, 0]}, "start[1]", "number"),
        (AROUND | {"start": [1.01, 0, 0]}, "start", "[1.01, 0, 0], it must lie between [-1, -1, -1] and [1, 1, 1]"),
        (AROUND | {"goal": [0, -1e300, 0]}, "goal", "between"),
        (AROUND | {"scale": 0.5}, "start", "between [-0.5, -0.5, -0.5] and [0.5, 0.5, 0.5]"),
        (AROUND | {"cells": CELLS[0] - 1}, "cells", str(CELLS[0])),
        (AROUND | {"cells": CELLS[1] + 1}, "cells", str(CELLS[1])),
        (AROUND | {"cells": 31.5}, "cells", "integer"),
        (AROUND | {"clearance": -0.1}, "clearance", "greater than or equal to 0"),
        (AROUND | {"clearance": None}, "clearance", "number"),
        (AROUND | {"scale": 0}, "scale", "greater"),
        (AROUND | {"frame": "camera"}, "frame", "'object' or 'raw'"),
        (AROUND | {"speed": 3}, "speed", "unknown"),
    ],
)
def test_path_with_a_bad_parameter_names_it_and_its_limit(
    client: httpx.Client, link: str, body: dict[str, Any], field: str, limit: str
) -> None:
    check_refused(client.post(f"{link}/path", json=body), field, limit)


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_path_with_a_number_that_is_not_finite_is_refused(client: httpx.Client, link: str, number: str) -> None:
    body = f'{{"start": [0, {number}, 0], "goal": [0, 0, 0]}}'
    answer = client.post(f"{link}/path", content=body)
    assert answer.status_code in (400, 422)
    assert answer.headers["content-type"] == "application/problem+json"


@pytest.mark.parametrize(
    ("content", "status"), [(b"", 400), (b"{", 400), (b"\xff", 400), (b"[]", 422), (b"null", 422), (b" " * 5000, 413)]
)
def test_path_with_a_bad_body_is_refused(client: httpx.Client, link: str, content: bytes, status: int) -> None:
    answer = client.post(f"{link}/path", content=content)
    assert (answer.status_code, answer.headers["content-type"]) == (status, "application/problem+json")


@pytest.mark.parametrize("object_id", ["0" * 32, "nothing"])
def test_path_of_an_unknown_object_answers_404(client: httpx.Client, object_id: str) -> None:
    assert client.post(f"/objects/{object_id}/path", json=AROUND).status_code == 404


def test_path_with_an_unsatisfiable_accept_answers_406(client: httpx.Client, link: str) -> None:
    answer = client.post(f"{link}/path", json=AROUND, headers={"Accept": "text/plain"})
    assert (answer.status_code, answer.headers["content-type"]) == (406, "application/problem+json")
    check_refused(client.post(f"{link}/path?format=ply", json=AROUND), "format", "'json' or 'glb'")
    check_refused(client.post(f"{link}/path?n=3", json=AROUND), "n", "unknown")


def test_path_by_get_answers_405(client: httpx.Client, link: str) -> None:
    answer = client.get(f"{link}/path")
    assert (answer.status_code, answer.headers["allow"]) == (405, "POST")


def test_path_of_encoded_and_composed_objects_exists(client: httpx.Client, photo: bytes) -> None:
    first = client.post("/encode", content=photo).json()
    word = client.post("/compose", json={"objects": [first["id"]] * first["spec"]["k"]}).json()
    assert CARD["name"] == first["model"]
    for each in (first, word):
        assert _plan(client, each["links"]["self"], start=[-1, -1, -1], goal=[1, 1, 1])["path"]


def test_path_over_the_limits_of_points_is_refused(settings: Settings) -> None:
    with (
        running(settings.model_copy(update={"max_points": 1000})) as server,
        httpx.Client(base_url=f"http://127.0.0.1:{server.port}") as client,
    ):
        link = client.post("/objects", content=ball_file()).json()["links"]["self"]
        check_refused(client.post(f"{link}/path", json=AROUND), "cells", "16000")
