"""An emulated phone with augmented reality (iwer, phone.js): a visitor's room in Chromium."""

import base64
import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from PIL import Image
from playwright.sync_api import Browser, Locator, Page, Route, ViewportSize, expect

from tests.support.browsing import INK, PICTURES, TIMEOUT_MS, TRIANGLES, Picture

TOOLS = Path(__file__).parent
IWER = TOOLS / "node_modules" / "iwer" / "build" / "iwer.min.js"
PHONE: ViewportSize = {"width": 320, "height": 480}
DOWN = -35  # degrees: where the visitor looks, at a floor 2.1 m away
FLOOR = (0, 48, 0)  # of phone.js
NOTE_LINKS = """
    addEventListener("click", (event) => {
        const link = event.target.closest("a");
        if (!link || event.isTrusted) return;
        event.preventDefault();
        document.documentElement.dataset.followed = link.href;
    });
"""

Finger = tuple[str, float, float]  # hand, and where its ray goes: degrees upwards, degrees to the left


class Box(NamedTuple):
    """A box in the picture, pixels."""

    left: float
    top: float
    right: float
    bottom: float

    @property
    def center(self) -> float:
        """The middle, from left to right."""
        return (self.left + self.right) / 2

    @property
    def width(self) -> float:
        """The side from left to right."""
        return self.right - self.left


def emulate_phone(page: Page) -> None:
    """Give a page a phone with augmented reality from its next loading on: `phone` of phone.js."""
    assert IWER.is_file(), "iwer is not installed: run `npm ci --prefix tests/service/viewer/tools`"
    for script in (IWER, TOOLS / "phone.js"):
        page.add_init_script(path=script)


@contextmanager
def visitor(
    browser: Browser,
    address: str,
    script: str = "",
    *,
    origin: str | None = None,
    user_agent: str | None = None,
    turns: bool = False,
) -> Iterator[Page]:
    """Open the page of a service under an origin, on the emulated phone; no script may fail."""
    motion: Literal["no-preference", "reduce"] = "no-preference" if turns else "reduce"
    with browser.new_context(viewport=PHONE, reduced_motion=motion, user_agent=user_agent) as context:
        page = context.new_page()
        page.set_default_timeout(TIMEOUT_MS)
        expect.set_options(timeout=TIMEOUT_MS)
        emulate_phone(page)
        page.add_init_script(NOTE_LINKS + script)
        faults: list[str] = []
        page.on("pageerror", lambda error: faults.append(str(error)))
        if origin:
            page.route(f"{origin}/**", lambda route: _answer(route, origin, address))
        page.route("**/mesh?*", lambda route: _answer(route, origin or address, address, "&resolution=23"))
        page.goto(f"{origin or address}/")
        expect(page.locator("#count")).to_have_text(TRIANGLES, timeout=TIMEOUT_MS)
        yield page
        assert faults == []
        page.unroute_all(behavior="ignoreErrors")


def _answer(route: Route, origin: str, address: str, more: str = "") -> None:
    """Answer as the service does; `more` asks for fewer triangles, which an imitated GPU draws in time."""
    route.fulfill(response=route.fetch(url=route.request.url.replace(origin, address) + more))


def enter(page: Page) -> None:
    """Press the button and look at the floor, until the object is there to be placed."""
    page.evaluate("(pitch) => phone.look(pitch, 0)", DOWN)
    page.get_by_role("button", name="See it in your room").click()
    expect(hint(page)).to_have_text("Tap to put it here.")


def hint(page: Page) -> Locator:
    """Return the line that tells the visitor what to do."""
    return page.locator("#room p")


def place(page: Page) -> None:
    """Tap, where the visitor looks."""
    touch(page, ("right", DOWN, 0))
    page.evaluate("phone.lift()")
    expect(hint(page)).to_have_text("Drag to move it. Two fingers turn it and change its size.")


def touch(page: Page, *fingers: Finger) -> None:
    """Put fingers on the screen, or move them."""
    page.evaluate("(fingers) => phone.touch(...fingers)", fingers)


def picture(page: Page, name: str) -> Picture:
    """Return the picture of the room, and keep it as a file: (height, width, 3)."""
    content = base64.b64decode(page.evaluate("phone.picture()").partition(",")[2])
    (PICTURES / f"room-{name}.png").write_bytes(content)
    return np.asarray(Image.open(io.BytesIO(content)).convert("RGB")).astype(np.int16)


def box(page: Page, name: str) -> Box:
    """Return the box around what is drawn in the room."""
    return box_of(picture(page, name))


def box_of(shown: Picture) -> Box:
    """Return the box around what differs from the floor in a picture of the room."""
    ink = abs(shown - FLOOR).max(axis=2) > INK
    assert ink.any(), "nothing is drawn in the room"
    rows, columns = np.flatnonzero(ink.any(axis=1)), np.flatnonzero(ink.any(axis=0))
    return Box(columns[0], rows[0], columns[-1] + 1, rows[-1] + 1)
