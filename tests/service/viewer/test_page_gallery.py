"""The page in Chromium with 1,200 objects in its gallery: requests, elements, keys and names."""

import asyncio
import re
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest
from playwright.sync_api import Browser, Page, Route, ViewportSize, expect

from service.settings import SHIPPED_MODEL, Settings
from tests.support.browsing import FRAMES, PICTURES, TIMEOUT_MS
from tests.support.server import running
from tests.support.small.store import open_store, pair_of

OBJECTS = 1200
PAGES = 20  # of 60 objects
MOST_FILLED = 160  # cards that have more than a name
MOST_PICTURES = 250  # that are fetched on a fast way down
FRAME_S = 0.15  # of script, style and layout for each frame, on a busy machine
NODES = 12_000  # of the whole page
MOST_TRIES = 6  # of a call: TRIES of js/api.js
REFUSED_S = 2.5  # to wait after a refused call; the service itself asks for whole seconds

NOTE_NOTICES = """
    globalThis.notices = [];
    new MutationObserver((changes) => {
        const shown = changes.map(({ target }) => target).filter((target) => target.id === "notice" && !target.hidden);
        notices.push(...shown.map((target) => target.textContent));
    }).observe(document, { subtree: true, attributes: true, attributeFilter: ["hidden"] });
"""

NOTE_PROBLEMS = NOTE_NOTICES.replace("notices", "problems").replace('"notice"', '"problem"')
COUNT_BLOBS = """
    globalThis.blobs = new Set();
    const [create, revoke] = [URL.createObjectURL, URL.revokeObjectURL];
    URL.createObjectURL = (blob) => {
        const address = create.call(URL, blob);
        blobs.add(address);
        return address;
    };
    URL.revokeObjectURL = (address) => {
        blobs.delete(address);
        revoke.call(URL, address);
    };
"""

TO_THE_END = """async (objects) => {
    const frames = [];
    const list = document.querySelector("#gallery ul");
    let last = performance.now();
    for (let rounds = 0; rounds < 2000; rounds++) {
        scrollBy(0, 600);
        await new Promise(requestAnimationFrame);
        frames.push(performance.now() - last);
        last = performance.now();
        const { scrollTop, clientHeight, scrollHeight } = document.documentElement;
        if (list.children.length === objects && scrollTop + clientHeight >= scrollHeight - 2) break;
    }
    return frames;
}"""


