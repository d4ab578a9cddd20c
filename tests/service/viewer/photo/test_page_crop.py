"""The page in Chromium: a part of the photo, chosen by pointer, finger and keys, and the background."""

import io
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageDraw
from playwright.sync_api import Browser, FloatRect, Page, expect

from tests.support.browsing import FRAMES, PICTURES, TIMEOUT_MS, opened
from tests.support.slow import DEADLINE_S

WIDTH, HEIGHT = 300, 400  # of the photo, upright
NEAR = 6  # pixels of the photo: a pointer moves by pixels of the screen


@pytest.fixture
def two_chairs(tmp_path: Path) -> Path:
    """Write a JPEG photo that is stored on its side: upright, a blue thing is above a red one, on white."""
    image = Image.new("RGB", (WIDTH, HEIGHT), "white")
    draw = ImageDraw.Draw(image)
    draw.rectangle((90, 40, 210, 160), fill="blue")
    draw.rectangle((90, 240, 210, 360), fill="red")
    exif = Image.Exif()
    exif[0x0112] = 6  # to be turned clockwise to be upright
    path = tmp_path / "two.jpg"
    image.rotate(90, expand=True).save(path, exif=exif, quality=95)
    return path


def _encoded(page: Page, act: Callable[[], object]) -> dict[str, Any]:
    """Act, and return the object that the service made then, once it is shown."""
    with page.expect_response(lambda response: "/encode" in response.url) as answer:
        act()
    item: dict[str, Any] = answer.value.json()
    page.wait_for_url(f"**/#/objects/{item['id']}")
    expect(page.locator("#working")).to_be_hidden()
    return item


