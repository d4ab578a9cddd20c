"""The page in Chromium: races, a busy service, links, undo, and languages."""

import json
import re
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Browser, Page, Route, expect

from service.api.routes import viewer
from tests.support.browsing import FRAMES, PICTURES, TRIANGLES, first, hold, photo, release, wait_long

LANGUAGES = json.loads(
    (viewer.STATIC / "js" / "languages.js").read_text("utf-8").partition("LANGUAGES = ")[2].rstrip().rstrip(";")
)


def test_photo_that_is_chosen_last_wins(page: Page) -> None:
    held = hold(page, "**/encode?*", count=1)
    page.get_by_role("button", name="Bed").click()
    expect(page.locator("#working")).to_be_visible()
    page.get_by_role("button", name="Barrel").click()
    expect(page.locator("#framing figcaption")).to_contain_text("transparency")
    expect(page).to_have_url(re.compile(r"/#/objects/[0-9a-f]{32}$"))
    shown = page.url
    held[0].continue_()
    page.wait_for_timeout(1000)
    assert page.url == shown


@pytest.mark.parametrize("is_made", [False, True])
def test_photo_that_is_chosen_before_the_gallery_arrives_is_not_covered(
    browser: Browser, address: str, is_made: bool
) -> None:
    newest = httpx.post(f"{address}/encode", content=photo("chair").read_bytes(), timeout=60).json()
    with browser.new_context(reduced_motion="reduce") as context:
        page = context.new_page()
        wait_long(page)
        lists, encodings = hold(page, "**/objects?*"), hold(page, "**/encode?*")
        page.goto(f"{address}/")
        listing = first(page, lists)
        page.get_by_role("button", name="Barrel").click()
        encoding = first(page, encodings)
        if is_made:
            encoding.continue_()
            expect(page.locator("#count")).to_have_text(TRIANGLES)
        summary = page.locator("#summary").text_content()
        with page.expect_event("requestfinished", lambda request: "/objects?" in request.url):
            listing.fulfill(json={"items": [newest], "next": None})
        page.evaluate(FRAMES)
        assert page.locator("#summary").text_content() == summary
        assert page.locator("#working").is_visible() == (not is_made)
        release(page, "**/objects?*", lists[1:])
        if not is_made:
            encoding.continue_()
        expect(page.locator("#count")).to_have_text(TRIANGLES)
        expect(page.locator("#gallery li.shown")).to_have_count(1)


@pytest.mark.parametrize("status", [429, 503])
def test_photo_while_the_service_is_busy_waits_and_tells(page: Page, status: int) -> None:
    busy = iter([{"Retry-After": "1"}])

    def refuse_once(route: Route) -> None:
        if headers := next(busy, None):
            route.fulfill(status=status, headers=headers, content_type="application/problem+json", body="{}")
        else:
            route.continue_()

    page.route("**/encode?*", refuse_once)
    page.get_by_role("button", name="Lamp").click()
    expect(page.locator("#notice")).to_contain_text("Trying again in 1 s")
    page.screenshot(path=PICTURES / "busy.png")
    expect(page.locator("#framing figcaption")).to_contain_text("transparency")
    expect(page.locator("#notice")).to_be_hidden()
    expect(page.get_by_role("alert")).to_be_hidden()


def test_photo_while_the_service_stays_busy_is_told_as_an_error(page: Page) -> None:
    problem = {"title": "Overloaded", "detail": "too many photos are waiting"}

    def refuse(route: Route) -> None:
        headers = {"Retry-After": "1"}
        route.fulfill(status=503, headers=headers, content_type="application/problem+json", body=json.dumps(problem))

    page.route("**/encode?*", refuse)
    page.get_by_role("button", name="Lamp").click()
    expect(page.locator("#problem")).to_contain_text("too many photos are waiting")
    expect(page.locator("#framing figcaption")).to_contain_text("did not become an object")
    expect(page.locator("#working")).to_be_hidden()
    page.screenshot(path=PICTURES / "overloaded.png")


