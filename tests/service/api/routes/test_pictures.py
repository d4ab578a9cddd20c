"""GET /objects/{id}/picture over a real socket."""

import io
import re
from typing import Any

import httpx
import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image, ImageSequence

from service.drawing.cloud import GROUND
from service.formats.picture import PICTURE_FORMATS
from service.runtime.pictures import CAMERAS
from service.settings import POINTS_PER_CPU, Settings
from tests.support.server import check_refused, running
from tests.support.slow import until


@pytest.fixture
def path(client: httpx.Client, photo: bytes) -> str:
    return f"{client.post('/encode', content=photo).json()['links']['self']}/picture"


def _drawn(answer: httpx.Response) -> npt.NDArray[np.int16]:
    assert answer.status_code == 200, answer.text
    return np.asarray(Image.open(io.BytesIO(answer.content)).convert("RGB")).astype(np.int16)


def test_picture_by_default_is_a_png_of_the_object_over_white(client: httpx.Client, path: str) -> None:
    answer = client.get(path)
    assert answer.headers["content-type"] == "image/png"
    assert re.fullmatch(r'attachment; filename="hof-[0-9a-f]{32}\.png"', answer.headers["content-disposition"])
    picture = _drawn(answer)
    assert picture.shape == (320, 320, 3)
    assert (picture[0] == GROUND).all()
    assert (picture < GROUND).any()
    assert client.get(path, headers={"If-None-Match": answer.headers["etag"]}).status_code == 304
    head = client.head(path)
    assert (head.status_code, head.headers["etag"]) == (200, answer.headers["etag"])


@pytest.mark.parametrize("name", PICTURE_FORMATS)
def test_picture_in_every_format_shows_the_same(client: httpx.Client, path: str, name: str) -> None:
    expected = _drawn(client.get(path, params={"size": 64}))
    answer = client.get(path, params={"size": 64, "format": name})
    assert answer.headers["content-type"] == f"image/{name}"
    assert np.abs(_drawn(answer) - expected).mean() < 5
    assert client.get(path, headers={"Accept": f"image/{name}"}).headers["content-type"] == f"image/{name}"


@pytest.mark.parametrize("name", ["webp", "gif"])
def test_picture_of_several_frames_turns_once_around(client: httpx.Client, path: str, name: str) -> None:
    answer = client.get(path, params={"size": 96, "frames": 4, "view": "front", "format": name})
    assert answer.headers["content-type"] == f"image/{name}"
    with Image.open(io.BytesIO(answer.content)) as film:
        assert (film.info["loop"], film.size) == (0, (96, 96))
        frames = []
        for frame in ImageSequence.Iterator(film):
            frames.append(np.asarray(frame.convert("RGB")).astype(np.int16))
            assert frame.info["duration"] == 900
    assert len(frames) == 4
    stills = [_drawn(client.get(path, params={"size": 96, "view": view})) for view in ("front", "side", "back")]
    distances = np.array([[np.abs(frame - still).mean() for still in stills] for frame in frames[:3]])
    assert distances.diagonal().max() < 5
    assert (distances.argmin(axis=1) == [0, 1, 2]).all()


def test_picture_of_several_frames_is_webp_by_default_and_has_its_own_etag(client: httpx.Client, path: str) -> None:
    heads = [client.head(path, params={"frames": frames}) for frames in (1, 2, 3)]
    assert [head.headers["content-type"] for head in heads] == ["image/png", "image/webp", "image/webp"]
    assert len({head.headers["etag"] for head in heads}) == 3
    refused = client.get(path, params={"frames": 2}, headers={"Accept": "image/png"})
    assert refused.status_code == 406


def test_picture_of_each_view_is_another(client: httpx.Client, path: str) -> None:
    pictures = {client.get(path, params={"size": 64, "view": view}).content for view in CAMERAS}
    assert len(pictures) == len(CAMERAS)


def test_picture_of_an_object_in_color_can_leave_the_colors_out(colored: httpx.Client, photo: bytes) -> None:
    path = f"{colored.post('/encode', content=photo).json()['links']['self']}/picture"
    plain, painted = (_drawn(colored.get(path, params={"size": 64, "color": color})) for color in ("none", "auto"))
    assert (plain != painted).any()
    assert (plain[..., 2] >= plain[..., 0]).all()  # shades of blue


@pytest.mark.parametrize(
    ("query", "field", "limit"),
    [
        ("size=31", "size", "32"),
        ("size=513", "size", "512"),
        ("view=below", "view", "top"),
        ("format=bmp", "format", "webp"),
        ("frames=0", "frames", "1"),
        ("frames=37", "frames", "36"),
        ("frames=2&format=png", "format", "webp or gif"),
        ("frames=2&size=321", "size", "320"),
        ("n=5", "n", "unknown"),
    ],
)
def test_picture_with_a_bad_parameter_names_it_and_its_limit(
    client: httpx.Client, path: str, query: str, field: str, limit: str
) -> None:
    check_refused(client.get(f"{path}?{query}"), field, limit)


def test_picture_with_an_unsatisfiable_accept_or_id_is_refused(client: httpx.Client, path: str) -> None:
    assert client.get(path, headers={"Accept": "text/plain"}).status_code == 406
    assert client.get(f"/objects/{'0' * 32}/picture").status_code == 404


def test_picture_while_the_points_gate_is_full_answers_429(settings: Settings, photo: bytes) -> None:
    limited = settings.model_copy(update={"max_points_in_flight": 1_000_000})
    with running(limited) as server, httpx.Client(base_url=f"http://127.0.0.1:{server.port}", timeout=60) as client:
        path = f"{client.post('/encode', content=photo).json()['links']['self']}/picture"
        app: Any = server.config.app
        gate = app.state.gates.points
        with gate.admit(limited.max_points_in_flight):
            answer = client.get(path)
        assert answer.status_code == 429
        assert int(answer.headers["retry-after"]) >= 1
        assert client.get(path).status_code == 200
        until(lambda: gate.held == 0)  # the gate is left after the answer's last byte


def test_picture_of_the_largest_size_is_drawn_on_one_cpu_beside_others(settings: Settings, photo: bytes) -> None:
    limited = settings.model_copy(update={"max_points_in_flight": POINTS_PER_CPU})
    with running(limited) as server, httpx.Client(base_url=f"http://127.0.0.1:{server.port}", timeout=60) as client:
        path = f"{client.post('/encode', content=photo).json()['links']['self']}/picture"
        app: Any = server.config.app
        with app.state.gates.points.admit(POINTS_PER_CPU // 4, "another client"):
            assert client.get(f"{path}?size=512").status_code == 200
            assert client.get(f"{path}?size=513").status_code == 422