def _middle(page: Page) -> list[int]:
    """Return the color in the middle of the photo that is shown."""
    image = Image.open(io.BytesIO(page.locator("#framing .picture").screenshot())).convert("RGB")
    return [int(channel) for channel in np.asarray(image)[image.height // 2, image.width // 2]]


def _resting(page: Page) -> FloatRect:
    """Return the box of the photo, once it has come to rest: controls that appear move it."""
    picture = page.locator("#framing .picture")
    box = picture.bounding_box()
    deadline = time.monotonic() + DEADLINE_S
    while True:
        page.evaluate(FRAMES)
        after = picture.bounding_box()
        if after and after == box:
            return after
        assert time.monotonic() < deadline
        box = after


def _draw(page: Page, begin: tuple[float, float], end: tuple[float, float]) -> None:
    """Drag the mouse between two places of the photo, shares of its sides."""
    frame = _resting(page)
    places = [(frame["x"] + x * frame["width"], frame["y"] + y * frame["height"]) for x, y in (begin, end)]
    page.mouse.move(*places[0])
    page.mouse.down()
    page.mouse.move(*places[1], steps=5)
    page.mouse.up()


def test_crop_that_is_drawn_is_encoded_upright_and_undone(page: Page, two_chairs: Path) -> None:
    whole = _encoded(page, lambda: page.set_input_files("#file", two_chairs))
    assert (whole["image"]["width"], whole["image"]["height"]) == (WIDTH, HEIGHT)
    page.get_by_role("button", name="Crop").click()
    expect(page.locator("#crop-size")).to_be_visible()
    _draw(page, (0.02, 0.02), (0.06, 0.08))  # beside the rectangle: a new one
    _draw(page, (0.06, 0.08), (0.98, 0.48))  # a corner
    expect(page.locator("#crop-size")).to_contain_text("pixels")
    page.screenshot(path=PICTURES / "crop.png")
    part = _encoded(page, lambda: page.get_by_role("button", name="Use this part").click())
    assert part["id"] != whole["id"]
    assert abs(part["image"]["width"] - 0.96 * WIDTH) < NEAR
    assert abs(part["image"]["height"] - 0.46 * HEIGHT) < NEAR
    red, _, blue = _middle(page)
    assert blue > red + 100  # the upper thing of the upright photo
    expect(page.locator('.curl[data-of="encode"]')).to_be_hidden()  # no file of the visitor's is the part
    page.screenshot(path=PICTURES / "cropped.png")
    again = _encoded(page, lambda: page.get_by_role("button", name="Whole photo").click())
    assert again["id"] == whole["id"]
    expect(page.get_by_role("button", name="Whole photo")).to_be_hidden()
    expect(page.locator('.curl[data-of="encode"]')).to_be_attached()


def test_crop_by_keyboard_alone_moves_corners_and_is_kept_for_the_next_crop(page: Page, two_chairs: Path) -> None:
    _encoded(page, lambda: page.set_input_files("#file", two_chairs))
    page.get_by_role("button", name="Crop").press("Enter")
    corner = page.get_by_role("button", name="Top left corner")
    expect(corner).to_be_focused()
    for _ in range(4):
        page.keyboard.press("Shift+ArrowDown")
    page.keyboard.press("ArrowDown")
    expect(page.locator("#crop-size")).to_contain_text("240 \u00d7 156 pixels")
    part = _encoded(page, lambda: page.keyboard.press("Enter"))
    assert (part["image"]["width"], part["image"]["height"]) == (240, 156)
    red, _, blue = _middle(page)
    assert red > blue + 100
    expect(page.get_by_role("button", name="Crop")).to_be_focused()
    page.keyboard.press("Enter")
    expect(page.locator("#crop-size")).to_contain_text("240 \u00d7 156 pixels")
    expect(corner).to_be_focused()
    page.keyboard.press("Escape")
    expect(page.locator("#crop-size")).to_be_hidden()
    assert _middle(page)[0] > 200  # the part is shown again


def test_background_that_is_chosen_is_taken_for_the_part(page: Page, two_chairs: Path) -> None:
    _encoded(page, lambda: page.set_input_files("#file", two_chairs))
    page.get_by_role("button", name="Crop").click()
    expect(page.get_by_role("button", name="Top left corner")).to_be_focused()
    _draw(page, (0.1, 0.9), (0.1, 0.98))
    page.get_by_role("button", name="Top left corner").focus()
    for _ in range(4):
        page.keyboard.press("Shift+ArrowDown")
    part = _encoded(page, lambda: page.keyboard.press("Enter"))
    assert part["image"]["mask"] == "border"
    kept = _encoded(page, lambda: page.get_by_label("Background").select_option("keep"))
    assert kept["image"]["mask"] == "none"
    assert (kept["image"]["width"], kept["image"]["height"]) == (part["image"]["width"], part["image"]["height"])
    expect(page.locator("#framing figcaption")).to_contain_text("whole picture")


def test_crop_with_a_finger_on_a_phone(browser: Browser, address: str, two_chairs: Path) -> None:
    with browser.new_context(viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True) as context:
        page = opened(context.new_page(), address)
        _encoded(page, lambda: page.set_input_files("#file", two_chairs))
        page.get_by_role("button", name="Crop").tap()
        picture = page.locator("#framing .picture")
        picture.scroll_into_view_if_needed()
        expect(page.locator("#crop-size")).to_contain_text("240 \u00d7 320 pixels", timeout=TIMEOUT_MS)
        corner = page.get_by_role("button", name="Bottom right corner").bounding_box()
        frame = picture.bounding_box()
        assert corner
        assert frame
        assert frame["height"] > 300  # a thumbnail is too small for fingers
        devices = context.new_cdp_session(page)
        x, y = corner["x"] + corner["width"] / 2, corner["y"] + corner["height"] / 2
        for name, (across, down) in {
            "touchStart": (x, y),
            "touchMove": (x, y - 0.4 * frame["height"]),
            "touchEnd": (0, 0),
        }.items():
            points = [] if name == "touchEnd" else [{"x": across, "y": down}]
            devices.send("Input.dispatchTouchEvent", {"type": name, "touchPoints": points})
        page.screenshot(path=PICTURES / "crop-phone.png")
        part = _encoded(page, lambda: page.get_by_role("button", name="Use this part").click())
        assert abs(part["image"]["width"] - 240) < NEAR
        assert abs(part["image"]["height"] - 160) < NEAR
        assert page.evaluate("document.documentElement.scrollWidth") == 390
