"""The page in Chromium: what a visitor does with it. Pictures of it are written to out/viewer."""

import io
import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest
import tiny_model
import trimesh
from conftest import running
from PIL import Image
from playwright.sync_api import Browser, ConsoleMessage, Page, expect, sync_playwright

from service.keys import make_key
from service.mapping import MappingSpec
from service.routes import viewer
from service.settings import SHIPPED_MODEL, Settings

ROOT = Path(__file__).parents[1]
PICTURES = ROOT / "out" / "viewer"
WEBGL = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
TIMEOUT_MS = 60_000
INK = 40  # of 255: by how much a pixel differs from the panel's white to be a point's


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    chromium = shutil.which("chromium")
    assert chromium, "the page is tested in Debian's chromium: tests/system.sh installs it"
    PICTURES.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=WEBGL)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A service with the shipped model and two objects, a chair and an armchair."""
    store = tmp_path_factory.mktemp("store") / "hof.db"
    with running(Settings(database_url=f"sqlite:///{store}", matting_model=None, threads=1)) as server:
        address = f"http://127.0.0.1:{server.port}"
        for name in ("chair", "armchair"):
            assert httpx.post(f"{address}/encode", content=_photo(name).read_bytes(), timeout=60).status_code == 201
        yield address


@pytest.fixture
def page(browser: Browser, address: str) -> Iterator[Page]:
    """The page, opened; no script may fail and no policy be broken while a test uses it."""
    with browser.new_context(viewport={"width": 1280, "height": 1000}, accept_downloads=True) as context:
        page = _opened(context.new_page(), address)
        faults: list[str] = []

        def note(message: ConsoleMessage) -> None:
            if message.type == "error" and "Failed to load resource" not in message.text:  # 4xx that a test provokes
                faults.append(message.text)

        page.on("console", note)
        page.on("pageerror", lambda error: faults.append(str(error)))
        yield page
        assert faults == []


def _opened(page: Page, address: str) -> Page:
    page.set_default_timeout(TIMEOUT_MS)
    expect.set_options(timeout=TIMEOUT_MS)
    page.goto(f"{address}/")
    expect(page.locator("#count")).to_have_text("10,000 points")
    return page


def _photo(name: str) -> Path:
    return ROOT / "demo" / f"{name}.png"


def _pixels(page: Page) -> np.ndarray[tuple[int, ...], np.dtype[np.int16]]:
    """What the stage shows, once it is drawn: (height, width, 3)."""
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    image = Image.open(io.BytesIO(page.locator("#stage canvas").screenshot()))
    return np.asarray(image.convert("RGB")).astype(np.int16)


def _inked(page: Page) -> int:
    """How many pixels of the stage are points."""
    return int((255 - _pixels(page).min(axis=2) > INK).sum())


def _warm(page: Page) -> int:
    """How many pixels of the stage have clearly more red than blue, which no shade has."""
    pixels = _pixels(page)
    return int((pixels[..., 0] - pixels[..., 2] > INK).sum())


def _curl_line(page: Page, of: str) -> str:
    return page.locator(f'.curl[data-of="{of}"] code').inner_text()


def _run(line: str, folder: Path) -> bytes:
    bash = shutil.which("bash")
    assert bash
    return subprocess.run([bash, "-c", f"{line} -sS"], cwd=folder, capture_output=True, timeout=60, check=True).stdout


def _saved(page: Page, of: str, folder: Path) -> bytes:
    """The file that a curl line of the page writes."""
    _run(_curl_line(page, of), folder)
    (fetched,) = folder.iterdir()
    return fetched.read_bytes()


def test_the_policy_allows_the_map_of_imports_and_nothing_from_elsewhere(browser: Browser, address: str) -> None:
    with browser.new_context() as context:
        page = context.new_page()
        page.goto(f"{address}/")
        pinned = json.loads((viewer.STATIC.parent / "package.json").read_text("utf-8"))["dependencies"]["three"]
        assert page.evaluate("async () => (await import('three')).REVISION") == pinned.split(".")[1]
        asked = "fetch('https://example.org').then(() => 'fetched', () => 'blocked')"
        with page.expect_console_message(lambda message: "Content Security Policy" in message.text):
            assert page.evaluate(f"async () => {asked}") == "blocked"


def test_a_photo_is_encoded_and_its_points_appear(browser: Browser, address: str) -> None:
    with browser.new_context(viewport={"width": 1280, "height": 1000}) as context:
        page = context.new_page()
        page.route("**/objects?*", lambda route: route.fulfill(json={"items": [], "next": None}))  # as on the first day
        page.goto(f"{address}/")
        expect(page.locator("#empty")).to_be_visible()
        empty = _inked(page)
        page.unroute("**/objects?*")
        page.set_input_files("#file", _photo("chair"))
        expect(page.locator("#count")).to_have_text("10,000 points", timeout=TIMEOUT_MS)
        expect(page.locator("#empty")).to_be_hidden()
        assert _inked(page) > empty + 2000
        expect(page.locator("#framing figcaption")).to_contain_text("transparency")
        page.screenshot(path=PICTURES / "encoded.png")
        frame, box = (page.locator(f"#framing .{name}").bounding_box() for name in ("picture", "box"))
        assert frame
        assert box
        assert 0 < box["width"] < frame["width"]
        assert b'"mask":"alpha"' in _run(_curl_line(page, "encode"), _photo("chair").parent)


def test_an_example_is_encoded(page: Page) -> None:
    page.get_by_role("button", name="Armchair", exact=True).click()
    expect(page.locator("#framing")).to_be_visible()
    expect(page.locator("#gallery li.shown")).to_have_count(1)


def test_the_model_is_chosen_where_there_are_two(page: Page, browser: Browser, tmp_path: Path) -> None:
    expect(page.get_by_label("Model")).to_be_hidden()  # one is loaded
    spec = MappingSpec("tiny", 3, (16,), 3, k=4)
    other = tiny_model.build(tmp_path / "tiny-k4.onnx", spec, meta=tiny_model.metadata(spec, "tiny-k4"))
    store = f"sqlite:///{tmp_path / 'hof.db'}"
    with (
        running(Settings(model=(SHIPPED_MODEL, other), database_url=store)) as server,
        browser.new_context() as context,
    ):
        page = context.new_page()
        page.goto(f"http://127.0.0.1:{server.port}/")
        page.get_by_label("Model").select_option("tiny-k4")
        page.set_input_files("#file", _photo("chair"))
        expect(page.locator("#about")).to_contain_text("k = 4, of tiny-k4", timeout=TIMEOUT_MS)
        assert b'"model":"tiny-k4"' in _run(_curl_line(page, "encode"), _photo("chair").parent)
        page.get_by_label("Model").select_option(index=0)
        page.set_input_files("#file", _photo("chair"))
        expect(page.locator("#about")).to_contain_text("k = 2, of hof1-k2", timeout=TIMEOUT_MS)
        assert _curl_line(page, "encode").endswith("/encode")


def test_a_dropped_photo_is_encoded(page: Page) -> None:
    page.evaluate("""async () => {
        const content = await (await fetch("/viewer/bundle/photos/chair.png")).blob();
        const dataTransfer = new DataTransfer();
        dataTransfer.items.add(new File([content], "chair.png", { type: "image/png" }));
        document.body.dispatchEvent(new DragEvent("drop", { dataTransfer, bubbles: true, cancelable: true }));
    }""")
    expect(page.locator("#framing")).to_be_visible()


def test_more_points_are_appended_as_they_arrive_and_fewer_cost_nothing(page: Page) -> None:
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url.partition("?")[2]))
    page.evaluate("""() => {
        globalThis.told = new Set();
        const count = document.getElementById("count");
        new MutationObserver(() => told.add(count.textContent)).observe(count, { childList: true });
    }""")
    few = _inked(page)
    page.locator("#n").press("End")
    expect(page.locator("#count")).to_have_text("1,000,000 points")
    assert asked == ["n=990000&seed=0&offset=10000&format=f32"]
    assert len(page.evaluate("[...told]")) > 3
    assert _inked(page) > 1.5 * few
    page.screenshot(path=PICTURES / "million.png")
    page.locator("#n").press("Home")
    expect(page.locator("#count")).to_have_text("100 points")
    assert _inked(page) < few
    assert len(asked) == 1


def test_keys_and_pointer_turn_the_points_and_the_seed_draws_others(page: Page) -> None:
    canvas = page.locator("#stage canvas")
    before = _pixels(page)
    canvas.press("ArrowLeft")
    turned = _pixels(page)
    assert (turned != before).any()
    canvas.press("Home")
    assert (_pixels(page) == before).mean() > 0.99  # but for the ring of the focus
    canvas.hover()
    page.mouse.down()
    page.mouse.move(500, 300)
    page.mouse.up()
    before = _pixels(page)
    assert (before != turned).mean() > 0.005
    page.locator("#seed").fill("7")
    with page.expect_response(lambda response: "seed=7" in response.url):
        page.locator("#seed").press("Tab")
    expect(page.locator("#count")).to_have_text("10,000 points")
    assert (_pixels(page) != before).mean() > 0.005


def test_two_objects_are_composed_by_dragging_one_onto_the_other(page: Page) -> None:
    cards = page.locator("#gallery li:has(.mix)")
    cards.nth(0).drag_to(cards.nth(1))
    labels = page.locator("#words button")
    expect(labels).to_have_text(["AA", "AB", "BA", "BB"])
    expect(page.locator("#count")).to_have_text("10,000 points each")
    expect(page.locator("#about")).to_contain_text("AB is A(B(x))")
    assert _run(_curl_line(page, "gallery"), ROOT).count(b'"kind":"composed"') == 4
    pixels = _pixels(page)
    height, width = (side // 2 for side in pixels.shape[:2])
    for cell in (pixels[:height, :width], pixels[:height, width:], pixels[height:, :width], pixels[height:, width:]):
        assert (255 - cell.min(axis=2) > INK).sum() > 1000
    page.screenshot(path=PICTURES / "composed.png", full_page=True)
    labels.nth(1).click()
    expect(page.locator("#about")).to_contain_text("composed")
    expect(page.locator("#words")).to_be_hidden()
    expect(page.locator("#count")).to_have_text("10,000 points")


def test_two_objects_are_composed_with_the_keyboard(page: Page) -> None:
    mix = page.locator("#gallery .mix")
    mix.nth(0).press("Enter")
    expect(mix.nth(0)).to_have_attribute("aria-pressed", "true")
    page.keyboard.press("Escape")
    expect(mix.nth(0)).to_have_attribute("aria-pressed", "false")
    mix.nth(0).press("Enter")
    mix.nth(1).press("Enter")
    expect(page.locator("#words button")).to_have_count(4)
    expect(page.locator("#stage canvas")).to_be_focused()


def test_an_object_of_the_gallery_opens(page: Page) -> None:
    opening = page.locator("#gallery li:has(.mix) .open").last
    opening.click()
    expect(page.locator("#gallery li.shown .open")).to_have_text(opening.inner_text())
    assert opening.inner_text().split()[1] in _curl_line(page, "download")


def test_an_object_in_colour_is_shown_and_saved_so_unless_switched_off(
    browser: Browser, settings: Settings, colored_path: Path, tmp_path: Path
) -> None:
    with (
        running(settings.model_copy(update={"model": colored_path})) as server,
        browser.new_context(viewport={"width": 1280, "height": 1000}) as context,
    ):
        address = f"http://127.0.0.1:{server.port}"
        assert httpx.post(f"{address}/encode", content=_photo("chair").read_bytes()).status_code == 201
        page = _opened(context.new_page(), address)
        assert _warm(page) > 500
        page.screenshot(path=PICTURES / "color.png")
        page.locator("#n").press("End")
        expect(page.locator("#count")).to_have_text("1,000,000 points")
        page.locator("#n").press("Home")
        for color, header in ((True, b"property uchar red"), (False, b"property float z\nend_header")):
            page.get_by_label("Colour").set_checked(color)
            assert (_warm(page) > 0) == color
            (tmp_path / "object.ply").unlink(missing_ok=True)
            _run(_curl_line(page, "download"), tmp_path)
            assert header in (tmp_path / "object.ply").read_bytes()


def test_files_are_saved_as_the_curl_line_gets_them(page: Page, tmp_path: Path) -> None:
    options = page.locator("#format option")
    for index in range(options.count()):
        page.locator("#format").select_option(index=index)
        with page.expect_download() as saved:
            page.get_by_role("button", name="Save").click()
        assert re.fullmatch(r"hof-[0-9a-f]{32}\.\w+", saved.value.suggested_filename)
        folder = tmp_path / str(index)
        folder.mkdir()
        _run(_curl_line(page, "download"), folder)
        (fetched,) = folder.iterdir()
        assert fetched.read_bytes() == Path(saved.value.path()).read_bytes(), fetched.name


def test_the_switch_shows_the_surface_and_brings_the_points_back(page: Page, tmp_path: Path) -> None:
    points = _pixels(page)
    page.get_by_role("switch", name="Surface").check()
    expect(page.locator("#count")).to_have_text(re.compile(r"^[\d,]{5,} triangles$"))
    assert (_pixels(page) != points).mean() > 0.02
    page.screenshot(path=PICTURES / "surface.png")
    glb = trimesh.load(io.BytesIO(_saved(page, "download", tmp_path)), file_type="glb").to_geometry()
    expect(page.locator("#count")).to_have_text(f"{len(glb.faces):,} triangles")
    expect(page.locator("#n")).to_be_disabled()
    page.get_by_role("switch", name="Surface").uncheck()
    expect(page.locator("#count")).to_have_text("10,000 points")
    assert (_pixels(page) == points).mean() > 0.99
    assert "/points?" in _curl_line(page, "download")


def test_errors_are_shown_as_the_service_tells_them(page: Page, tmp_path: Path) -> None:
    (tmp_path / "no.png").write_text("no image")
    page.set_input_files("#file", tmp_path / "no.png")
    problem = page.get_by_role("alert")
    expect(problem).to_contain_text("Unsupported media type")
    expect(problem).to_contain_text("PNG")
    page.screenshot(path=PICTURES / "error.png")
    problem.get_by_role("button").click()
    expect(problem).to_be_hidden()
    page.locator("#n").press("End")
    page.locator("#format").select_option("json")
    page.get_by_role("button", name="Save").click()
    expect(problem).to_contain_text("Invalid parameter")


def test_a_key_is_asked_for_once_and_used(browser: Browser, model_path: Path, tmp_path: Path) -> None:
    token, key = make_key("visitor", frozenset({"read", "write"}))
    (tmp_path / "keys").write_text(key.line)
    settings = Settings(
        model=(model_path,), database_url=f"sqlite:///{tmp_path / 'hof.db'}", api_keys_file=tmp_path / "keys", threads=1
    )
    with running(settings) as server, browser.new_context() as context:
        page = context.new_page()
        page.set_default_timeout(TIMEOUT_MS)
        page.goto(f"http://127.0.0.1:{server.port}/")
        dialog = page.get_by_role("dialog", name="API key")
        for given in ("wrong", token):  # a key that is not known is asked for again
            dialog.get_by_label("API key").fill(given)
            dialog.get_by_role("button", name="Continue").click()
        expect(dialog).to_be_hidden(timeout=TIMEOUT_MS)
        page.set_input_files("#file", _photo("chair"))
        expect(page.locator("#count")).to_have_text("10,000 points", timeout=TIMEOUT_MS)
        expect(dialog).to_be_hidden()
        assert "$HOF_KEY" in _curl_line(page, "download")
        assert token not in page.content()
        with context.new_page() as other:  # another tab asks again
            other.goto(f"http://127.0.0.1:{server.port}/")
            expect(other.get_by_role("dialog", name="API key")).to_be_visible(timeout=TIMEOUT_MS)
            other.get_by_role("button", name="Cancel").click()
            expect(other.get_by_role("alert")).to_contain_text("Unauthenticated")


def test_every_action_is_reached_with_the_tab_key(page: Page) -> None:
    reached = set()
    for _ in range(60):
        page.keyboard.press("Tab")
        reached.add(
            page.evaluate(
                "(({id, className, dataset, tagName}) => id || className || dataset.photo || tagName)"
                "(document.activeElement)"
            )
        )
    assert {
        "file",
        "armchair.png",
        "chair.png",
        "coffee.jpg",
        "CANVAS",
        "n",
        "seed",
        "surface",
        "format",
        "open",
        "mix",
    } <= reached
    assert "BUTTON" in reached  # Copy, Save


def test_it_fits_a_phone_in_the_dark(browser: Browser, address: str) -> None:
    with browser.new_context(
        viewport={"width": 360, "height": 740}, color_scheme="dark", device_scale_factor=2, has_touch=True
    ) as context:
        page = _opened(context.new_page(), address)
        assert page.evaluate("document.documentElement.scrollWidth") == 360
        assert _pixels(page).mean() < 80
        page.screenshot(path=PICTURES / "phone.png", full_page=True)


def test_the_documentation_needs_no_one_else(browser: Browser, address: str) -> None:
    with browser.new_context() as context:
        page = context.new_page()
        asked: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        page.goto(f"{address}/docs")
        expect(page.get_by_role("heading", name="HOF").first).to_be_visible(timeout=TIMEOUT_MS)
        assert [url for url in asked if not url.startswith((address, "data:"))] == []
