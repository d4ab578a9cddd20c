"""The page's files: headers, references, and the answer if the bundle is missing."""

import gzip
import re
from pathlib import Path

import httpx
import pytest

from service.api.routes import viewer
from service.formats.mesh.registry import MESH_FORMATS
from service.formats.picture import PICTURE_FORMATS
from service.formats.points.registry import POINT_FORMATS
from service.formats.weights import WEIGHT_FORMATS

OWN_FILES = [
    *viewer.STATIC.glob("*.html"),
    *viewer.STATIC.glob("*.svg"),
    *viewer.STATIC.glob("css/*"),
    *viewer.STATIC.glob("js/**/*.js"),
]
PAGE_FILES = [
    *viewer.STATIC.glob("*.svg"),
    *viewer.STATIC.glob("css/*"),
    *viewer.STATIC.glob("js/**/*.js"),
    *viewer.STATIC.glob("photos/*"),
]
MOST_BYTES = 300_000  # of the page on the wire, but for three.js
INDEX = (viewer.STATIC / "index.html").read_text("utf-8")


def test_page_is_cacheable_and_loads_nothing_from_elsewhere(client: httpx.Client) -> None:
    answer = client.get("/")
    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    assert answer.headers["cache-control"] == "no-cache"
    assert answer.headers["x-content-type-options"] == "nosniff"
    policy = dict(part.split(" ", 1) for part in answer.headers["content-security-policy"].split("; "))
    assert policy["default-src"] == "'none'"
    assert policy["connect-src"] == policy["style-src"] == "'self'"
    assert re.fullmatch(r"'self' 'sha256-[\w+/]{43}='", policy["script-src"])
    assert "unsafe" not in answer.headers["content-security-policy"]
    assert client.get("/", headers={"If-None-Match": answer.headers["etag"]}).status_code == 304
    assert client.head("/").headers["content-length"] == answer.headers["content-length"]


@pytest.mark.parametrize(
    ("name", "media_type"),
    [
        ("js/main.js", "text/javascript; charset=utf-8"),
        ("css/style.css", "text/css; charset=utf-8"),
        ("icon.svg", "image/svg+xml"),
        ("bundle/three/three.module.min.js", "text/javascript; charset=utf-8"),
        ("photos/chair.webp", "image/webp"),
    ],
)
def test_static_file_has_its_media_type_and_an_etag(client: httpx.Client, name: str, media_type: str) -> None:
    answer = client.get(f"/viewer/{name}")
    assert (answer.status_code, answer.headers["content-type"]) == (200, media_type)
    assert answer.headers["cache-control"] == "no-cache"
    assert answer.content == (viewer.STATIC / name).read_bytes()
    assert client.get(f"/viewer/{name}", headers={"If-None-Match": answer.headers["etag"]}).status_code == 304


@pytest.mark.parametrize("path", ["/", "/embed", "/viewer/js/main.js", "/viewer/css/style.css", "/viewer/icon.svg"])
def test_text_of_the_page_is_sent_compressed_with_an_etag_of_its_own(client: httpx.Client, path: str) -> None:
    plain, packed = (client.get(path, headers={"Accept-Encoding": coding}) for coding in ("identity", "gzip"))
    assert "content-encoding" not in plain.headers
    assert packed.headers["content-encoding"] == "gzip"
    assert packed.content == plain.content
    assert int(packed.headers["content-length"]) < len(plain.content)
    assert packed.headers["etag"] != plain.headers["etag"]
    for coding, answer in (("identity", plain), ("gzip", packed)):
        assert "Accept-Encoding" in answer.headers["vary"]
        for name in ("content-type", "cache-control"):
            assert answer.headers[name] == plain.headers[name]
        assert answer.headers.get("content-security-policy") == plain.headers.get("content-security-policy")
        headers = {"Accept-Encoding": coding, "If-None-Match": answer.headers["etag"]}
        again = client.get(path, headers=headers)
        assert (again.status_code, again.headers["etag"]) == (304, answer.headers["etag"])


def test_page_preloads_the_modules_that_it_starts_with_and_no_others() -> None:
    """A module that is missing costs a round trip; three.js comes after the page is seen."""
    preloaded = re.findall(r'rel="modulepreload" href="viewer/([^"]+)"', INDEX)
    assert preloaded == sorted(_imported("js/main.js") - {"js/main.js"})
    assert "js/stage/parts.js" not in preloaded


def _imported(name: str) -> set[str]:
    """Return a module and all that it imports, its imports too, relative to STATIC."""
    names, waiting = set(), {viewer.STATIC / name}
    while waiting:
        path = waiting.pop()
        names.add(path.relative_to(viewer.STATIC).as_posix())
        imports = re.findall(r'^(?:import|export)\b[^;]*?from "(\.[^"]+)";', path.read_text("utf-8"), re.MULTILINE)
        each = {(path.parent / address).resolve() for address in imports}
        waiting |= {path for path in each if path.relative_to(viewer.STATIC).as_posix() not in names}
    return names


