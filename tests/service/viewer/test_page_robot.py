"""The page in Chromium: a path around the object, its ends dragged, moved by keys and typed, and the photo's camera."""

import json
import re
from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from service.settings import Settings
from tests.support.browsing import PICTURES, TIMEOUT_MS, changed, curl_line, opened, photo, pixels, run
from tests.support.server import running
from tests.support.small import model as tiny_model

AROUND = re.compile(r"^A way around the object: (\d\.\d+) long\.$")


@pytest.fixture
def robot(page: Page) -> Page:
    """Open the panel of a robot's path."""
    page.get_by_text("Path for a robot").click()
    expect(page.locator("#way")).to_have_text(AROUND)
    return page


def _orange(page: Page) -> int:
    """Return the number of pixels of the stage in the color of the path and its ends."""
    shown = pixels(page)
    red, green, blue = (shown[..., channel] for channel in range(3))
    return int(((red > 150) & (red - blue > 110) & (red - green > 60)).sum())


def _fill(page: Page, name: str, place: tuple[float, float, float]) -> None:
    for axis, value in zip("xyz", place, strict=True):
        page.get_by_role("group", name=name).get_by_label(axis).fill(str(value))
    page.keyboard.press("Tab")


def test_path_around_the_object_is_drawn_with_its_length_as_the_service_plans_it(robot: Page) -> None:
    page = robot
    plan = json.loads(run(curl_line(page, "path"), PICTURES))
    match = AROUND.match(page.locator("#way").inner_text())
    assert match
    assert float(match[1]) == pytest.approx(plan["length"], abs=0.005)
    assert not plan["straight"]
    drawn = _orange(page)
    assert drawn > 300
    page.screenshot(path=PICTURES / "path.png", full_page=True)
    page.get_by_text("Path for a robot").click()
    expect(page.get_by_role("button", name="Goal")).to_be_hidden()
    assert _orange(page) < drawn / 10


def test_path_ends_that_are_typed_give_a_straight_way_or_the_reason_for_none(robot: Page) -> None:
    page = robot
    _fill(page, "Start", (-0.7, 0.9, 0))
    _fill(page, "Goal", (0.7, 0.9, 0))
    expect(page.locator("#way")).to_have_text("The straight line is free: 1.4 long.")
    address = page.url.partition("#")[0]
    identity = curl_line(page, "path").split("/")[-2]
    points = httpx.get(f"{address}objects/{identity}/points?n=1&format=json&seed=1").json()["points"]
    _fill(page, "Goal", tuple(points[0][:3]))
    expect(page.locator("#way")).to_have_text("No way: the goal is inside the object or too near to it.")
    page.screenshot(path=PICTURES / "path-none.png", full_page=True)
    _fill(page, "Start", tuple(points[0][:3]))
    expect(page.locator("#way")).to_have_text("No way: the start is inside the object or too near to it.")
    assert _orange(page) < 3000  # the two ends, no line


def test_path_ends_are_dragged_and_moved_by_keys(robot: Page) -> None:
    page = robot
    goal = page.get_by_role("button", name="Goal")
    fields = page.get_by_role("group", name="Goal").get_by_role("spinbutton")
    before = [float(fields.nth(axis).input_value()) for axis in range(3)]
    box = goal.bounding_box()
    assert box
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y - 150, steps=4)
    page.mouse.up()
    moved = [float(fields.nth(axis).input_value()) for axis in range(3)]
    assert moved[1] > before[1] + 0.2
    after = goal.bounding_box()
    assert after
    assert after["y"] == pytest.approx(box["y"] - 150, abs=2)
    expect(page.locator("#way")).to_have_text(re.compile("long"))
    goal.press("ArrowDown")
    lower = [float(fields.nth(axis).input_value()) for axis in range(3)]
    assert lower[1] < moved[1]
    canvas = page.locator("#stage canvas")
    placed = goal.bounding_box()
    canvas.press("ArrowLeft")  # the ends turn with the object
    pixels(page)
    turned = goal.bounding_box()
    assert turned
    assert placed
    assert np.hypot(turned["x"] - placed["x"], turned["y"] - placed["y"]) > 10


@pytest.fixture
def estimated(browser: Browser, tmp_path: Path) -> Iterator[Page]:
    """Open the page of a service whose model estimates the camera, with one object."""
    model = tiny_model.build(tmp_path / "tiny-k2.onnx", estimates=True)
    with (
        running(Settings(model=(model,), database_url=f"sqlite:///{tmp_path / 'hof.db'}", threads=1)) as server,
        browser.new_context(viewport={"width": 1280, "height": 1000}) as context,
    ):
        address = f"http://127.0.0.1:{server.port}"
        assert httpx.post(f"{address}/encode", content=photo("chair").read_bytes(), timeout=60).status_code == 201
        yield opened(context.new_page(), address)


def test_camera_of_the_photo_is_told_looked_from_and_gives_points_in_its_frame(estimated: Page) -> None:
    page = estimated
    page.get_by_text("Path for a robot").click()
    expect(page.locator("#photo-camera p")).to_contain_text("beside the front", timeout=TIMEOUT_MS)
    before = pixels(page)
    page.get_by_role("button", name="Look from there").click()
    assert changed(pixels(page), before) > 0.005
    points = run(curl_line(page, "camera").replace("-o points.ply", ""), PICTURES)
    assert points.startswith(b"ply")
    page.screenshot(path=PICTURES / "camera.png", full_page=True)


def test_camera_of_the_photo_is_hidden_where_an_object_of_several_photos_has_none(estimated: Page) -> None:
    page = estimated
    page.get_by_text("Path for a robot").click()
    expect(page.locator("#photo-camera")).to_be_visible()
    address = page.url.split("/#")[0].rstrip("/")
    files = [("image", (name, photo(name).read_bytes())) for name in ("chair", "armchair")]
    answer = httpx.post(f"{address}/encode", files=files, timeout=60)
    assert answer.status_code == 201
    page.goto(f"{address}/#/objects/{answer.json()['id']}")
    page.reload()
    page.get_by_text("Path for a robot").click()
    expect(page.locator("#way")).not_to_be_empty()
    expect(page.locator("#photo-camera")).to_be_hidden()
