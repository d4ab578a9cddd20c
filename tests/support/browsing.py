"""The page in Chromium, for tests: a service, a browser, and what one sees and saves. A plugin of conftest.py."""

import io
import re
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, ConsoleMessage, Page, Playwright, Route, expect, sync_playwright

from service.settings import SHIPPED_MODEL, Settings
from tests.support import ROOT
from tests.support.server import running
from tests.support.slow import DEADLINE_S

PICTURES = ROOT / "out" / "viewer"
WEBGL = [
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--disable-gpu-rasterization", "--disable-gpu-compositing"),  # SwiftShader, an imitated GPU, takes longer for it
]
TIMEOUT_MS = 60_000
TRIANGLES = re.compile(r"^[\d,]{5,} triangles$")
INK = 40  # of 255: by how much a pixel differs from the empty stage to be the object's
SHADE = 2  # of 255: a difference between two pixels that nobody sees
FRAMES = "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
DRAWN = """async () => {
    const frames = () => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
    await frames(); // the page has asked for its drawing
    const gl = document.querySelector("#stage canvas").getContext("webgl2");
    gl?.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4)); // returns when all is drawn
    await frames();
}"""
POINTS_FIRST = """
    addEventListener("DOMContentLoaded", () => {
        const surface = document.getElementById("surface"); // null on other pages
        if (!surface || performance.getEntriesByType("navigation")[0].type === "reload") return;
        document.getElementById("n").value = 4;
        surface.click();
    });
"""
QUICK_LOOK = """
    const supports = DOMTokenList.prototype.supports;
    DOMTokenList.prototype.supports = function (token) { return token === "ar" || supports.call(this, token); };
"""

Picture = np.ndarray[tuple[int, ...], np.dtype[np.int16]]


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Start Chromium without a window."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as playwright:
        browser = launched(playwright)
        yield browser
        browser.close()


def launched(playwright: Playwright, program: str = "chromium-headless-shell") -> Browser:
    """Start Chromium without a window. Its headless shell has the engine of `chromium`, and takes less time."""
    chromium = shutil.which(program)
    assert chromium, f"{program} is not installed: it is a package of Debian, and `make test` installs the shell"
    return playwright.chromium.launch(executable_path=chromium, args=WEBGL)


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Run a service with the default model and two objects, a chair and an armchair."""
    store = f"sqlite:///{tmp_path_factory.mktemp('store') / 'hof.db'}"
    settings = Settings(
        model=(SHIPPED_MODEL,),
        database_url=store,
        matting_model=None,
        threads=1,
        max_points_in_flight=100_000_000,  # as it opens, the page asks for more than the default
    )
    with running(settings) as server:
        address = f"http://127.0.0.1:{server.port}"
        for name in ("chair", "armchair"):
            assert httpx.post(f"{address}/encode", content=photo(name).read_bytes(), timeout=60).status_code == 201
        yield address


@pytest.fixture
def page(browser: Browser, address: str) -> Iterator[Page]:
    """Open the page; no script may fail and no policy be broken while a test uses it."""
    with browser.new_context(viewport={"width": 1280, "height": 1000}, accept_downloads=True) as context:
        page = opened(context.new_page(), address)
        faults: list[str] = []

        def note(message: ConsoleMessage) -> None:
            if message.type == "error" and "Failed to load resource" not in message.text:  # 4xx that a test provokes
                faults.append(message.text)

        page.on("console", note)
        page.on("pageerror", lambda error: faults.append(str(error)))
        yield page
        assert faults == []


def opened(page: Page, address: str) -> Page:
    """Open the page, and wait until it shows 10,000 points of its first object.

    It is switched to points before it fetches the surface, which would take most of the time.
    """
    wait_long(page)
    page.emulate_media(reduced_motion="reduce")  # no turntable
    page.add_init_script(POINTS_FIRST)
    page.goto(f"{address}/")
    page.get_by_text("Advanced").click()
    expect(page.locator("#count")).to_have_text("10,000 points")
    return page


def wait_long(page: Page) -> None:
    """Let all that waits for this page, and all that expects, do so for TIMEOUT_MS: the machine may be busy."""
    page.set_default_timeout(TIMEOUT_MS)
    expect.set_options(timeout=TIMEOUT_MS)


def hold(page: Page, pattern: str, count: int | None = None) -> list[Route]:
    """Hold the requests for a pattern back, or the first `count` of them, until `release`."""
    held: list[Route] = []

    def keep(route: Route) -> None:
        if len(held) == count:
            route.continue_()
        else:
            held.append(route)

    page.route(pattern, keep)
    return held


def release(page: Page, pattern: str, held: list[Route]) -> None:
    """Let held requests go, and those that follow."""
    for route in held:
        route.continue_()
    page.unroute(pattern)


def first(page: Page, held: list[Route]) -> Route:
    """Wait for the first request that is held, and return it."""
    deadline = time.monotonic() + DEADLINE_S
    while not held:
        assert time.monotonic() < deadline
        page.wait_for_timeout(10)
    return held[0]


def photo(name: str) -> Path:
    """Return the path of a photo of the demo."""
    return ROOT / "demo" / f"{name}.png"


def pixels(page: Page) -> Picture:
    """Return the picture on the stage, once it is drawn and rests: (height, width, 3)."""
    picture = _captured(page)
    deadline = time.monotonic() + DEADLINE_S
    while not np.array_equal(after := _captured(page), picture):
        assert time.monotonic() < deadline
        picture = after
    return picture


def changed(picture: Picture, earlier: Picture) -> float:
    """Return the share of pixels that look different. A background's gradient may differ by a unit, tile by tile."""
    return float((abs(picture - earlier).max(axis=2) > SHADE).mean())


def ink(page: Page) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Return which pixels of the stage show the object, on a light stage and on a dark one: (height, width)."""
    shown = pixels(page)
    canvas = page.locator("#stage canvas")
    canvas.evaluate("(canvas) => { canvas.style.opacity = 0 }")
    empty = pixels(page)
    canvas.evaluate("(canvas) => { canvas.style.opacity = '' }")
    inked: np.ndarray[tuple[int, ...], np.dtype[np.bool_]] = abs(shown - empty).max(axis=2) > INK
    return inked


def inked(page: Page) -> int:
    """Return the number of pixels of the stage that show the object."""
    return int(ink(page).sum())


def _captured(page: Page) -> Picture:
    page.evaluate(DRAWN)
    image = Image.open(io.BytesIO(page.locator("#stage canvas").screenshot()))
    return np.asarray(image.convert("RGB")).astype(np.int16)


def warm(page: Page) -> int:
    """Return the number of pixels of the stage with clearly more red than blue, which no shade has."""
    shown = pixels(page)
    return int((shown[..., 0] - shown[..., 2] > INK).sum())


def curl_line(page: Page, of: str) -> str:
    """Return the curl line that the page shows under an action."""
    return page.locator(f'.curl[data-of="{of}"] code').text_content() or ""


def run(line: str, folder: Path) -> bytes:
    """Run a line in a shell and return its output."""
    bash = shutil.which("bash")
    assert bash
    return subprocess.run([bash, "-c", f"{line} -sS"], cwd=folder, capture_output=True, timeout=60, check=True).stdout


def saved(page: Page, of: str, folder: Path) -> bytes:
    """Run a curl line of the page and return the file that it writes."""
    run(curl_line(page, of), folder)
    (fetched,) = folder.iterdir()
    return fetched.read_bytes()
