"""GET /objects/{id}/picture over a real socket."""

import io
import re
from typing import Any

import httpx
import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

from service.drawing.cloud import GROUND
from service.formats.picture import PICTURE_FORMATS
from service.runtime.pictures import CAMERAS
from service.settings import Settings
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
        ("format=gif", "format", "webp"),
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
    with running(settings) as server, httpx.Client(base_url=f"http://127.0.0.1:{server.port}", timeout=60) as client:
        path = f"{client.post('/encode', content=photo).json()['links']['self']}/picture"
        app: Any = server.config.app
        gate = app.state.gates.points
        with gate.admit(settings.max_points_in_flight):
            answer = client.get(path)
        assert answer.status_code == 429
        assert int(answer.headers["retry-after"]) >= 1
        assert client.get(path).status_code == 200
        until(lambda: gate.held == 0)  # the gate is left after the answer's last byte
