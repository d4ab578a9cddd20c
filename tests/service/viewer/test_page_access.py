"""The page in Chromium: errors, keys, keyboards and phones."""

from pathlib import Path

import numpy as np
from playwright.sync_api import Browser, Page, ViewportSize, expect

from service.api.keys import make_key
from service.settings import Settings
from tests.support.browsing import PICTURES, TIMEOUT_MS, TRIANGLES, curl_line, opened, photo, pixels
from tests.support.server import running


def test_error_of_the_service_is_shown_until_closed(page: Page, tmp_path: Path) -> None:
    (tmp_path / "no.png").write_text("no image")
    page.set_input_files("#file", tmp_path / "no.png")
    problem = page.get_by_role("alert")
    expect(problem).to_contain_text("Unsupported media type")
    expect(problem).to_contain_text("PNG")
    expect(page.locator("#empty")).to_be_visible()
    page.screenshot(path=PICTURES / "error.png")
    problem.get_by_role("button").click()
    expect(problem).to_be_hidden()
    page.locator("#gallery .open").first.click()
    expect(page.locator("#empty")).to_be_hidden()
    page.locator("#n").press("End")
    page.locator("#format").select_option("json")
    page.get_by_role("button", name="Download").click()
    expect(problem).to_contain_text("Invalid parameter")


def test_scan_without_a_model_for_it_is_refused_before_it_is_sent(page: Page, tmp_path: Path) -> None:
    (tmp_path / "part.ply").write_bytes(b"ply")
    sent: list[str] = []
    page.on("request", lambda request: sent.append(request.url) if "/encode" in request.url else None)
    assert (page.locator("#file").get_attribute("accept") or "").endswith("image/avif")
    expect(page.locator("#scans")).to_be_hidden()
    page.set_input_files("#file", tmp_path / "part.ply")
    expect(page.locator("#problem")).to_contain_text("Photos only")
    expect(page.locator("#problem")).to_contain_text("Scans and meshes cannot be completed here.")
    expect(page.locator("#framing")).to_be_hidden()
    expect(page.locator("#count")).to_have_text("10,000 points")  # the object stays
    assert sent == []


def test_key_dialog_opens_once_and_the_key_is_used(browser: Browser, model_path: Path, tmp_path: Path) -> None:
    token, key = make_key("visitor", frozenset({"read", "write"}))
    (tmp_path / "keys").write_text(key.line)
    settings = Settings(
        model=(model_path,), database_url=f"sqlite:///{tmp_path / 'hof.db'}", api_keys_file=tmp_path / "keys", threads=1
    )
    with running(settings) as server, browser.new_context(reduced_motion="reduce") as context:
        page = context.new_page()
        page.set_default_timeout(TIMEOUT_MS)
        page.goto(f"http://127.0.0.1:{server.port}/")
        dialog = page.get_by_role("dialog", name="API key")
        wrong = dialog.get_by_text("does not know this key")
        for entry in ("wrong", token):  # an unknown key opens the dialog again
            expect(wrong).to_be_visible() if entry == token else expect(wrong).to_be_hidden()
            dialog.get_by_label("API key").fill(entry)
            dialog.get_by_role("button", name="Continue").click()
        expect(dialog).to_be_hidden(timeout=TIMEOUT_MS)
        page.set_input_files("#file", photo("chair"))
        expect(page.locator("#count")).to_have_text(TRIANGLES, timeout=TIMEOUT_MS)
        expect(dialog).to_be_hidden()
        assert "$HOF_KEY" in curl_line(page, "download")
        assert token not in page.content()
        with context.new_page() as other:  # another tab opens it again
            other.goto(f"http://127.0.0.1:{server.port}/")
            expect(other.get_by_role("dialog", name="API key")).to_be_visible(timeout=TIMEOUT_MS)
            other.get_by_role("button", name="Cancel").click()
            expect(other.get_by_role("alert")).to_contain_text("Unauthenticated")


def test_tab_key_reaches_every_action(page: Page) -> None:
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
        "armchair.webp",
        "chair.webp",
        "coffee.webp",
        "CANVAS",
        "n",
        "seed",
        "surface",
        "format",
        "open",
        "mix",
    } <= reached
    assert "BUTTON" in reached  # Copy, Download


def test_page_on_a_dark_phone_fits_its_width(browser: Browser, address: str) -> None:
    with browser.new_context(
        viewport={"width": 360, "height": 740}, color_scheme="dark", device_scale_factor=2, has_touch=True
    ) as context:
        page = opened(context.new_page(), address)
        assert page.evaluate("document.documentElement.scrollWidth") == 360
        assert np.median(pixels(page)) < 80  # the stage, whatever the color of the object
        page.screenshot(path=PICTURES / "phone.png", full_page=True)


def test_photo_on_a_phone_has_its_object_and_its_cut_out_on_the_first_screen(browser: Browser, address: str) -> None:
    size: ViewportSize = {"width": 390, "height": 664}  # beside the bars of a browser
    with browser.new_context(viewport=size, has_touch=True, is_mobile=True, reduced_motion="reduce") as context:
        page = context.new_page()
        page.set_default_timeout(TIMEOUT_MS)
        page.goto(f"{address}/")
        page.get_by_role("button", name="Lamp").click()
        expect(page.locator("#count")).to_have_text(TRIANGLES, timeout=TIMEOUT_MS)
        for shown in ("#stage", "#framing .picture", "#framing figcaption img", "#crop", "#background"):
            expect(page.locator(shown)).to_be_in_viewport(ratio=1)
        page.screenshot(path=PICTURES / "phone-photo.png")


def test_documentation_loads_nothing_from_elsewhere(browser: Browser, address: str) -> None:
    with browser.new_context(reduced_motion="reduce") as context:
        page = context.new_page()
        urls: list[str] = []
        page.on("request", lambda request: urls.append(request.url))
        page.goto(f"{address}/docs")
        expect(page.get_by_role("heading", name="HOF").first).to_be_visible(timeout=TIMEOUT_MS)
        assert [url for url in urls if not url.startswith((address, "data:"))] == []
