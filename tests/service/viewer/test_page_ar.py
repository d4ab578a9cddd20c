"""The page in Chromium: augmented reality in the browser itself, on an emulated phone (iwer)."""

import json
import re
from collections.abc import Sequence

import httpx
import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from tests.service.viewer.tools.room import (
    DOWN,
    FLOOR,
    PHONE,
    Box,
    Finger,
    box,
    box_of,
    enter,
    hint,
    picture,
    place,
    touch,
    visitor,
)
from tests.support.browsing import INK, PICTURES, QUICK_LOOK, changed

VIEW = 60  # degrees, the height of the emulated camera's view
EYE = 1.5  # meters above the floor
HTTPS = "https://hof.test"
ANDROID = (
    "Mozilla/5.0 (Linux; Android 10; K) AppleWebKit/537.36 (KHTML, like Gecko) Chrome/130.0.0.0 Mobile Safari/537.36"
)
REFUSE = """
    navigator.xr.requestSession = async () => { throw new DOMException("no", "%s") };
"""
UNSUPPORTED = """
    navigator.xr.isSessionSupported = async (mode) => %s;
"""
QUICK = """
    const now = performance.now.bind(performance);
    performance.now = () => now() / 100; // no frame is so slow that the turntable stops for good
"""
REST = """() => {
    const canvas = document.querySelector("#stage canvas");
    const { x, y, width, height } = canvas.getBoundingClientRect();
    const size = [canvas.width, canvas.height];
    return { place: [x, y, width, height, scrollY], size, canvases: document.querySelectorAll("canvas").length };
}"""


def expected_box(page: Page) -> Box:
    """Return the box of the shown object on the floor where the visitor looks, its longest side 1 m."""
    id_ = page.url.partition("objects/")[2] or httpx.get(f"{page.url}objects").json()["items"][0]["id"]
    width, height, depth = httpx.get(f"{page.url.partition('#')[0]}objects/{id_}").json()["dimensions"]
    pitch = np.radians(DOWN)
    ahead = EYE / np.tan(-pitch)
    corners = np.array(
        [(x * width / 2, y * height, z * depth / 2 - ahead) for x in (-1, 1) for y in (0, 1) for z in (-1, 1)]
    )
    across, up, back = (corners - (0, EYE, 0)).T
    up, away = up * np.cos(pitch) + back * np.sin(pitch), up * np.sin(pitch) - back * np.cos(pitch)
    focal = PHONE["height"] / 2 / np.tan(np.radians(VIEW / 2))
    columns = PHONE["width"] / 2 + focal * across / away
    rows = PHONE["height"] / 2 - focal * up / away
    return Box(columns.min(), rows.min(), columns.max(), rows.max())


def test_room_shows_the_object_on_the_floor_in_its_size(browser: Browser, address: str) -> None:
    with visitor(browser, address) as page:
        enter(page)
        assert page.evaluate("phone.requested") == [
            {
                "mode": "immersive-ar",
                "requiredFeatures": ["hit-test"],
                "optionalFeatures": ["dom-overlay", "light-estimation"],
                "domOverlay": "room",
            }
        ]
        ringed = box(page, "aimed")
        place(page)
        placed, expected = box(page, "placed"), expected_box(page)
        page.screenshot(path=PICTURES / "room.png")
    assert ringed.width > placed.width  # the ring around it is gone
    assert placed == pytest.approx(expected, abs=0.15 * expected.width)


def test_object_follows_the_look_until_a_tap_places_it(browser: Browser, address: str) -> None:
    with visitor(browser, address) as page:
        enter(page)
        page.evaluate("(pitch) => phone.look(pitch, 8)", DOWN)
        assert box(page, "followed").center == pytest.approx(PHONE["width"] / 2, abs=20)
        touch(page, ("right", DOWN, 8))
        page.evaluate("phone.lift()")
        page.evaluate("(pitch) => phone.look(pitch, 0)", DOWN)
        assert box(page, "stays").center < PHONE["width"] / 2 - 40


