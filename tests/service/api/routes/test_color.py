"""Color over a real socket: points, meshes and weights of colored objects, words of them, and their files."""

import base64
import io
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import numpy.typing as npt
import pytest
import trimesh

from service import cli
from service.formats.points.registry import POINT_FORMATS
from service.formats.weights import Weights, dump, load
from service.mapping.canonical import canonical_points
from service.mapping.cloud import FIRST_PART
from service.mapping.spec import Array, Color, Colors, MappingSpec, apply, initial_theta
from tests.support.gltf import check_valid
from tests.support.photos import disc, image_file
from tests.support.small import model as tiny_model
from tests.support.small.colored_objects import check_none_leaves_color_out, encoded, file_of

N = FIRST_PART + 1000
SPEC = tiny_model.COLOR_SPEC


def _import(client: httpx.Client, seed: int, color: Array | None, spec: MappingSpec = SPEC) -> httpx.Response:
    theta = initial_theta(tiny_model.SPEC, seed)
    weights = Weights(tiny_model.SPEC, theta, "elsewhere", color=None if color is None else Color(spec, color))
    return client.post("/objects", content=dump(weights, "safetensors"))


def _weights(client: httpx.Client, item: dict[str, Any]) -> Weights:
    return load(client.get(item["links"]["weights"]).content)


def _file(client: httpx.Client, item: dict[str, Any], name: str = "json", **query: int | str) -> bytes:
    return file_of(client, item, "points", **{"format": name, "n": N, **query})


def _colors(client: httpx.Client, item: dict[str, Any], **query: int | str) -> Colors:
    return np.array(json.loads(_file(client, item, "json", **query))["colors"], np.uint8)


def _values(weights: Array, n: int = N, seed: int = 0) -> Array:
    """Values of a color function at the canonical points: sRGB in [0, 1]."""
    return np.clip(apply(SPEC, weights, canonical_points(SPEC.domain, n, seed)), 0, 1)


def _assert_close(colors: Colors, values: npt.NDArray[np.floating[Any]]) -> None:
    """Levels are those of values in [0, 1], but for rounding."""
    assert np.abs(colors.astype(np.float64) - 255 * values).max() < 0.502


def _random_color(seed: int) -> Array:
    weights = initial_theta(SPEC, seed)
    weights[-3:] += np.float32(0.5)
    return weights


# Files of a colored object


def test_points_with_color_are_those_of_the_color_function(colored: httpx.Client) -> None:
    item = encoded(colored)
    color = _weights(colored, item).color
    assert color
    expected = _values(color.weights, seed=7)
    assert (expected == 0).any() or (expected == 1).any()  # some are clipped
    assert expected.std() > 0.1
    _assert_close(_colors(colored, item, seed=7), expected)


def test_points_with_color_in_every_format_read_back_equal(colored: httpx.Client, tmp_path: Path) -> None:
    item = encoded(colored)
    content = json.loads(_file(colored, item))
    points, colors = np.float32(content["points"]), np.array(content["colors"], np.uint8)
    assert len(np.unique(colors, axis=0)) > 100
    ply = trimesh.load(io.BytesIO(_file(colored, item, "ply")), file_type="ply")
    np.testing.assert_array_equal(np.float32(ply.vertices), points)
    np.testing.assert_array_equal(ply.colors[:, :3], colors)
    _, _, body = _file(colored, item, "pcd").partition(b"DATA binary\n")
    rows = np.frombuffer(body, np.dtype([("point", "<f4", 3), ("bgr", "u1", 3), ("zero", "u1")]))
    np.testing.assert_array_equal(rows["point"], points)
    np.testing.assert_array_equal(rows["bgr"][:, ::-1], colors)
    for name in ("glb", "gltf"):
        data = _file(colored, item, name)
        assert check_valid(data, tmp_path)["info"]["totalVertexCount"] == N
        (cloud,) = trimesh.load_scene(io.BytesIO(data), file_type=name).geometry.values()
        np.testing.assert_array_equal(np.float32(cloud.vertices), points)
        linear = cloud.colors[:, :3] / 255  # trimesh hands on what glTF holds
        levels = colors / 255
        expected = np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)
        np.testing.assert_allclose(linear, expected, atol=0.5 / 255)


