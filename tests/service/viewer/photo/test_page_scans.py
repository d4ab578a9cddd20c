"""The page in Chromium: scans and meshes, by the chooser and by drop, beside photos."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import trimesh
from playwright.sync_api import Browser, FilePayload, Page, Response, expect

from service.encoding.clouds import LEAST_POINTS
from service.settings import Settings
from tests.support.browsing import PICTURES, curl_line, first, hold, photo, release, run, wait_long
from tests.support.server import running
from tests.support.small import model as tiny_model
from tests.support.small.data import box

MODELS = "**/models"
ENCODE = "**/encode"  # without the options of photos
SHOWN = re.compile(r"/#/objects/[0-9a-f]{32}$")
GIVE = """([way, name, content]) => {
    const dataTransfer = new DataTransfer();
    dataTransfer.items.add(new File([content], name));
    const options = { dataTransfer, clipboardData: dataTransfer, bubbles: true, cancelable: true };
    document.body.dispatchEvent(way === "drop" ? new DragEvent(way, options) : new ClipboardEvent(way, options));
}"""


@pytest.fixture(scope="module")
def address(model_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Run a service with a tiny model of images, one of points, and an object of a photo."""
    folder = tmp_path_factory.mktemp("scans")
    models = (model_path, tiny_model.build_points(folder / "points.onnx"))
    settings = Settings(model=models, database_url=f"sqlite:///{folder / 'hof.db'}", matting_model=None, threads=1)
    with running(settings) as server:
        address = f"http://127.0.0.1:{server.port}"
        httpx.post(f"{address}/encode", content=photo("chair").read_bytes(), timeout=60).raise_for_status()
        yield address


def _scan(folder: Path, name: str, n: int = 1_000) -> Path:
    """Write a scan of n points, others for each number of points."""
    np.save(path := folder / "points.npy", box(n)[:n])
    return path.rename(folder / name)


def _text(number: int) -> str:
    """Return 100 points of a box as XYZ."""
    return "\n".join(f"{x} {y} {z}" for x, y, z in box(number)[:100])


def _is_encoding(response: Response) -> bool:
    return response.request.method == "POST" and "/encode" in response.url


def test_scan_that_is_chosen_is_completed_and_told_by_its_name(page: Page, tmp_path: Path) -> None:
    hint = "Or a scan or mesh, even of a part (PLY, PCD, NPY, XYZ, GLB, OBJ, STL)"
    expect(page.locator("#scans")).to_be_visible()
    expect(page.get_by_label("Choose a photo")).to_have_accessible_description(hint)
    accepted = (page.locator("#file").get_attribute("accept") or "").split(",")
    assert accepted[0] == "image/png"
    assert accepted[-7:] == [".ply", ".pcd", ".npy", ".xyz", ".glb", ".obj", ".stl"]
    with page.expect_response(_is_encoding) as answer:
        page.set_input_files("#file", _scan(tmp_path, "half a chair.npy"))
    item: dict[str, Any] = answer.value.json()
    page.wait_for_url(f"**/#/objects/{item['id']}")
    assert item["model"] == "tiny-k2-points"
    framing = page.locator("#framing")
    expect(framing.locator("strong")).to_have_text("half a chair.npy")
    expect(framing.locator("figcaption span")).to_have_text("Completed from 1,000 points.")
    for hidden in ("img", ".box", "#crop", "#whole", "#background"):
        for each in framing.locator(hidden).all():
            expect(each).to_be_hidden()
    expect(page.locator("#gallery li.shown .open")).to_have_text(f"Object {item['id'][:6]}")
    page.screenshot(path=PICTURES / "scan.png")
    line = curl_line(page, "encode")
    assert '-F "points=@half a chair.npy"' in line
    assert json.loads(run(line, tmp_path))["id"] == item["id"]
    values = page.locator("#model option").evaluate_all("(options) => options.map(({ text }) => text)")
    assert values == ["tiny-k2 (k = 2)"]


def test_photo_after_a_mesh_is_shown_as_ever_and_the_other_way_round(page: Page) -> None:
    mesh: FilePayload = {"name": "box.stl", "mimeType": "", "buffer": trimesh.creation.box().export(file_type="stl")}
    caption, name = page.locator("#framing figcaption span"), page.locator("#framing strong")
    for _ in range(2):
        page.set_input_files("#file", mesh)
        expect(caption).to_have_text("Completed from 20,000 points.")
        expect(name).to_have_text("box.stl")
        expect(page.locator("#framing .picture")).to_be_hidden()
        page.get_by_role("button", name="Barrel").click()
        expect(caption).to_contain_text("transparency")
        expect(name).to_be_hidden()
        for shown in ("#framing .picture > img", "#framing .box", "#crop", "#background"):
            expect(page.locator(shown)).to_be_visible()
        assert '-F "image=@barrel.webp"' in curl_line(page, "encode")
        assert curl_line(page, "encode").endswith('/encode?keep_photo=true"')


def test_scan_that_is_dropped_gives_up_one_that_was_pasted(page: Page) -> None:
    held = hold(page, ENCODE, count=1)
    page.evaluate(GIVE, ["paste", "first.xyz", _text(1)])
    request = first(page, held).request
    expect(page.locator("#framing strong")).to_have_text("first.xyz")
    expect(page.locator("#working")).to_be_visible()
    with page.expect_event("requestfailed", lambda each: each == request):
        page.evaluate(GIVE, ["drop", "Second.XYZ", _text(2)])
    expect(page.locator("#framing figcaption")).to_have_text(re.compile(r"Second\.XYZ\s+Completed from 100 points\."))
    expect(page).to_have_url(SHOWN)
    expect(page.get_by_role("alert")).to_be_hidden()


def test_scan_of_too_few_points_shows_what_the_service_says(page: Page, tmp_path: Path) -> None:
    page.set_input_files("#file", _scan(tmp_path, "few.npy", LEAST_POINTS - 1))
    expect(page.locator("#problem")).to_contain_text("there are 63 points, at least 64 are needed")
    expect(page.locator("#framing figcaption")).to_contain_text("This file did not become an object.")
    expect(page.locator("#working")).to_be_hidden()


def test_scan_before_the_models_are_known_is_sent(browser: Browser, address: str, tmp_path: Path) -> None:
    with browser.new_context(reduced_motion="reduce") as context:
        page = context.new_page()
        wait_long(page)
        held = hold(page, MODELS)
        page.goto(f"{address}/")
        first(page, held)
        expect(page.locator("#scans")).to_be_hidden()
        page.set_input_files("#file", _scan(tmp_path, "early.npy"))
        expect(page.locator("#framing figcaption")).to_contain_text("Completed from 1,000 points.")
        release(page, MODELS, held)
        expect(page.locator("#scans")).to_be_visible()
