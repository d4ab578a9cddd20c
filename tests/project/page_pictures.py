"""Take the pictures of the page that the documents show: `python -m tests.project.page_pictures`."""

import io
import tempfile
from pathlib import Path
from typing import Any, Final, Literal

import httpx
from PIL import Image
from playwright.sync_api import Browser, ViewportSize, expect, sync_playwright

from service.api.routes.viewer import STATIC
from service.settings import SHIPPED_MODEL, Settings
from tests.support.browsing import DRAWN, TIMEOUT_MS, TRIANGLES, launched
from tests.support.server import running

VIEWER: Final = STATIC.parent
EXAMPLES: Final = ("Lamp", "Barrel", "Bed", "Armchair", "Chair")  # the newest one last
MAX_BYTES: Final = 300_000
QUALITY: Final = 88
PHONE: Final = 500  # pixels; less is a phone's screen


def take(folder: Path) -> None:
    """Write page.webp, the page on a desktop, and phone.webp, the page on a dark phone."""
    with tempfile.TemporaryDirectory() as store:
        settings = Settings(
            model=(SHIPPED_MODEL,), database_url=f"sqlite:///{store}/hof.db", matting_model=None, embed_origins="*"
        )
        with running(settings) as server, sync_playwright() as playwright:
            address = f"http://127.0.0.1:{server.port}"
            for name in EXAMPLES:
                files = {"image": (STATIC / "photos" / f"{name.lower()}.webp").read_bytes()}
                query = {"keep_photo": True}
                httpx.post(
                    f"{address}/encode", params=query, data={"label": name}, files=files, timeout=60
                ).raise_for_status()
            browser = launched(playwright)
            _shoot(browser, address, "Chair", "light", {"width": 1180, "height": 1340}, folder / "page.webp")
            _shoot(browser, address, "Armchair", "dark", {"width": 390, "height": 844}, folder / "phone.webp")
            browser.close()


def _shoot(
    browser: Browser, address: str, example: str, scheme: Literal["light", "dark"], size: ViewportSize, path: Path
) -> None:
    """Choose an example, and take a picture once the object and the cards in view are drawn."""
    looks: dict[str, Any] = {"color_scheme": scheme, "device_scale_factor": 1.5, "reduced_motion": "reduce"}
    is_phone = size["width"] < PHONE
    with browser.new_context(viewport=size, is_mobile=is_phone, has_touch=is_phone, **looks) as context:
        page = context.new_page()
        page.set_default_timeout(TIMEOUT_MS)
        page.goto(address)
        page.get_by_role("button", name=example, exact=True).first.click()
        expect(page.locator("#framing figcaption")).to_contain_text("Background", timeout=TIMEOUT_MS)
        expect(page.locator("#count")).to_have_text(TRIANGLES, timeout=TIMEOUT_MS)
        expect(page.locator("#gallery li")).to_have_count(len(EXAMPLES))
        page.locator("#gallery").scroll_into_view_if_needed()
        expect(page.locator('#gallery li .photo[src^="blob:"]')).to_have_count(len(EXAMPLES), timeout=TIMEOUT_MS)
        page.evaluate("scrollTo(0, 0)")
        page.evaluate(DRAWN)
        image = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    image.save(path, quality=QUALITY, method=6)
    if path.stat().st_size > MAX_BYTES:
        raise SystemExit(f"{path} has {path.stat().st_size} bytes, the limit is {MAX_BYTES}")


if __name__ == "__main__":
    take(VIEWER)
