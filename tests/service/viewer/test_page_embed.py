"""The page in Chromium: an object in a frame of another site, and the line that puts it there."""

import re
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler
from pathlib import Path
from typing import Final

import httpx
import pytest
from playwright.sync_api import Browser, Page, expect

from service.settings import SHIPPED_MODEL, Settings
from tests.support.browsing import PICTURES, TIMEOUT_MS, TRIANGLES, photo
from tests.support.server import answering, running

NAME: Final = 'The "best" <chair>'


@pytest.fixture(scope="module")
def sites(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, str, Path]]:
    """Serve one folder at two origins, a shop's and another one; return these and the folder."""
    folder = tmp_path_factory.mktemp("site")
    handler = partial(SimpleHTTPRequestHandler, directory=folder)
    with answering(handler) as shop, answering(handler) as other:
        yield shop, other, folder


@pytest.fixture(scope="module")
def embeddable(sites: tuple[str, str, Path], tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Run a service whose objects the shop may show, with a chair."""
    store = f"sqlite:///{tmp_path_factory.mktemp('store') / 'hof.db'}"
    origins = f"{sites[0]},https://shop.example"
    settings = Settings(
        model=(SHIPPED_MODEL,), database_url=store, matting_model=None, threads=1, embed_origins=origins
    )
    with running(settings) as server:
        address = f"http://127.0.0.1:{server.port}"
        form = {"label": NAME}
        files = {"image": photo("chair").read_bytes()}
        assert httpx.post(f"{address}/encode", data=form, files=files, timeout=60).status_code == 201
        yield address


def test_embed_line_of_the_page_shows_the_object_in_the_site_that_is_allowed(
    browser: Browser, embeddable: str, sites: tuple[str, str, Path]
) -> None:
    shop, other, folder = sites
    with browser.new_context(reduced_motion="reduce") as context:
        page = context.new_page()
        page.goto(f"{embeddable}/")
        expect(page.locator("#count")).to_have_text(TRIANGLES, timeout=TIMEOUT_MS)
        page.get_by_role("button", name="Embed").click()
        line = page.locator('.curl[data-of="embed"] code').text_content() or ""
        page.locator(".below").screenshot(path=PICTURES / "embed-line.png")
        (folder / "index.html").write_text(f"<!doctype html><h1>A shop</h1>{line}")
        page.goto(shop)
        frame = page.frame_locator("iframe")
        credit = frame.get_by_role("link")
        expect(credit).to_have_text(f"{NAME} · HOF", timeout=TIMEOUT_MS)
        expect(frame.locator("#empty")).to_be_hidden(timeout=TIMEOUT_MS)
        assert re.fullmatch(r"\.#/objects/[0-9a-f]{32}", credit.get_attribute("href") or "")
        assert frame.get_by_role("button").count() == 0
        page.screenshot(path=PICTURES / "embedded.png")
        assert page.locator("iframe").get_attribute("title") == NAME
        for service, site in ((embeddable, other), (embeddable, shop.replace("127.0.0.1", "localhost"))):
            (folder / "index.html").write_text(f'<iframe src="{service}/embed"></iframe>')
            with page.expect_console_message(lambda message: "frame-ancestors" in message.text, timeout=TIMEOUT_MS):
                page.goto(site)


def test_embed_is_allowed_for_the_origins_of_the_setting_alone(
    embeddable: str, sites: tuple[str, str, Path], client: httpx.Client
) -> None:
    policies = {
        path: httpx.get(f"{embeddable}{path}").headers["content-security-policy"].split("frame-ancestors ")[1]
        for path in ("/", "/docs", "/embed", "/viewer/embed.html", "/objects")
    }
    assert policies.pop("/embed") == f"{sites[0]} https://shop.example"
    assert set(policies.values()) == {"'none'"}
    assert "frame-ancestors 'none'" in client.get("/embed").headers["content-security-policy"]


def test_embed_button_where_no_site_may_show_objects_is_hidden(page: Page) -> None:
    expect(page.locator("#download")).to_be_visible()
    expect(page.locator("#embed")).to_be_hidden()


def test_embed_button_with_a_key_is_hidden_since_frames_have_none(browser: Browser, embeddable: str) -> None:
    with browser.new_context(reduced_motion="reduce") as context:
        page = context.new_page()
        page.add_init_script('sessionStorage.setItem("hof-key", "secret")')
        with page.expect_response("**/embed"):
            page.goto(f"{embeddable}/")
        expect(page.locator("#download")).to_be_visible(timeout=TIMEOUT_MS)
        expect(page.locator("#embed")).to_be_hidden()


def test_embed_of_an_unknown_object_says_so(browser: Browser, address: str) -> None:
    with browser.new_context(reduced_motion="reduce") as context:
        page = context.new_page()
        page.goto(f"{address}/embed#/objects/{'0' * 32}")
        expect(page.locator("#empty")).to_contain_text("Not found", timeout=TIMEOUT_MS)
