"""The page in Chromium: errors, keys, keyboards and phones."""

from pathlib import Path

from playwright.sync_api import Browser, Page, expect

from service.api.keys import make_key
from service.settings import Settings
from tests.support.browsing import PICTURES, TIMEOUT_MS, curl_line, opened, photo, pixels
from tests.support.server import running


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
        page.set_input_files("#file", photo("chair"))
        expect(page.locator("#count")).to_have_text("10,000 points", timeout=TIMEOUT_MS)
        expect(dialog).to_be_hidden()
        assert "$HOF_KEY" in curl_line(page, "download")
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
        page = opened(context.new_page(), address)
        assert page.evaluate("document.documentElement.scrollWidth") == 360
        assert pixels(page).mean() < 80
        page.screenshot(path=PICTURES / "phone.png", full_page=True)


def test_the_documentation_needs_no_one_else(browser: Browser, address: str) -> None:
    with browser.new_context() as context:
        page = context.new_page()
        asked: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        page.goto(f"{address}/docs")
        expect(page.get_by_role("heading", name="HOF").first).to_be_visible(timeout=TIMEOUT_MS)
        assert [url for url in asked if not url.startswith((address, "data:"))] == []
