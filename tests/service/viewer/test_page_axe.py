"""Every state of the page and of /embed, light and dark, on a desk and on phones: axe finds no fault."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, NamedTuple

import httpx
import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect

from service.api.keys import make_key
from service.settings import Settings
from tests.support.browsing import PICTURES, QUICK_LOOK, TIMEOUT_MS, TRIANGLES, opened, photo
from tests.support.server import running
from tests.support.small import model as tiny_model
from tests.support.small.data import box

AXE = Path(__file__).parent / "tools" / "node_modules" / "axe-core" / "axe.min.js"
RULES = {"type": "tag", "values": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]}
RULES_OF_COLOR = {"type": "rule", "values": ["color-contrast", "link-in-text-block"]}

State = Callable[[Page], None]


class Look(NamedTuple):
    """A size of the window and a color scheme; `full`: all rules are checked in it, else those of colors."""

    width: int
    height: int
    scheme: Literal["light", "dark"]
    full: bool

    def put_on(self, page: Page) -> None:
        """Give an open page this look."""
        page.set_viewport_size({"width": self.width, "height": self.height})
        page.emulate_media(color_scheme=self.scheme)


# Both looks of a pair have one layout, so that the second one differs in its colors alone.
DESK = (Look(1280, 1000, "light", full=True), Look(1280, 1000, "dark", full=False))
PHONE = (Look(360, 640, "light", full=True), Look(390, 844, "dark", full=False))

Looks = tuple[Look, Look]


@pytest.fixture(params=[DESK, PHONE], ids=["desk", "phone"])
def looks(request: pytest.FixtureRequest) -> Looks:
    looks: Looks = request.param
    return looks


@pytest.fixture
def visitor(browser: Browser, address: str, looks: Looks) -> Iterator[Page]:
    """Open the page in the first look; nothing may be requested from elsewhere while a test uses it."""
    with _context(browser, looks) as context:
        urls: list[str] = []
        context.on("request", lambda request: urls.append(request.url))
        yield opened(context.new_page(), address)
        assert [url for url in urls if not url.startswith((address, f"blob:{address}", "data:"))] == []


@contextmanager
def _context(browser: Browser, looks: Looks) -> Iterator[BrowserContext]:
    width, height, scheme, _ = looks[0]
    options: dict[str, Any] = {"viewport": {"width": width, "height": height}, "color_scheme": scheme}
    with browser.new_context(**options, has_touch=width < 500, reduced_motion="reduce") as context:
        yield context


def _points(page: Page) -> None:
    expect(page.locator("#count")).to_have_text("10,000 points")


def _to_gallery(page: Page) -> None:
    """Scroll to the cards: those far from the view are empty."""
    page.locator("#gallery ul").evaluate("(list) => list.scrollIntoView()")


def _named(page: Page) -> None:
    page.get_by_label("Name", exact=True).fill("A chair with a rather long name that does not fit into its card")
    page.keyboard.press("Enter")
    _to_gallery(page)
    expect(page.locator("#gallery li.shown .open")).to_contain_text("A chair with")


def _live(page: Page) -> None:
    page.get_by_role("switch", name="From the function").check()
    expect(page.locator("#function")).to_be_visible()


def _path(page: Page) -> None:
    page.get_by_text("Path for a robot").click()
    expect(page.locator("#way")).to_contain_text("long")


def _no_path(page: Page) -> None:
    page.locator("#clearance").fill("1")
    page.keyboard.press("Tab")
    expect(page.locator("#way")).to_contain_text("No way")


def _photo(page: Page) -> None:
    page.set_input_files("#file", photo("chair"))
    expect(page.locator("#framing figcaption")).to_contain_text("transparency")


def _crop(page: Page) -> None:
    page.get_by_role("button", name="Crop").click()
    expect(page.locator("#crop-size")).to_contain_text("pixels")


def _error(page: Page) -> None:
    page.get_by_role("button", name="Cancel").click()
    page.set_input_files("#file", {"name": "no.png", "mimeType": "image/png", "buffer": b"no image"})
    expect(page.locator("#problem")).to_be_visible()


def _words(page: Page) -> None:
    _to_gallery(page)
    mix = page.locator("#gallery .mix:not([disabled])")
    mix.nth(0).click()
    mix.nth(1).click()
    expect(page.locator("#words button")).to_have_count(4)


def _morph(page: Page) -> None:
    page.locator("#between").press("End")
    expect(page.locator("#sides")).to_be_visible()


def _surface(page: Page) -> None:
    _to_gallery(page)
    page.locator("#gallery .open").first.click()
    page.get_by_role("switch", name="Surface").check()
    expect(page.locator("#count")).to_have_text(TRIANGLES)


def _deleted(page: Page) -> None:
    page.route("**/objects/*", lambda route: route.fulfill(status=204))  # the objects stay for the next test
    _to_gallery(page)
    page.locator("#gallery .delete").last.click()
    expect(page.get_by_role("button", name="Undo")).to_be_visible()


STATES: dict[str, State] = {
    each.__name__.strip("_"): each
    for each in (
        *(_points, _named, _live, _path, _no_path, _photo, _crop, _error),
        *(_words, _morph, _surface, _deleted),
    )
}


def test_states_have_no_fault_that_axe_finds_and_nothing_sticks_out(visitor: Page, looks: Looks) -> None:
    faults = []
    for name, reach in STATES.items():
        reach(visitor)
        faults += _faults(visitor, name, looks)
    assert faults == []


def test_object_in_a_frame_and_its_error_have_no_fault_that_axe_finds(
    browser: Browser, address: str, looks: Looks
) -> None:
    id_ = httpx.get(f"{address}/objects").json()["items"][0]["id"]
    with _context(browser, looks) as context:
        page = context.new_page()
        page.goto(f"{address}/embed#/objects/{id_}")
        expect(page.locator("#empty")).to_be_hidden(timeout=TIMEOUT_MS)
        faults = _faults(page, "embed", looks)
        page.goto("about:blank")
        page.goto(f"{address}/embed#/objects/{'0' * 32}")
        expect(page.locator("#empty")).to_contain_text("Not found", timeout=TIMEOUT_MS)
        assert faults + _faults(page, "embed-unknown", looks) == []


def test_controls_of_augmented_reality_have_no_fault_that_axe_finds(
    browser: Browser, address: str, looks: Looks
) -> None:
    with _context(browser, looks) as context:
        page = context.new_page()
        page.add_init_script(QUICK_LOOK)
        opened(page, address)
        expect(page.locator("#ar")).to_be_visible()
        assert _faults(page, "ar", looks) == []


def test_scan_has_no_fault_that_axe_finds(browser: Browser, model_path: Path, tmp_path: Path, looks: Looks) -> None:
    models = (model_path, tiny_model.build_points(tmp_path / "points.onnx"))
    content = "\n".join(f"{x} {y} {z}" for x, y, z in box(0)[:100]).encode()
    settings = Settings(model=models, database_url=f"sqlite:///{tmp_path / 'hof.db'}", threads=1)
    with running(settings) as server, _context(browser, looks) as context:
        page = context.new_page()
        page.goto(f"http://127.0.0.1:{server.port}/")
        page.set_input_files("#file", {"name": "a_scan_with_a_long_name.xyz", "mimeType": "", "buffer": content})
        expect(page.locator("#framing figcaption")).to_contain_text("100 points", timeout=TIMEOUT_MS)
        expect(page.locator("#count")).to_have_text(TRIANGLES, timeout=TIMEOUT_MS)
        expect(page.locator("#scans")).to_be_visible()
        assert _faults(page, "scan", looks) == []


def test_key_dialog_has_no_fault_that_axe_finds(
    browser: Browser, model_path: Path, tmp_path: Path, looks: Looks
) -> None:
    _, key = make_key("visitor", frozenset({"read", "write"}))
    (tmp_path / "keys").write_text(key.line)
    settings = Settings(
        model=(model_path,), database_url=f"sqlite:///{tmp_path / 'hof.db'}", api_keys_file=tmp_path / "keys", threads=1
    )
    with running(settings) as server, _context(browser, looks) as context:
        page = context.new_page()
        page.goto(f"http://127.0.0.1:{server.port}/")
        dialog = page.get_by_role("dialog", name="API key")
        expect(dialog).to_be_visible(timeout=TIMEOUT_MS)
        faults = _faults(page, "key", looks)
        dialog.get_by_label("API key").fill("wrong")
        dialog.get_by_role("button", name="Continue").click()
        expect(dialog.get_by_text("does not know this key")).to_be_visible(timeout=TIMEOUT_MS)
        assert faults + _faults(page, "key-wrong", looks) == []


def _faults(page: Page, name: str, looks: Looks) -> list[str]:
    """Return what axe finds on a page in each look, and whether something sticks out; keep pictures of it."""
    assert AXE.is_file(), f"run `npm ci --prefix {AXE.parents[2]}`"
    if not page.evaluate("'axe' in globalThis"):
        page.evaluate(AXE.read_text("utf-8"))
    faults = []
    for look in looks:
        look.put_on(page)
        faults += _faults_in(page, name, look)
    looks[0].put_on(page)
    return faults


def _faults_in(page: Page, name: str, look: Look) -> list[str]:
    page.screenshot(path=PICTURES / f"state-{name}-{look.width}-{look.scheme}.png", full_page=True)
    report = page.evaluate("(runOnly) => axe.run({ runOnly })", RULES if look.full else RULES_OF_COLOR)
    faults = [
        f"{name}: {each['id']}: {node['target']} {node['failureSummary']}"
        for each in report["violations"]
        for node in each["nodes"]
    ]
    if page.evaluate("document.documentElement.scrollWidth") > look.width:
        faults.append(f"{name}: sticks out")
    return faults