@pytest.mark.parametrize("name", ["three/three.core.min.js", "swagger-ui/swagger-ui.css"])
def test_static_file_that_is_large_was_compressed_at_build(client: httpx.Client, name: str) -> None:
    path, kept = f"/viewer/bundle/{name}", (viewer.BUNDLE / f"{name}.gz").read_bytes()
    plain = client.get(path, headers={"Accept-Encoding": "identity"})
    answer = client.get(path, headers={"Accept-Encoding": "gzip"})
    assert answer.headers["content-encoding"] == "gzip"
    assert answer.headers["content-length"] == str(len(kept))
    assert answer.content == gzip.decompress(kept) == plain.content == (viewer.BUNDLE / name).read_bytes()
    assert "content-encoding" not in plain.headers
    for each in (plain, answer):
        assert "Accept-Encoding" in each.headers["vary"]
        assert each.headers["content-type"] == plain.headers["content-type"]
        headers = {
            "If-None-Match": each.headers["etag"],
            "Accept-Encoding": each.headers.get("content-encoding", "identity"),
        }
        assert client.get(path, headers=headers).status_code == 304
    assert plain.headers["etag"] != answer.headers["etag"]


def test_static_path_outside_the_page_is_404(client: httpx.Client) -> None:
    for path in ("/viewer/no.js", "/viewer/", "/viewer/%2e%2e/package.json", "/viewer/%2e%2e/%2e%2e/app.py"):
        answer = client.get(path)
        assert (answer.status_code, answer.headers["content-type"]) == (404, "application/problem+json"), path
    assert client.post("/").status_code == client.post("/viewer/js/main.js").status_code == 405


def test_static_files_refer_only_to_existing_files_by_relative_addresses(client: httpx.Client) -> None:
    for path in OWN_FILES:
        text = path.read_text("utf-8")
        folder = "" if path.suffix == ".html" else f"/viewer/{path.parent.relative_to(viewer.STATIC).as_posix()}"
        names = [
            "".join(groups)
            for groups in re.findall(
                r'(?:src|href|data-schema)="([^"#]+)"|"\./(viewer/[^"]+)"|from "(\.\.?/[^"]+)"', text
            )
        ]
        assert names or path.suffix != ".html", path.name
        for name in names:
            assert not name.startswith("/"), (path.name, name)  # a proxy may offer the page under a prefix
            assert client.get(f"{folder}/{name}").status_code == 200, (path.name, name)
        assert not re.search(r"""["'`]/(viewer|objects|encode|compose|models|docs|openapi)""", text), path.name
        assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)", text), path.name


def test_page_without_three_js_is_light(client: httpx.Client) -> None:
    names = ["/", *(f"/viewer/{path.relative_to(viewer.STATIC).as_posix()}" for path in PAGE_FILES)]
    sizes = {}
    for name in names:
        with client.stream("GET", name, headers={"Accept-Encoding": "gzip"}) as answer:
            assert answer.status_code == 200
            sizes[name] = sum(len(part) for part in answer.iter_raw())
    assert sum(sizes.values()) < MOST_BYTES, sizes


def test_bundle_contains_the_licenses() -> None:
    assert "MIT" in (viewer.BUNDLE / "three" / "LICENSE").read_text("utf-8")
    assert "Apache License" in (viewer.BUNDLE / "swagger-ui" / "LICENSE").read_text("utf-8")


@pytest.mark.parametrize("path", ["/", "/docs"])
def test_page_without_a_bundle_is_404_and_the_api_works(
    client: httpx.Client, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, path: str
) -> None:
    monkeypatch.setattr(viewer, "BUNDLE", tmp_path / "bundle")
    answer = client.get(path)
    assert (answer.status_code, answer.json()["detail"]) == (404, viewer.NOT_BUILT)
    assert client.get("/objects").status_code == 200


def test_page_offers_every_format() -> None:
    groups = dict(re.findall(r'<optgroup [^>]*data-of="(\w+)">(.*?)</optgroup>', INDEX, re.DOTALL))
    values = {name: set(re.findall(r'value="(\w+)"', group)) for name, group in groups.items()}
    assert values == {
        "points": set(POINT_FORMATS),
        "mesh": set(MESH_FORMATS),
        "picture": set(PICTURE_FORMATS),
        "weights": set(WEIGHT_FORMATS),
    }


def test_page_makes_iphones_send_jpeg() -> None:
    """The system of iPhones converts a HEIC photo where a file input accepts JPEG and neither HEIC nor every image."""
    (accepted,) = re.findall(r'<input id="file"[^>]* accept="([^"]+)"', INDEX)
    assert "image/jpeg" in accepted.split(",")
    assert not {"image/heic", "image/heif", "image/*"} & set(accepted.split(","))


def test_static_page_has_every_call_of_the_page() -> None:
    """The static page (`make static`) takes local/api.js for js/api.js: a missing export breaks it."""
    export = re.compile(r"^export (?:async function|function|class|const) (\w+)", re.MULTILINE)
    local, served = (viewer.STATIC.parent / "local" / "api.js", viewer.STATIC / "js" / "api.js")
    assert set(export.findall(local.read_text("utf-8"))) == set(export.findall(served.read_text("utf-8")))