@pytest.fixture(scope="module")
def full_address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Run a service with 1,200 objects, named after their numbers."""
    url = f"sqlite:///{tmp_path_factory.mktemp('full') / 'hof.db'}"

    async def fill() -> None:
        pairs = [pair_of(number) for number in range(OBJECTS)]
        named = [
            (replace(record, label=f"Object {number}", has_photo=False), functions)
            for number, (record, functions) in enumerate(pairs)
        ]
        async with open_store(url) as store:
            await store.put_all(named)

    with ThreadPoolExecutor(1) as thread:  # Playwright has the loop of this one
        thread.submit(lambda: asyncio.run(fill())).result()
    with running(Settings(model=(SHIPPED_MODEL,), database_url=url, matting_model=None, threads=1)) as server:
        yield f"http://127.0.0.1:{server.port}"


@pytest.fixture
def full_page(browser: Browser, full_address: str) -> Iterator[Page]:
    """Open the page of a full gallery."""
    with browser.new_context(viewport={"width": 1280, "height": 900}, reduced_motion="reduce") as context:
        page = context.new_page()
        page.set_default_timeout(TIMEOUT_MS)
        page.goto(f"{full_address}/")
        expect(page.locator("#gallery li").first).to_be_attached(timeout=TIMEOUT_MS)
        yield page


def test_gallery_of_many_is_fetched_while_one_scrolls_and_stays_small(full_page: Page) -> None:
    page = full_page
    addresses: list[str] = []
    page.on("request", lambda request: addresses.append(request.url))
    tools = page.context.new_cdp_session(page)
    tools.send("Performance.enable")

    def measure() -> dict[str, float]:
        return {each["name"]: each["value"] for each in tools.send("Performance.getMetrics")["metrics"]}

    items = page.locator("#gallery li")
    assert items.count() < OBJECTS / 4  # nobody has scrolled
    before = measure()
    frames = page.evaluate(TO_THE_END, OBJECTS)
    after = measure()
    spent = sum(after[name] - before[name] for name in ("ScriptDuration", "LayoutDuration", "RecalcStyleDuration"))
    assert spent < FRAME_S * len(frames)
    assert after["Nodes"] < NODES
    expect(items).to_have_count(OBJECTS)
    assert sum("/objects?" in url for url in addresses) < PAGES
    items.last.scroll_into_view_if_needed()  # the object that is drawn meanwhile may move the gallery
    expect(page.get_by_role("button", name="Object 0", exact=True)).to_be_in_viewport()
    expect(items.last.locator("img").first).to_have_attribute("src", re.compile("^blob:"))
    assert sum("/picture?" in url for url in addresses) < MOST_PICTURES
    assert page.locator("#gallery .open").count() < MOST_FILLED
    assert page.locator("#gallery *").count() < OBJECTS + 9 * MOST_FILLED
    expect(page.get_by_role("button", name="Show more")).to_be_hidden()
    page.screenshot(path=PICTURES / "gallery-full.png")


def test_gallery_of_many_by_keyboard_reaches_the_next_cards_and_pages(full_page: Page) -> None:
    page = full_page
    page.locator("#gallery .open").first.focus()
    names = []
    for _ in range(240):  # 80 cards of three buttons, more than a page has
        name = page.evaluate("document.activeElement.ariaLabel ?? document.activeElement.textContent")
        if not name.startswith(("Mix", "Delete")):
            names.append(name)
        page.keyboard.press("Tab")
    assert names == [f"Object {OBJECTS - 1 - number}" for number in range(80)]
    page.keyboard.press("Shift+Tab")
    assert page.evaluate("document.activeElement.ariaLabel") == f"Delete Object {OBJECTS - 80}"


def test_gallery_card_out_of_view_has_its_name_for_screen_readers(full_page: Page) -> None:
    page = full_page
    page.evaluate("async () => scrollTo(0, document.documentElement.scrollHeight)")
    expect(page.locator("#gallery li")).not_to_have_count(60)
    page.evaluate(TO_THE_END, OBJECTS)
    first = page.get_by_role("listitem").filter(has_text=f"Object {OBJECTS - 1}")
    expect(first).to_have_text(f"Object {OBJECTS - 1}")
    expect(first.get_by_role("button")).to_have_count(0)
    first.scroll_into_view_if_needed()
    expect(first.get_by_role("button")).to_have_count(3)
    first.get_by_role("button", name=f"Delete Object {OBJECTS - 1}").click()
    expect(page.locator("#gallery li").first.locator(".open")).to_be_focused()
    page.get_by_role("button", name="Undo").click()
    expect(first).to_be_visible()


def test_gallery_pictures_wait_for_the_object_on_the_stage_and_are_tried_again_in_silence(
    browser: Browser, full_address: str
) -> None:
    paths: list[str] = []
    refused: list[str] = []

    def refuse_once(route: Route) -> None:
        if refused:
            route.continue_()
        else:
            refused.append(route.request.url)
            route.fulfill(status=429, headers={"Retry-After": str(REFUSED_S)}, body="{}")

    size: ViewportSize = {"width": 1280, "height": 1600}
    with browser.new_context(viewport=size, reduced_motion="reduce") as context:
        page = context.new_page()
        page.set_default_timeout(TIMEOUT_MS)
        page.add_init_script(NOTE_NOTICES)
        page.on("request", lambda request: paths.append(request.url))
        page.route("**/picture?size=240&*", refuse_once)
        with page.expect_response(lambda response: response.status == 429 and "size=240" in response.url):
            page.goto(f"{full_address}/")
        id_ = refused[0].split("/")[-2]
        expect(page.locator(f'#gallery li[data-id="{id_}"] img').first).to_have_attribute("src", re.compile("^blob:"))
        notices = page.evaluate("notices")
    assert [notice for notice in notices if f"in {REFUSED_S} s" in notice] == []
    first = next(index for index, path in enumerate(paths) if "size=240" in path)
    assert any("/mesh?" in path for path in paths[:first])


def test_card_that_the_service_is_too_busy_for_gets_its_pictures_later_without_an_error(
    browser: Browser, address: str
) -> None:
    refused: dict[str, int] = defaultdict(int)

    def refuse_often(route: Route) -> None:
        refused[route.request.url] += 1
        if refused[route.request.url] > MOST_TRIES:
            route.continue_()
        else:
            route.fulfill(status=503, headers={"Retry-After": "1"}, body="{}")

    with browser.new_context(reduced_motion="reduce") as context:
        page = context.new_page()
        page.set_default_timeout(TIMEOUT_MS)
        page.add_init_script(NOTE_PROBLEMS)
        page.route("**/picture?size=240&*", refuse_often)
        page.goto(f"{address}/")
        page.locator("#gallery").scroll_into_view_if_needed()
        expect(page.locator("#gallery li img").first).to_have_attribute("src", re.compile("^blob:"), timeout=TIMEOUT_MS)
        assert max(refused.values()) > MOST_TRIES
        assert page.evaluate("problems") == []


def test_pictures_of_a_card_whose_photo_is_missing_leave_no_blob(browser: Browser, address: str) -> None:
    with browser.new_context(reduced_motion="reduce") as context:
        page = context.new_page()
        page.set_default_timeout(TIMEOUT_MS)
        page.add_init_script(COUNT_BLOBS)
        page.route("**/objects/*/photo", lambda route: route.fulfill(status=404, body="{}"))
        page.route("**/objects?*", _with_photos)
        finished: list[str] = []
        page.on("requestfinished", lambda request: finished.append(request.url))
        page.goto(f"{address}/")
        page.locator("#gallery").scroll_into_view_if_needed()
        expect(page.locator("#problem")).to_be_visible(timeout=TIMEOUT_MS)
        while sum("size=240" in url for url in finished) < 2:  # the pictures of both cards
            page.wait_for_timeout(10)
        page.evaluate(FRAMES)
        assert page.evaluate("blobs.size") == page.locator('img[src^="blob:"]').count()


def _with_photos(route: Route) -> None:
    """Answer a list of objects as if each had a photo."""
    answer = route.fetch()
    body = answer.json()
    for item in body["items"]:
        item["links"]["photo"] = f"{item['links']['self']}/photo"
    route.fulfill(response=answer, json=body)