def test_another_photo_while_the_service_is_busy_ends_the_wait(page: Page) -> None:
    refused: list[str] = []

    def refuse_first(route: Route) -> None:
        if refused:
            route.continue_()
        else:
            refused.append(route.request.url)
            route.fulfill(status=429, headers={"Retry-After": "60"}, content_type="application/problem+json", body="{}")

    page.route("**/encode?*", refuse_first)
    page.get_by_role("button", name="Lamp").click()
    expect(page.locator("#notice")).to_contain_text("Trying again in 60 s")
    page.get_by_role("button", name="Barrel").click()
    expect(page.locator("#framing figcaption")).to_contain_text("transparency")
    expect(page.locator("#notice")).to_be_hidden()


def test_page_without_scripts_has_a_form_that_encodes(browser: Browser, address: str) -> None:
    with browser.new_context(java_script_enabled=False) as context:
        page = context.new_page()
        page.goto(f"{address}/")
        expect(page.locator("#drop")).to_be_hidden()  # it would do nothing
        page.screenshot(path=PICTURES / "no-script.png")
        page.get_by_label("Photo of one object").set_input_files(photo("chair"))
        page.get_by_label("Name", exact=True).first.fill("From a form")
        with page.expect_navigation() as answer:
            page.get_by_role("button", name="Make it 3D").click()
        assert answer.value.status in (200, 201)
        assert answer.value.json()["label"] == "From a form"


def test_connection_that_is_lost_is_told(page: Page) -> None:
    page.context.set_offline(True)
    expect(page.locator("#notice")).to_contain_text("offline")
    page.set_input_files("#file", photo("chair"))
    expect(page.locator("#problem")).to_contain_text("cannot be reached")
    page.context.set_offline(False)
    expect(page.locator("#notice")).to_be_hidden()


def test_address_of_an_object_opens_it_after_a_reload(page: Page, address: str) -> None:
    page.locator("#gallery .open").last.click()
    expect(page).to_have_url(re.compile(r"/#/objects/[0-9a-f]{32}$"))
    name = page.locator("#gallery li.shown .open").inner_text()
    page.reload()
    expect(page.locator("#count")).to_have_text(TRIANGLES)
    assert page.locator("#gallery li.shown .open").inner_text() == name


def test_deletion_can_be_undone_and_is_sent_later(page: Page, address: str) -> None:
    count = page.locator("#gallery li").count()
    page.get_by_role("button", name="Delete Photo").first.click()
    expect(page.locator("#gallery li")).to_have_count(count - 1)
    page.get_by_role("button", name="Undo").click()
    expect(page.locator("#gallery li")).to_have_count(count)
    stored = httpx.post(f"{address}/encode?background=keep", content=photo("chair").read_bytes()).json()
    page.reload()
    with page.expect_response(lambda response: response.request.method == "DELETE") as answer:
        page.locator(f'#gallery li[data-id="{stored["id"]}"] .delete').click()
    assert answer.value.status == 204


def test_page_in_each_language_translates_every_text(browser: Browser, address: str) -> None:
    index = (viewer.STATIC / "index.html").read_text("utf-8")
    scripts = "".join(Path(path).read_text("utf-8") for path in viewer.STATIC.glob("js/**/*.js"))
    used = set(re.findall(r'data-(?:text|label|alt|placeholder)="(\w+)"', index))
    used |= set(re.findall(r'\btext\("(\w+)"', scripts))
    for code, texts in LANGUAGES.items():
        assert texts.keys() == LANGUAGES["en"].keys(), code
        assert used <= texts.keys(), code
    with browser.new_context(locale="de-DE", reduced_motion="reduce") as context:
        page = context.new_page()
        page.goto(f"{address}/")
        expect(page.locator("#drop")).to_have_text("Foto auswählen")
        page.locator("#language").select_option("fr")
        expect(page.locator("#drop")).to_have_text("Choisir une photo")
