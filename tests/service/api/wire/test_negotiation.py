import pytest

from service.api.wire.negotiation import negotiate
from service.errors import NotAcceptable
from service.formats.points.registry import POINT_FORMATS

FORMATS = list(POINT_FORMATS.values())


@pytest.mark.parametrize(
    ("accept", "name"),
    [
        (None, "ply"),
        ("", "ply"),
        ("*/*", "ply"),
        ("text/html,application/xhtml+xml,application/xml;q=0.9,*/*;q=0.8", "ply"),
        ("model/ply", "ply"),
        ("application/x-npy", "npy"),
        ("text/plain", "xyz"),
        ("text/*", "xyz"),
        ("application/json", "json"),
        ("model/gltf-binary", "glb"),
        ("Model/GLTF-Binary", "glb"),
        ("model/*", "ply"),
        ("application/*", "npy"),
        ("application/json;q=0.5, model/gltf-binary;q=0.9", "glb"),
        ("application/json ; q=0.9 , model/gltf-binary;q=0.5", "json"),
        ("model/gltf-binary, */*;q=0.1", "glb"),
        ("*/*, model/gltf-binary", "glb"),
        ("model/gltf+json", "gltf"),
        ("application/x-pcd", "pcd"),
        ("application/octet-stream", "f32"),
        ("application/json, text/plain, */*", "json"),
        ("text/plain, application/json, */*", "xyz"),
        ("model/*, model/ply;q=0", "glb"),
        ("*/*;q=0.5, model/ply;q=0.1, application/x-npy;q=0.2", "xyz"),
        ("application/json;charset=utf-8;q=1", "json"),
        ("application/json;q=high, text/plain;q=0.1", "xyz"),
        ("application/json;q=7, text/plain;q=0.1", "xyz"),
        ("nonsense, application/json", "json"),
    ],
)
def test_negotiate_with_an_acceptable_format_returns_the_preferred(accept: str | None, name: str) -> None:
    assert negotiate(accept, FORMATS).name == name


@pytest.mark.parametrize(
    "accept", ["image/png", "image/*", "*/*;q=0", "model/ply;q=0", "nonsense", "application/json;q=0, text/html", "*"]
)
def test_negotiate_without_an_acceptable_format_raises_not_acceptable(accept: str) -> None:
    with pytest.raises(NotAcceptable, match="model/gltf-binary"):
        negotiate(accept, FORMATS)


def test_negotiate_of_formats_with_one_media_type_names_it_once() -> None:
    with pytest.raises(NotAcceptable) as raised:
        negotiate("image/png", FORMATS)
    assert raised.value.detail.count("application/octet-stream") == 1
