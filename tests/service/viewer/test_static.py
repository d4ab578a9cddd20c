"""The page without a service, in Chromium: from Python's file server, with every other address blocked."""

import functools
import http.server
import io
import re
from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest
import trimesh
from PIL import Image
from playwright.sync_api import Browser, Page, expect

from tests.service.viewer.tools.room import PHONE, emulate_phone
from tests.support import ROOT
from tests.support.browsing import PICTURES, TRIANGLES, photo, wait_long
from tests.support.gltf import check_valid
from tests.support.server import answering
from tests.support.systems.javascript import build_package, run_in_package

LOCAL = ROOT / "service" / "viewer" / "local"
LIKE = 12  # of 255: mean difference of two pictures' objects; their triangles differ
PIXELS = """(image) => {
    const { naturalWidth: width, naturalHeight: height } = image;
    const context = Object.assign(document.createElement("canvas"), { width, height }).getContext("2d");
    context.drawImage(image, 0, 0);
    return [...context.getImageData(0, 0, width, height).data];
}"""
TOLERANCE = 1e-3  # longest sides: of points whose photo was decoded and encoded elsewhere


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write the static page, as `make static` does."""
    folder = tmp_path_factory.mktemp("static") / "page"
    build_package()
    run_in_package("node", str(LOCAL / "build.mjs"), str(folder))
    return folder


class Quiet(http.server.SimpleHTTPRequestHandler):
    """Python's file server, without its log."""

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the name of the base class
        pass


@pytest.fixture(scope="module")
def files(folder: Path) -> Iterator[str]:
    """Serve the folder under a prefix; return the page's address."""
    handler = functools.partial(Quiet, directory=folder.parent)
    with answering(handler) as url:
        yield f"{url}/{folder.name}/"


