"""The page in Chromium while the stage cannot draw: no WebGL, no three.js, a slow line, a busy service."""

import re
from collections.abc import Iterator
from typing import Literal

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.support.browsing import PICTURES, TRIANGLES, first, hold, inked, release, wait_long

THREE = "**/three/**"
PICTURE = "**/picture?size={320,512}&*"  # of the stage; the gallery's are smaller
NO_WEBGL = "HTMLCanvasElement.prototype.getContext = () => null"
COUNT_ADDRESSES = """
    globalThis.addresses = new Set();
    for (const [name, change] of [["createObjectURL", "add"], ["revokeObjectURL", "delete"]]) {
        const original = URL[name];
        URL[name] = (value) => {
            const result = original.call(URL, value);
            addresses[change](result ?? value);
            return result;
        };
    }
"""
NUMBERS = re.compile("numbers")
WIDTH = 512  # pixels of a picture

Scheme = Literal["light", "dark"]


@pytest.fixture
def blank(browser: Browser) -> Iterator[Page]:
    """Return a page without an address; no script may fail while a test uses it."""
    with browser.new_context(viewport={"width": 1280, "height": 1000}, reduced_motion="reduce") as context:
        page = context.new_page()
        wait_long(page)
        faults: list[str] = []
        page.on("pageerror", lambda error: faults.append(str(error)))
        yield page
        assert faults == []


def _expect_picture(page: Page) -> None:
    """Expect that a picture of one object is shown, and what one can do with the object."""
    expect(page.locator("#about")).to_have_text(NUMBERS)
    for offer in ("#download", "#robot", "#link"):
        expect(page.locator(offer)).to_be_visible()
    expect(page.locator("#stills img")).to_have_js_property("naturalWidth", WIDTH)
    expect(page.locator("#stills img")).to_be_visible()
    for sign in ("#empty", "#working"):
        expect(page.locator(sign)).to_be_hidden()


def _expect_made(page: Page) -> None:
    """Expect that the photo became an object, which the gallery has."""
    expect(page.locator("#framing figcaption")).to_contain_text("Background")
    expect(page).to_have_url(re.compile(r"/#/objects/[0-9a-f]{32}$"))
    expect(page.locator("#gallery li.shown")).to_have_count(1)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_page_without_webgl_shows_a_picture(blank: Page, address: str, scheme: Scheme) -> None:
    blank.emulate_media(color_scheme=scheme)
    blank.add_init_script(NO_WEBGL)
    blank.goto(f"{address}/")
    _expect_picture(blank)
    expect(blank.get_by_role("alert")).to_be_hidden()


def test_pictures_that_were_shown_are_given_up(blank: Page, address: str) -> None:
    blank.add_init_script(NO_WEBGL)
    blank.add_init_script(COUNT_ADDRESSES)
    blank.set_viewport_size({"width": 1280, "height": 300})  # the gallery's pictures are not in view
    blank.goto(f"{address}/")
    _expect_picture(blank)
    for opening in (*blank.locator("#gallery .open").all(), *blank.locator("#gallery .open").all()):
        shown = blank.locator("#stills img").get_attribute("src")
        opening.dispatch_event("click")
        expect(blank.locator("#stills img")).not_to_have_attribute("src", str(shown))
        _expect_picture(blank)
    assert blank.evaluate("addresses.size") == 1


