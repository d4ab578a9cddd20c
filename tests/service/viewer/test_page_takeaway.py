"""The page in Chromium: augmented reality, as a phone would be asked for it, and the download menu."""

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import httpx
import pytest
from playwright.sync_api import Browser, Page, Route, ViewportSize, expect

from tests.support.browsing import PICTURES, QUICK_LOOK, TIMEOUT_MS, TRIANGLES, curl_line, run
from tests.support.usd import check_valid

ANDROID = (
    "Mozilla/5.0 (Linux; Android 10; K) AppleWebKit/537.36 (KHTML, like Gecko) Chrome/130.0.0.0 Mobile Safari/537.36"
)
HTTPS = "https://hof.test"
PHONE: ViewportSize = {"width": 360, "height": 740}
NOTE_LINKS = """
    addEventListener("click", (event) => {
        const link = event.target.closest("a");
        if (!link || event.isTrusted) return;
        event.preventDefault();
        const children = [...link.children].map((child) => child.tagName);
        document.documentElement.dataset.followed = JSON.stringify({ href: link.href, rel: link.rel, children });
    });
"""
OUTSIDE = """(below) => {
    const { left, right } = below.getBoundingClientRect();
    const isOutside = (box) => box.width && (box.left < left - 0.5 || box.right > right + 0.5);
    return [...below.querySelectorAll("button, select, input, label")]
        .filter((each) => !each.closest(".unseen") && isOutside(each.getBoundingClientRect()))
        .map((each) => each.id || each.textContent);
}"""


@contextmanager
def phone(
    browser: Browser, address: str, origin: str, script: str = "", *, user_agent: str | None = None
) -> Iterator[Page]:
    """Open the page of a service under an origin, on a phone."""

    def answer(route: Route) -> None:
        route.fulfill(response=route.fetch(url=route.request.url.replace(origin, address)))

    with browser.new_context(viewport=PHONE, has_touch=True, reduced_motion="reduce", user_agent=user_agent) as context:
        page = context.new_page()
        page.add_init_script(NOTE_LINKS + script)
        if origin != address:
            page.route(f"{origin}/**", answer)
        page.goto(f"{origin}/")
        expect(page.locator("#count")).to_have_text(TRIANGLES, timeout=TIMEOUT_MS)
        yield page
        page.unroute_all(behavior="ignoreErrors")


def followed(page: Page) -> dict[str, Any]:
    """Return the link that the page follows when its button is pressed."""
    page.get_by_role("button", name="See it in your room").click()
    expect(page.locator("html[data-followed]")).to_be_attached(timeout=TIMEOUT_MS)
    link: dict[str, Any] = json.loads(page.locator("html").get_attribute("data-followed") or "")
    return link


def test_ar_on_android_opens_scene_viewer_with_the_surface(browser: Browser, address: str) -> None:
    with phone(browser, address, HTTPS, user_agent=ANDROID) as page:
        page.screenshot(path=PICTURES / "phone-ar.png", full_page=True)
        href = followed(page)["href"]
        shown = page.url
    assert href.startswith("intent://arvr.google.com/scene-viewer/1.2?")
    fields = dict(field.split("=", 1) for field in urlsplit(href).fragment.split(";")[1:-2])
    assert fields["scheme"] == "https"
    assert parse_qs("url=" + fields["S.browser_fallback_url"])["url"] == [shown]
    (file,) = parse_qs(urlsplit(href).query)["file"]
    answer = httpx.get(file.replace(HTTPS, address))
    assert (answer.status_code, answer.content[:4]) == (200, b"glTF")


def test_ar_on_an_iphone_opens_quick_look_with_usdz(browser: Browser, address: str) -> None:
    usdz = re.compile("format=usdz")
    with phone(browser, address, address, QUICK_LOOK) as page, page.expect_response(usdz) as answer:
        link = followed(page)
    assert (link["rel"], link["children"]) == ("ar", ["IMG"])
    assert link["href"].startswith("blob:")
    assert "def Mesh" in check_valid(httpx.get(answer.value.url).content)


@pytest.mark.parametrize(("origin", "user_agent"), [("", ANDROID), (HTTPS, ANDROID + " Firefox"), (HTTPS, None)])
def test_ar_without_an_app_that_can_show_it_is_hidden(
    browser: Browser, address: str, origin: str, user_agent: str | None
) -> None:
    with phone(browser, address, origin or address, user_agent=user_agent) as page:
        expect(page.locator("#download")).to_be_visible()
        expect(page.locator("#ar")).to_be_hidden()


def test_ar_with_a_key_is_offered_by_quick_look_alone(browser: Browser, address: str) -> None:
    key = 'sessionStorage.setItem("hof-key", "secret");'
    with phone(browser, address, HTTPS, key, user_agent=ANDROID) as page:
        expect(page.locator("#ar")).to_be_hidden()
    with phone(browser, address, HTTPS, key + QUICK_LOOK) as page:
        assert re.match("blob:", followed(page)["href"])


def test_controls_of_an_object_stay_within_their_row(browser: Browser, address: str) -> None:
    with browser.new_context(reduced_motion="reduce") as context:
        page = context.new_page()
        page.goto(f"{address}/")
        expect(page.locator("#count")).to_have_text(TRIANGLES, timeout=TIMEOUT_MS)
        for width in (320, 360, 1280):
            page.set_viewport_size({"width": width, "height": 800})
            page.emulate_media(color_scheme="dark" if width == 360 else "light")
            page.locator(".below").screenshot(path=PICTURES / f"controls-{width}.png")
            outside = page.locator(".below").evaluate(OUTSIDE)
            assert outside == [], width


def test_download_equals_the_file_of_the_curl_line(page: Page, tmp_path: Path) -> None:
    chair = page.locator("#gallery li:has(.mix)").last  # is drawn in half the time
    chair.locator(".open").click()
    expect(page.locator('.curl[data-of="download"] code')).to_contain_text(chair.get_attribute("data-id") or "?")
    options = page.locator("#format option")
    for index in range(options.count()):
        page.locator("#format").select_option(index=index)
        with page.expect_download() as saved:
            page.get_by_role("button", name="Download").click()
        assert re.fullmatch(r"hof-[0-9a-f]{32}\.\w+", saved.value.suggested_filename)
        folder = tmp_path / str(index)
        folder.mkdir()
        run(curl_line(page, "download"), folder)
        (fetched,) = folder.iterdir()
        assert fetched.read_bytes() == Path(saved.value.path()).read_bytes(), fetched.name
