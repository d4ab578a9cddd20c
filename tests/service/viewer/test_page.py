"""The page in Chromium: a visitor's actions. Screenshots are written to out/viewer."""

import io
import json
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
import trimesh
from playwright.sync_api import Browser, Page, Request, expect

from service.api.routes import viewer
from service.mapping.spec import MappingSpec
from service.settings import SHIPPED_MODEL, Settings
from tests.support import ROOT
from tests.support.browsing import (
    PICTURES,
    TIMEOUT_MS,
    TRIANGLES,
    changed,
    curl_line,
    ink,
    inked,
    opened,
    photo,
    pixels,
    run,
    saved,
    warm,
)
from tests.support.server import running
from tests.support.small import model as tiny_model


def test_policy_allows_the_import_map_and_nothing_from_elsewhere(browser: Browser, address: str) -> None:
    with browser.new_context(reduced_motion="reduce") as context:
        page = context.new_page()
        page.goto(f"{address}/")
        pinned = json.loads((viewer.STATIC.parent / "package.json").read_text("utf-8"))["dependencies"]["three"]
        assert page.evaluate("async () => (await import('three')).REVISION") == pinned.split(".")[1]
        request = "fetch('https://example.org').then(() => 'fetched', () => 'blocked')"
        with page.expect_console_message(lambda message: "Content Security Policy" in message.text):
            assert page.evaluate(f"async () => {request}") == "blocked"


def test_photo_that_is_chosen_is_encoded_and_drawn(browser: Browser, address: str) -> None:
    with browser.new_context(viewport={"width": 1280, "height": 1000}) as context:
        page = context.new_page()
        page.emulate_media(reduced_motion="reduce")  # no turntable
        page.route("**/objects?*", lambda route: route.fulfill(json={"items": [], "next": None}))  # as on the first day
        page.goto(f"{address}/")
        expect(page.locator("#empty")).to_be_visible()
        empty = inked(page)
        page.unroute("**/objects?*")
        page.set_input_files("#file", photo("chair"))
        expect(page.locator("#count")).to_have_text(TRIANGLES, timeout=TIMEOUT_MS)
        expect(page.locator("#empty")).to_be_hidden()
        assert inked(page) > empty + 2000
        expect(page.locator("#framing figcaption")).to_contain_text("transparency")
        page.screenshot(path=PICTURES / "encoded.png")
        frame, box = (page.locator(f"#framing .{name}").bounding_box() for name in ("picture", "box"))
        assert frame
        assert box
        assert 0 < box["width"] < frame["width"]
        assert b'"mask":"alpha"' in run(curl_line(page, "encode"), photo("chair").parent)


def test_photo_of_the_examples_is_encoded(page: Page) -> None:
    page.get_by_role("button", name="Armchair", exact=True).click()
    expect(page.locator("#framing")).to_be_visible()
    expect(page.locator("#gallery li.shown")).to_have_count(1)


def test_model_of_two_can_be_chosen(page: Page, browser: Browser, tmp_path: Path) -> None:
    expect(page.get_by_label("Model")).to_be_hidden()  # one is loaded
    spec = MappingSpec("tiny", 3, (16,), 3, k=4)
    other = tiny_model.build(tmp_path / "tiny-k4.onnx", spec, meta=tiny_model.metadata(spec, "tiny-k4"))
    store = f"sqlite:///{tmp_path / 'hof.db'}"
    with (
        running(Settings(model=(SHIPPED_MODEL, other), database_url=store)) as server,
        browser.new_context(reduced_motion="reduce") as context,
    ):
        page = context.new_page()
        page.goto(f"http://127.0.0.1:{server.port}/")
        page.get_by_text("Advanced").click()
        page.get_by_label("Model").select_option("tiny-k4")
        page.set_input_files("#file", photo("chair"))
        expect(page.locator("#about")).to_contain_text("k = 4, of tiny-k4", timeout=TIMEOUT_MS)
        assert b'"model":"tiny-k4"' in run(curl_line(page, "encode"), photo("chair").parent)
        page.get_by_label("Model").select_option(index=0)
        page.set_input_files("#file", photo("chair"))
        expect(page.locator("#about")).to_contain_text("k = 2, of hof1-k2", timeout=TIMEOUT_MS)
        assert curl_line(page, "encode").endswith('/encode?keep_photo=true"')