def test_walls_are_no_place_for_an_object(browser: Browser, address: str) -> None:
    with visitor(browser, address) as page:
        page.evaluate("phone.look(0, 0)")
        with page.expect_response("**/mesh?*"):
            page.get_by_role("button", name="See it in your room").click()
        page.evaluate("phone.frames(6)")
        expect(hint(page)).to_have_text("Look around slowly, at the floor or a table.")
        touch(page, ("right", 0, 0))
        page.evaluate("phone.lift()")
        assert not (abs(picture(page, "wall") - FLOOR).max(axis=2) > INK).any()
        page.evaluate("(pitch) => phone.look(pitch, 0)", DOWN)
        expect(hint(page)).to_have_text("Tap to put it here.")


def test_one_finger_moves_the_object_and_two_turn_and_enlarge_it(browser: Browser, address: str) -> None:
    flat, steep = [("left", DOWN, 4), ("right", DOWN, -4)], [("left", DOWN + 4, 0), ("right", DOWN - 4, 0)]
    with visitor(browser, address) as page:
        enter(page)
        place(page)
        before = picture(page, "before")
        _drag(page, [("right", DOWN, 0)], [("right", DOWN, -3)])
        moved = box(page, "moved")
        assert 15 < moved.center - box_of(before).center < 45
        assert moved.width == pytest.approx(box_of(before).width, rel=0.1)
        _drag(page, [("right", DOWN, -3)], [("right", DOWN, 0)])
        assert changed(picture(page, "back"), before) < 0.02
        _drag(page, flat, steep)
        assert changed(picture(page, "turned"), before) > 0.05
        _drag(page, steep, flat)
        assert changed(picture(page, "turned-back"), before) < 0.02
        _drag(page, flat, [("left", DOWN, 5), ("right", DOWN, -5)])
        expect(hint(page)).to_contain_text("125% of its size")
        assert box(page, "larger").width == pytest.approx(
            1.3 * box_of(before).width, rel=0.1
        )  # its front is nearer, too


def _drag(page: Page, start: Sequence[Finger], end: Sequence[Finger]) -> None:
    touch(page, *start)
    touch(page, *end)
    page.evaluate("phone.lift()")


@pytest.mark.parametrize("way", ["button", "system"])
def test_end_of_the_session_gives_the_page_back(browser: Browser, address: str, way: str) -> None:
    with visitor(browser, address, QUICK, turns=True) as page:
        page.evaluate("phone.draws('page', 30)")  # it turns
        page.locator("#ar").scroll_into_view_if_needed()
        before = page.evaluate(REST)
        enter(page)
        resting = page.evaluate("phone.frames(2).then(() => phone.drawn.page)")
        assert page.evaluate("phone.frames(6).then(() => phone.drawn.page)") == resting
        if way == "button":
            page.get_by_role("button", name="Leave").click()
        else:
            page.evaluate("phone.session().end()")
        expect(page.locator("#room")).to_be_hidden()
        expect(page.locator("#ar")).to_be_focused()
        assert page.evaluate(REST) == before
        page.evaluate("phone.draws('page', 30)")  # it turns again
        enter(page)
        page.evaluate("phone.draws('room')")


def test_light_of_the_room_colors_the_object(browser: Browser, address: str) -> None:
    estimate = {
        "sphericalHarmonicsCoefficients": [0.4, 0, 0] + [0] * 24,
        "primaryLightIntensity": {"x": 1.5, "y": 0, "z": 0, "w": 1},
        "primaryLightDirection": {"x": 0, "y": 1, "z": 1, "w": 0},
    }
    with visitor(browser, address) as page:
        enter(page)
        place(page)
        plain = picture(page, "plain")
        page.evaluate("(estimate) => phone.light(estimate)", estimate)
        lit = picture(page, "lit")
        ink = abs(plain - FLOOR).max(axis=2) > INK
        red, green, blue = lit[ink].mean(axis=0)
        assert red > 2 * max(green, blue)


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("NotAllowedError", "not allowed to use the camera"),
        ("SecurityError", "does not let this page"),
        ("NotSupportedError", "on this device"),
        ("InvalidStateError", "could not show augmented reality: no"),
    ],
)
def test_refused_session_is_told_and_an_app_opens_instead(
    browser: Browser, address: str, name: str, reason: str
) -> None:
    followed = re.compile(r"^intent://arvr.google.com/scene-viewer")
    with visitor(browser, address, REFUSE % name, origin=HTTPS, user_agent=ANDROID) as page:
        page.get_by_role("button", name="See it in your room").click()
        expect(page.locator("html")).to_have_attribute("data-followed", followed)
        expect(page.locator("#notice")).to_contain_text(reason)
        expect(page.locator("#notice")).to_contain_text("Scene Viewer opens instead")
        page.locator("html").evaluate("(html) => { delete html.dataset.followed }")
        page.get_by_role("button", name="Open Scene Viewer").click()  # of the notice
        expect(page.locator("html")).to_have_attribute("data-followed", followed)
        expect(page.locator("#notice")).to_be_hidden()