def test_photo_without_webgl_and_pictures_is_offered_and_listed(blank: Page, address: str) -> None:
    blank.add_init_script(NO_WEBGL)
    failure = {"title": "No picture", "detail": "the picture failed"}
    blank.route(PICTURE, lambda route: route.fulfill(status=500, content_type="application/problem+json", json=failure))
    blank.goto(f"{address}/")
    blank.get_by_role("button", name="Barrel").click()
    _expect_made(blank)
    expect(blank.locator("#download")).to_be_visible()
    expect(blank.locator("#empty")).to_contain_text("no WebGL")
    expect(blank.locator("#problem")).to_contain_text("the picture failed")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_photo_without_three_js_is_shown_as_a_picture_and_listed(blank: Page, address: str, scheme: Scheme) -> None:
    blank.emulate_media(color_scheme=scheme)
    blank.route(THREE, lambda route: route.abort())
    blank.goto(f"{address}/")
    _expect_picture(blank)
    expect(blank.locator("#problem")).to_contain_text("Reload the page")
    blank.get_by_role("button", name={"light": "Lamp", "dark": "Cup of coffee"}[scheme]).click()
    _expect_made(blank)
    _expect_picture(blank)
    expect(blank.locator("#problem")).to_contain_text("Reload the page")
    with blank.expect_download():
        blank.get_by_role("button", name="Download").click()
    expect(blank.locator("#problem")).to_contain_text("Reload the page")  # 3D is still missing
    blank.screenshot(path=PICTURES / f"no-three-{scheme}.png")
    blank.unroute(THREE)
    blank.reload()
    expect(blank.locator("#count")).to_have_text(TRIANGLES)
    expect(blank.get_by_role("alert")).to_be_hidden()


@pytest.mark.parametrize(("scheme", "sign"), [("light", "#stills img"), ("dark", "#working")])
def test_photo_on_a_slow_line_is_not_a_blank_stage(blank: Page, address: str, scheme: Scheme, sign: str) -> None:
    blank.emulate_media(color_scheme=scheme)
    held = hold(blank, THREE)
    blank.goto(f"{address}/")
    blank.get_by_role("button", name="Bed").click()
    expect(blank).to_have_url(re.compile(r"/#/objects/[0-9a-f]{32}$"))
    expect(blank.locator("#about")).to_have_text(NUMBERS)
    expect(blank.locator(sign)).to_be_visible()
    release(blank, THREE, held)
    expect(blank.locator("#count")).to_have_text(TRIANGLES)
    for each in ("#stills", "#working"):
        expect(blank.locator(each)).to_be_hidden()


def test_picture_of_an_object_does_not_stay_over_another_one(blank: Page, address: str) -> None:
    hold(blank, THREE)
    blank.goto(f"{address}/")
    expect(blank.locator("#stills img")).to_be_visible()
    pictures = hold(blank, PICTURE)
    blank.locator("#gallery .open").last.click()
    expect(blank.locator("#stills")).to_be_hidden()
    release(blank, PICTURE, pictures)
    expect(blank.locator("#stills img")).to_be_visible()


def test_picture_that_the_service_is_too_busy_for_does_not_delay_the_surface(blank: Page, address: str) -> None:
    headers = {"Retry-After": "60"}
    blank.route(PICTURE, lambda route: route.fulfill(status=429, headers=headers, body="{}"))
    with blank.expect_response(PICTURE):
        blank.goto(f"{address}/")
    expect(blank.locator("#count")).to_have_text(TRIANGLES)
    expect(blank.locator("#notice")).to_be_hidden()  # nothing is tried again


def test_dot_size_that_is_set_before_the_stage_opens_is_kept(blank: Page, address: str) -> None:
    held = hold(blank, THREE)
    blank.goto(f"{address}/")
    blank.get_by_role("switch", name="Surface").uncheck()
    blank.locator("#n").fill("3")
    blank.locator("#dots").fill("1")
    expect(blank.locator("#about")).to_have_text(NUMBERS)
    release(blank, THREE, held)
    expect(blank.locator("#count")).to_have_text("1,000 points")
    large = inked(blank)
    blank.locator("#dots").fill("0")
    assert large > 1.5 * inked(blank)


def test_points_that_have_arrived_are_dense_while_more_are_on_their_way(page: Page) -> None:
    before = inked(page)
    held = hold(page, "**/points?*")
    page.locator("#n").press("End")
    first(page, held)
    assert inked(page) > 0.9 * before  # discs as large as those of 10,000 points
    release(page, "**/points?*", held)
    expect(page.locator("#count")).to_have_text("1,000,000 points")