def test_model_for_points_is_not_offered_for_photos(browser: Browser, model_path: Path, tmp_path: Path) -> None:
    spec = MappingSpec("tiny", 3, (16,), 3, k=4)
    other = tiny_model.build(tmp_path / "tiny-k4.onnx", spec, meta=tiny_model.metadata(spec, "tiny-k4"))
    models = (tiny_model.build_points(tmp_path / "tiny-k2-points.onnx"), model_path, other)
    settings = Settings(model=models, database_url=f"sqlite:///{tmp_path / 'hof.db'}", matting_model=None)
    with running(settings) as server, browser.new_context(reduced_motion="reduce") as context:
        page = context.new_page()
        page.goto(f"http://127.0.0.1:{server.port}/")
        page.get_by_text("Advanced").click()
        expect(page.get_by_label("Model")).to_be_visible(timeout=TIMEOUT_MS)
        assert len(httpx.get(f"http://127.0.0.1:{server.port}/models").json()["models"]) == 3
        values = page.locator("#model option").evaluate_all("(options) => options.map(({ value }) => value)")
        assert values == ["", "tiny-k4"]
        page.set_input_files("#file", photo("chair"))
        expect(page.locator("#about")).to_contain_text("k = 2, of tiny-k2", timeout=TIMEOUT_MS)


def test_photo_that_is_dropped_is_encoded(page: Page) -> None:
    page.evaluate("""async () => {
        const content = await (await fetch("/viewer/photos/chair.webp")).blob();
        const dataTransfer = new DataTransfer();
        dataTransfer.items.add(new File([content], "chair.webp", { type: "image/webp" }));
        document.body.dispatchEvent(new DragEvent("drop", { dataTransfer, bubbles: true, cancelable: true }));
    }""")
    expect(page.locator("#framing")).to_be_visible()


def test_points_when_more_are_appended_when_fewer_nothing_is_fetched(page: Page) -> None:
    queries: list[str] = []

    def note(request: Request) -> None:
        if "/points?" in request.url:
            queries.append(request.url.partition("?")[2])

    page.on("request", note)
    page.evaluate("""() => {
        globalThis.counts = new Set();
        const count = document.getElementById("count");
        new MutationObserver(() => counts.add(count.textContent)).observe(count, { childList: true });
    }""")
    few, coarse = inked(page), pixels(page)
    page.locator("#n").press("End")
    expect(page.locator("#count")).to_have_text("1,000,000 points")
    assert queries == ["n=990000&seed=0&offset=10000&format=pcd"]
    assert len(page.evaluate("[...counts]")) > 3
    assert changed(pixels(page), coarse) > 0.05  # discs are smaller, the more there are
    page.screenshot(path=PICTURES / "million.png")
    page.locator("#n").press("Home")
    expect(page.locator("#count")).to_have_text("100 points")
    assert inked(page) < few
    assert len(queries) == 1


def test_points_turn_by_key_and_pointer_and_change_with_the_seed(page: Page) -> None:
    canvas = page.locator("#stage canvas")
    before = pixels(page)
    canvas.press("ArrowLeft")
    turned = pixels(page)
    assert changed(turned, before) > 0.005
    canvas.press("Home")
    assert changed(pixels(page), before) < 0.01  # but for the ring of the focus
    canvas.hover()
    page.mouse.down()
    page.mouse.move(500, 300)
    page.mouse.up()
    before = pixels(page)
    assert changed(before, turned) > 0.005
    page.locator("#seed").fill("7")
    with page.expect_response(lambda response: "seed=7" in response.url):
        page.locator("#seed").press("Tab")
    expect(page.locator("#count")).to_have_text("10,000 points")
    assert changed(pixels(page), before) > 0.005