def test_refused_session_on_an_iphone_opens_quick_look(browser: Browser, address: str) -> None:
    with visitor(browser, address, QUICK_LOOK + REFUSE % "NotSupportedError") as page:
        page.get_by_role("button", name="See it in your room").click()
        expect(page.locator("html")).to_have_attribute("data-followed", re.compile("^blob:"))
        expect(page.locator("#notice")).to_contain_text("Quick Look opens instead")


def test_refused_session_without_an_app_is_an_error_and_can_be_tried_again(browser: Browser, address: str) -> None:
    once = """
        const start = navigator.xr.requestSession;
        navigator.xr.requestSession = async () => {
            navigator.xr.requestSession = start;
            throw new DOMException("no", "NotAllowedError");
        };
    """
    with visitor(browser, address, once) as page:
        page.get_by_role("button", name="See it in your room").click()
        expect(page.locator("#problem")).to_contain_text("not allowed to use the camera")
        expect(page.locator("#room")).to_be_hidden()
        enter(page)
        expect(page.locator("#problem")).to_be_hidden()


def test_object_that_is_gone_ends_the_session_with_an_error(browser: Browser, address: str) -> None:
    gone = {"title": "Not found", "detail": "there is no such object"}
    with visitor(browser, address) as page:
        page.route(
            "**/mesh?*",
            lambda route: route.fulfill(status=404, content_type="application/problem+json", body=json.dumps(gone)),
        )
        page.get_by_role("button", name="See it in your room").click()
        expect(page.locator("#problem")).to_contain_text("there is no such object")
        expect(page.locator("#room")).to_be_hidden()
        assert page.evaluate("phone.session() == null")


@pytest.mark.parametrize("answer", ["mode === 'immersive-vr'", "Promise.reject(new DOMException('', 'SecurityError'))"])
def test_browser_without_sessions_has_the_app_alone(browser: Browser, address: str, answer: str) -> None:
    with visitor(browser, address, UNSUPPORTED % answer, origin=HTTPS, user_agent=ANDROID) as page:
        page.get_by_role("button", name="See it in your room").click()
        expect(page.locator("html")).to_have_attribute("data-followed", re.compile("^intent:"))
        assert page.evaluate("phone.requested") == []
    with visitor(browser, address, UNSUPPORTED % answer) as page:
        expect(page.locator("#ar")).to_be_hidden()


def test_policies_of_the_service_allow_sessions_to_the_page(browser: Browser, address: str) -> None:
    with visitor(browser, address) as page:
        assert page.evaluate("document.featurePolicy.allowsFeature('xr-spatial-tracking')")


def test_button_that_is_pressed_twice_opens_one_session(browser: Browser, address: str) -> None:
    with visitor(browser, address) as page:
        page.evaluate("(pitch) => phone.look(pitch, 0)", DOWN)
        page.locator("#ar").evaluate("(button) => { button.click(); button.click(); }")
        expect(hint(page)).to_have_text("Tap to put it here.")
        expect(page.locator("#problem")).to_be_hidden()
        assert len(page.evaluate("phone.requested")) == 1


def test_room_is_loaded_when_it_is_entered(browser: Browser, address: str) -> None:
    with visitor(browser, address) as page:
        modules = "performance.getEntriesByType('resource').map(({ name }) => name.split('/').at(-1))"
        assert not {"room.js", "placing.js", "light.js"} & set(page.evaluate(modules))
        enter(page)
        assert {"room.js", "placing.js", "light.js"} <= set(page.evaluate(modules))