@pytest.mark.parametrize("name", ["ply", "npy", "glb", "gltf", "pcd", "f32", "f16"])
@pytest.mark.parametrize("n", [1, 1000, N])
def test_head_of_colored_points_has_the_exact_length(colored: httpx.Client, name: str, n: int) -> None:
    link = encoded(colored)["links"]["points"]
    query: dict[str, int | str] = {"format": name, "n": n}
    got, head = colored.get(link, params=query), colored.head(link, params=query)
    assert head.headers["content-length"] == got.headers["content-length"] == str(len(got.content))


@pytest.mark.parametrize("name", POINT_FORMATS)
def test_points_with_color_none_equal_those_without_color(
    client: httpx.Client, colored: httpx.Client, name: str
) -> None:
    holds_color = POINT_FORMATS[name].colored is not None
    check_none_leaves_color_out(client, colored, "points", holds_color, format=name, n=N)


def test_points_of_any_part_have_the_same_colors(colored: httpx.Client) -> None:
    item = encoded(colored)
    colors = _colors(colored, item, n=100_000, seed=3)
    for n in (1, FIRST_PART, FIRST_PART + 1, 70_000):
        np.testing.assert_array_equal(_colors(colored, item, n=n, seed=3), colors[:n])
        np.testing.assert_array_equal(
            _colors(colored, item, n=min(n, 50_000), seed=3, offset=20_001), colors[20_001:][: min(n, 50_000)]
        )
    assert len(_colors(colored, item, n=100, sampling="sobol")) == 100


def test_etag_differs_with_color(colored: httpx.Client) -> None:
    link = encoded(colored)["links"]["points"]
    tags = [colored.head(f"{link}?color={color}").headers["etag"] for color in ("auto", "none")]
    assert len(set(tags)) == 2
    assert colored.get(f"{link}?color=none", headers={"If-None-Match": tags[1]}).status_code == 304
    assert colored.get(link, headers={"If-None-Match": tags[1]}).status_code == 200


def test_points_with_an_unknown_color_value_are_refused(colored: httpx.Client) -> None:
    answer = colored.get(encoded(colored)["links"]["points"], params={"color": "red"})
    assert (answer.status_code, answer.json()["errors"][0]["field"]) == (422, "color")
    assert "'auto' or 'none'" in answer.json()["detail"]


# Specs in answers


def test_objects_and_model_with_color_show_its_spec(colored: httpx.Client, client: httpx.Client) -> None:
    spec = json.loads(SPEC.to_json())
    item = encoded(colored)
    assert item["color"] == colored.get("/model").json()["color"] == spec
    assert colored.get(item["links"]["self"]).json()["color"] == spec
    assert colored.get("/objects").json()["items"][0]["color"] == spec
    for answer in (encoded(client), client.get("/model").json(), client.get("/objects").json()["items"][0]):
        assert "color" not in answer


def test_weights_of_a_colored_object_hold_the_color(colored: httpx.Client) -> None:
    kept = colored.post("/encode?include=weights", content=image_file(disc())).json()
    passed = colored.post("/encode?store=false", content=image_file(disc())).json()
    weights = _weights(colored, kept)
    assert weights.color
    for answer in (kept, passed):
        assert base64.b64decode(answer["weights"]) == weights.theta.tobytes()
        assert base64.b64decode(answer["color_weights"]) == weights.color.weights.tobytes()
        assert answer["color"] == json.loads(SPEC.to_json())
    as_json = colored.get(kept["links"]["weights"] + "?format=json").json()
    assert as_json["color_spec"] == json.loads(SPEC.to_json())
    np.testing.assert_array_equal(np.float32(as_json["color"]), weights.color.weights)


# Files


def test_import_of_a_colored_file_gives_the_same_object(colored: httpx.Client, client: httpx.Client) -> None:
    item = encoded(colored)
    file = colored.get(item["links"]["weights"]).content
    answer = client.post("/objects", content=file)  # of a service whose own model has no color
    again = answer.json()
    assert (answer.status_code, again["color"]) == (201, item["color"])
    assert client.get(again["links"]["weights"]).content == file
    assert _file(client, again, "ply") == _file(colored, item, "ply")
    weights = load(file)
    plain = client.post("/objects", content=dump(Weights(weights.spec, weights.theta, weights.model), "safetensors"))
    assert plain.status_code == 201  # the same theta without its color is another object
    assert plain.json()["id"] != again["id"]
    assert "color" not in plain.json()


def test_import_of_an_impossible_color_is_refused(client: httpx.Client) -> None:
    huge = np.full(SPEC.size, 3e38, np.float32)
    answer = _import(client, 0, huge)
    assert (answer.status_code, answer.json()["errors"][0]["field"]) == (400, "color")
    cube = MappingSpec("cube", 3, (8,), 3, domain="cube")
    answer = _import(client, 0, initial_theta(cube), cube)
    assert (answer.status_code, answer.json()["errors"][0]["field"]) == (422, "color_spec")
    assert client.get("/objects").json()["items"] == []