def test_gallery_drag_of_one_object_onto_another_composes_them(page: Page) -> None:
    cards = page.locator("#gallery li:has(.mix)")
    cards.nth(0).drag_to(cards.nth(1))
    labels = page.locator("#words button")
    expect(labels).to_have_text(["A", "AB", "BA", "B"])
    expect(page.locator("#count")).to_have_text("10,000 points each")
    expect(page.locator("#about")).to_contain_text("AB is A(B(x))")
    assert run(curl_line(page, "gallery"), ROOT).count(b'"kind":"composed"') == 1
    expect(page.locator("#gallery li:not(:has(.mix))")).to_have_count(2)  # AB and BA; AA and BB would be copies
    shown = ink(page)
    height, width = (side // 2 for side in shown.shape)
    for cell in (shown[:height, :width], shown[:height, width:], shown[height:, :width], shown[height:, width:]):
        assert cell.sum() > 1000
    page.screenshot(path=PICTURES / "composed.png", full_page=True)
    labels.nth(1).click()
    expect(page.locator("#about")).to_contain_text("composed")
    expect(page.locator("#words")).to_be_hidden()
    expect(page.locator("#count")).to_have_text("10,000 points")


def test_gallery_by_keyboard_composes_two_objects(page: Page) -> None:
    mix = page.locator("#gallery .mix")
    mix.nth(0).press("Enter")
    expect(mix.nth(0)).to_have_attribute("aria-pressed", "true")
    page.keyboard.press("Escape")
    expect(mix.nth(0)).to_have_attribute("aria-pressed", "false")
    mix.nth(0).press("Enter")
    mix.nth(1).press("Enter")
    expect(page.locator("#words button")).to_have_count(4)
    expect(page.locator("#stage canvas")).to_be_focused()


def test_gallery_click_opens_the_object(page: Page) -> None:
    opening = page.locator("#gallery li:has(.mix) .open").last
    opening.click()
    expect(page.locator("#gallery li.shown .open")).to_have_text(opening.inner_text())
    assert opening.inner_text().split()[1] in curl_line(page, "download")


@pytest.fixture
def page_in_color(browser: Browser, colored: httpx.Client) -> Iterator[Page]:
    """Open the page of a service whose model colors its objects, with one object."""
    assert colored.post("/encode", content=photo("chair").read_bytes()).status_code == 201
    with browser.new_context(viewport={"width": 1280, "height": 1000}) as context:
        yield opened(context.new_page(), str(colored.base_url))


def test_points_in_color_are_shown_and_saved_so_unless_switched_off(page_in_color: Page, tmp_path: Path) -> None:
    page = page_in_color
    assert warm(page) > 500
    page.screenshot(path=PICTURES / "color.png")
    page.locator("#n").press("End")
    expect(page.locator("#count")).to_have_text("1,000,000 points")
    page.locator("#n").press("Home")
    for color, header in ((True, b"property uchar red"), (False, b"property float z\nend_header")):
        page.get_by_label("Color").set_checked(color)
        assert (warm(page) > 0) == color
        run(curl_line(page, "download"), tmp_path)
        assert header in (tmp_path / "object.ply").read_bytes()


def test_surface_in_color_is_shown_and_saved_so_unless_switched_off(page_in_color: Page, tmp_path: Path) -> None:
    page = page_in_color
    page.get_by_role("switch", name="Surface").check()
    expect(page.locator("#count")).to_have_text(TRIANGLES)
    painted = pixels(page)
    assert warm(page) > 500
    page.screenshot(path=PICTURES / "surface-color.png")
    for color in (False, True):
        page.get_by_label("Color").set_checked(color)
        assert (warm(page) > 0) == color
        run(curl_line(page, "download"), tmp_path)
        assert (b"COLOR_0" in (tmp_path / "object.glb").read_bytes()) == color
    assert changed(pixels(page), painted) == 0
    page.locator("#format").select_option("safetensors")
    page.get_by_label("Color").uncheck()
    assert "color" not in curl_line(page, "download")


def test_surface_switch_shows_the_surface_and_back_the_points(page: Page, tmp_path: Path) -> None:
    points = pixels(page)
    page.get_by_role("switch", name="Surface").check()
    expect(page.locator("#count")).to_have_text(TRIANGLES)
    assert changed(pixels(page), points) > 0.02
    page.screenshot(path=PICTURES / "surface.png")
    glb = trimesh.load(io.BytesIO(saved(page, "download", tmp_path)), file_type="glb").to_geometry()
    expect(page.locator("#count")).to_have_text(f"{len(glb.faces):,} triangles")
    expect(page.locator("#n")).to_be_disabled()
    page.get_by_role("switch", name="Surface").uncheck()
    expect(page.locator("#count")).to_have_text("10,000 points")
    assert changed(pixels(page), points) < 0.01  # the stage's tone, too
    assert "/points?" in curl_line(page, "download")


def test_object_that_is_named_keeps_its_name_and_shows_its_photo(page: Page, address: str) -> None:
    page.get_by_role("button", name="Barrel", exact=True).click()
    expect(page.locator("#framing figcaption")).to_contain_text("Background")  # by then the page has scrolled itself
    shown = page.locator("#gallery li.shown")
    page.locator("#gallery").scroll_into_view_if_needed()
    expect(shown.locator(".photo")).to_be_visible()
    page.get_by_label("Name", exact=True).fill("Rain barrel")
    page.keyboard.press("Enter")
    expect(shown.locator(".open")).to_have_text("Rain barrel")
    expect(shown.locator(".photo")).to_be_visible()
    page.locator("#gallery").screenshot(path=PICTURES / "gallery.png")
    page.reload()
    expect(page.get_by_label("Name", exact=True)).to_have_value("Rain barrel")
    page.get_by_label("Name", exact=True).fill("")
    page.keyboard.press("Enter")
    expect(shown.locator(".open")).to_contain_text("Photo")
    page.get_by_text("Advanced").click()
    page.get_by_label("Keep a small picture").uncheck()
    page.get_by_role("button", name="Bed", exact=True).click()
    expect(page.locator("#framing figcaption")).to_contain_text("Background")
    expect(page.get_by_label("Name", exact=True)).to_have_value("")
    expect(page.locator("#gallery li.shown .open")).to_contain_text("Photo")
    expect(shown.locator(".photo")).to_be_hidden()
    newest = httpx.get(f"{address}/objects?limit=1").json()["items"][0]
    assert "photo" not in newest["links"]