@pytest.fixture
def alone(browser: Browser, files: str) -> Iterator[Page]:
    """Open the static page; only its own files can be fetched, and nothing may fail."""
    with browser.new_context(viewport={"width": 1280, "height": 1000}, accept_downloads=True) as context:
        page = context.new_page()
        wait_long(page)
        faults: list[str] = []
        page.on("console", lambda message: faults.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on("requestfailed", lambda request: faults.append(request.url))
        context.route(lambda url: not url.startswith((files, "blob:", "data:")), lambda route: route.abort())
        page.emulate_media(reduced_motion="reduce")
        page.goto(files)
        yield page
        assert faults == []


def _choose(page: Page, path: Path, shown: str | re.Pattern[str] = TRIANGLES) -> None:
    page.locator("#file").set_input_files(path)
    expect(page.locator("#count")).to_have_text(shown)


def _show_points(page: Page) -> str:
    """Let the page show points in place of surfaces, which take longer; return what it will call them."""
    page.locator("#n").evaluate("(slider) => { slider.value = 4 }")
    page.get_by_role("switch", name="Surface").uncheck()
    return "10,000 points"


def _save(page: Page, name: str, folder: Path) -> Path:
    """Save the file that the menu calls so."""
    page.locator("#format").select_option(label=name)
    with page.expect_download() as download:
        page.get_by_role("button", name="Download").click()
    path = folder / download.value.suggested_filename
    download.value.save_as(path)
    return path


@pytest.mark.parametrize("name", ["chair", "armchair"])
def test_photo_of_the_demo_gives_the_points_of_the_service(
    alone: Page, address: str, tmp_path: Path, name: str
) -> None:
    _choose(alone, photo(name), _show_points(alone))
    assert "transparency" in (alone.locator("#framing figcaption").text_content() or "")
    cloud = trimesh.load(_save(alone, "PLY: MeshLab, CloudCompare", tmp_path))
    encoded = httpx.post(f"{address}/encode", content=photo(name).read_bytes(), timeout=60).json()
    points = httpx.get(f"{address}/objects/{encoded['id']}/points?n=10000&format=f32", timeout=60).content
    expected = np.frombuffer(points, "<f4").reshape(-1, 3)
    assert cloud.vertices.shape == (10_000, 3)
    assert np.abs(cloud.vertices - expected).max() < TOLERANCE
    alone.screenshot(path=PICTURES / f"static-{name}.png", full_page=True)


def test_photo_before_a_table_is_cut_out_in_the_browser(alone: Page) -> None:
    _choose(alone, ROOT / "demo" / "coffee.jpg")
    expect(alone.locator("#framing figcaption")).to_contain_text("Background removed by the matting model")
    alone.screenshot(path=PICTURES / "static-coffee.png", full_page=True)


def test_function_of_the_page_is_one_that_the_service_takes(alone: Page, address: str, tmp_path: Path) -> None:
    _choose(alone, photo("chair"), _show_points(alone))
    weights = _save(alone, "safetensors: all of the object", tmp_path).read_bytes()
    imported = httpx.post(f"{address}/objects", content=weights, timeout=60).json()
    assert imported["kind"] == "imported"
    check_valid(_save(alone, "GLB: web, Windows, Blender", tmp_path).read_bytes(), tmp_path)


def test_example_photo_is_encoded_and_listed_with_a_picture(alone: Page) -> None:
    alone.get_by_role("button", name="Bed").click()
    expect(alone.locator("#count")).to_have_text(TRIANGLES)
    card = alone.locator("#gallery li")
    expect(card).to_have_count(1)
    card.scroll_into_view_if_needed()
    expect(card.locator("img").first).to_have_js_property("naturalWidth", 240)
    expect(alone.locator("#gallery-title")).to_have_text("Objects in this tab")


def test_picture_of_a_card_is_that_of_the_service(alone: Page, address: str) -> None:
    _choose(alone, photo("chair"), _show_points(alone))
    image = alone.locator("#gallery li img").first
    image.scroll_into_view_if_needed()
    expect(image).to_have_js_property("naturalWidth", 240)
    drawn = np.array(image.evaluate(PIXELS), np.int16).reshape(240, 240, 4)[..., :3]
    encoded = httpx.post(f"{address}/encode", content=photo("chair").read_bytes(), timeout=60).json()
    answer = httpx.get(f"{address}/objects/{encoded['id']}/picture?size=240&format=png", timeout=60).content
    expected = np.asarray(Image.open(io.BytesIO(answer)).convert("RGB")).astype(np.int16)
    Image.fromarray(drawn.astype(np.uint8)).save(PICTURES / "static-card.png")
    apart = abs(drawn - expected)
    ink = (expected < 250).any(axis=2)
    assert apart[ink].mean() < LIKE
    assert apart[~ink].mean() < 1


def test_two_objects_are_mixed_without_a_service(alone: Page) -> None:
    for name in ("chair", "armchair"):
        _choose(alone, photo(name))
    mix = alone.locator("#gallery .mix")
    expect(mix).to_have_count(2)
    mix.nth(0).press("Enter")
    mix.nth(1).press("Enter")
    expect(alone.locator("#words button")).to_have_text(["A", "AB", "BA", "B"])
    expect(alone.locator("#count")).to_contain_text("triangles")
    alone.screenshot(path=PICTURES / "static-mix.png", full_page=True)


def test_file_that_is_no_image_is_an_error_with_its_reason(alone: Page, tmp_path: Path) -> None:
    (tmp_path / "note.png").write_text("no image")
    alone.locator("#file").set_input_files(tmp_path / "note.png")
    expect(alone.locator("#problem")).to_contain_text("cannot read the file as an image")


def test_scan_is_refused_with_a_notice(alone: Page) -> None:
    alone.locator("#file").set_input_files({"name": "part.ply", "mimeType": "", "buffer": b"ply"})
    expect(alone.locator("#problem")).to_contain_text("Scans and meshes cannot be completed here.")
    expect(alone.locator("#scans")).to_be_hidden()


def test_features_that_need_a_service_are_hidden(alone: Page) -> None:
    _choose(alone, photo("chair"), _show_points(alone))
    alone.get_by_text("Advanced").click()
    for hidden in ('nav a[href="docs"]', "#link", "#robot", "#ar", "#keep", "#model", '[data-text="sameByCommand"]'):
        expect(alone.locator(hidden)).to_be_hidden()
    for line in alone.locator(".curl").all():
        expect(line).to_be_hidden()
    values = alone.locator("#format option").evaluate_all("(options) => options.map(({ value }) => value)")
    assert values == ["glb", "ply", "glb", "f32", "safetensors"]


def test_object_of_the_page_stands_in_the_room_of_a_browser_with_webxr(alone: Page) -> None:
    page = alone.context.new_page()
    emulate_phone(page)
    page.set_viewport_size(PHONE)
    page.goto(alone.url)
    _choose(page, photo("chair"))
    page.evaluate("phone.look(-35, 0)")
    page.get_by_role("button", name="See it in your room").click()
    expect(page.locator("#room p")).to_have_text("Tap to put it here.")
    page.get_by_role("button", name="Leave").click()
    expect(page.locator("#room")).to_be_hidden()


def test_folder_refers_to_nothing_but_its_files(folder: Path) -> None:
    page = (folder / "index.html").read_text("utf-8")
    for name in re.findall(r'(?:src|href)="([^"#]+)"|"\./(viewer/[^"]+)": "|": "\./(viewer/[^"]+)"', page):
        path = "".join(name)
        assert (folder / path).is_file() or path == "docs", path
    assert not [*folder.rglob("*.gz"), *folder.rglob("embed.html"), *folder.rglob("docs.js"), *folder.rglob("swagger*")]
    assert "Content-Security-Policy" in page