def test_hof_sample_of_a_colored_file_gives_the_colors_of_the_service(
    colored: httpx.Client, colored_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    item = encoded(colored)
    photo, file, out = tmp_path / "photo.png", tmp_path / "a.safetensors", tmp_path / "out.ply"
    photo.write_bytes(image_file(disc()))
    assert cli.main(["encode", str(photo), "--model", str(colored_path), "-o", str(file)]) == 0
    assert file.read_bytes() == colored.get(item["links"]["weights"]).content
    for color in ("auto", "none"):
        assert cli.main(["sample", str(file), "-o", str(out), "--n", str(N), "--color", color]) == 0
        assert out.read_bytes() == _file(colored, item, "ply", color=color)
    assert cli.main(["info", str(file)]) == 0
    assert json.loads(capsys.readouterr().out)["color_spec"] == asdict(SPEC) | {"hidden": [8]}


# Words


def test_compose_of_colored_objects_blends_their_colors(client: httpx.Client, tmp_path: Path) -> None:
    colors = [_random_color(seed) for seed in (1, 2)]
    objects = [_import(client, seed, color).json() for seed, color in enumerate(colors)]
    item = client.post("/compose", json={"objects": [each["id"] for each in objects]}).json()
    assert item["color"] == objects[0]["color"]
    expected = (_values(colors[0]) + _values(colors[1])) / 2
    assert np.abs(_values(colors[0]) - _values(colors[1])).max() > 0.2
    _assert_close(_colors(client, item), expected)
    np.testing.assert_array_equal(_weights(client, item).functions.color.weights, colors)  # type: ignore[union-attr]
    file = tmp_path / "ab.safetensors"
    file.write_bytes(client.get(item["links"]["weights"]).content)
    assert cli.main(["sample", str(file), "-o", str(tmp_path / "ab.ply"), "--n", str(N)]) == 0
    assert (tmp_path / "ab.ply").read_bytes() == _file(client, item, "ply")


def test_compose_with_uncolored_functions_ignores_them_in_the_color(client: httpx.Client) -> None:
    color = _random_color(1)
    a, b, c = (_import(client, seed, one).json() for seed, one in enumerate((color, None, None)))
    for word in ((a, b), (b, a)):
        item = client.post("/compose", json={"objects": [each["id"] for each in word]}).json()
        assert item["color"] == a["color"]
        _assert_close(_colors(client, item), _values(color))
        assert _weights(client, item).functions.color.weights.shape == (1, SPEC.size)  # type: ignore[union-attr]
    none = client.post("/compose", json={"objects": [b["id"], c["id"]]}).json()
    assert "color" not in none
    assert "colors" not in json.loads(_file(client, none))


def test_compose_of_one_object_has_its_colors(colored: httpx.Client) -> None:
    a, b = encoded(colored, "red"), encoded(colored, "green")
    words = colored.post("/compose", json={"objects": [a["id"], b["id"]], "mode": "all"}).json()["objects"]
    assert _file(colored, words[0], "ply") == _file(colored, a, "ply")
    np.testing.assert_array_equal(_colors(colored, words[1]), _colors(colored, words[2]))  # AB, BA


def test_interpolate_of_colored_objects_averages_color_weights(client: httpx.Client) -> None:
    colors = [_random_color(seed) for seed in (1, 2)]
    ids = [_import(client, seed, color).json()["id"] for seed, color in enumerate([*colors, None])]
    item = client.post("/compose", json={"objects": ids, "mode": "interpolate"}).json()
    color = _weights(client, item).color
    assert color
    np.testing.assert_allclose(color.weights, np.mean(colors, axis=0), atol=1e-7)
    _assert_close(_colors(client, item), _values(color.weights))


def test_compose_with_different_color_specs_is_refused(client: httpx.Client) -> None:
    wide = MappingSpec(SPEC.name, 3, (9,), 3)
    ids = [
        _import(client, 0, _random_color(1)).json()["id"],
        _import(client, 1, initial_theta(wide), wide).json()["id"],
    ]
    answer = client.post("/compose", json={"objects": ids})
    assert (answer.status_code, answer.json()["errors"][0]["field"]) == (422, "objects[1]")
    assert "color's hidden (9,), objects[0] (8,)" in answer.json()["detail"]
