"""The page in Chromium: points that the browser's graphics card computes from theta alone."""

import re
from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest
from playwright.sync_api import Page, expect

from tests.support.browsing import PICTURES, TRIANGLES, changed, curl_line, photo, pixels, run

TOLERANCE = 1e-4  # longest sides of the object

COMPUTE = """async ([id, n, seed]) => {
    const { WebGLRenderer } = await import("three");
    const { ComputedPoints } = await import("/viewer/js/stage/function.js");
    const { formOf } = await import("/viewer/js/function/weights.js");
    const { fetchFunctions } = await import("/viewer/js/object/weights.js");
    const object = await (await fetch(`objects/${id}`)).json();
    const functions = await fetchFunctions(object);
    const renderer = new WebGLRenderer({ canvas: document.createElement("canvas") });
    const computed = new ComputedPoints(renderer, functions, formOf(functions, object.frame), seed);
    await computed.extend(n / 2); // grows
    while (computed.done < n) await computed.extend(n);
    const { points, paint } = computed.read(0, n);
    return { points: [...points], paint: [...paint], error: renderer.getContext().getError() };
}"""


def _computed(page: Page, object_id: str, n: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    result = page.evaluate(COMPUTE, [object_id, n, str(seed)])
    assert result["error"] == 0
    return np.array(result["points"]).reshape(-1, 3), np.array(result["paint"]).reshape(-1, 4)


def _sampled(address: str, object_id: str, n: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    answer = httpx.get(f"{address}/objects/{object_id}/points?n={n}&seed={seed}&format=json").json()
    return np.array(answer["points"]), np.array(answer.get("colors", np.zeros((n, 3))))


def _ids(address: str) -> list[str]:
    """Return the ids of the chair and the armchair."""
    photos = [photo(name).read_bytes() for name in ("chair", "armchair")]
    return [httpx.post(f"{address}/encode", content=content).json()["id"] for content in photos]


@pytest.fixture(autouse=True)
def no_fault_of_webgl(page: Page) -> Iterator[None]:
    """Fail if WebGL refuses a call, which it only warns of."""
    faults: list[str] = []
    page.on("console", lambda message: faults.append(message.text) if "GL_INVALID" in message.text else None)
    yield
    assert faults == []


@pytest.mark.parametrize("seed", [0, 7, 2**53 - 1])
def test_points_of_the_browser_are_those_of_the_service(page: Page, address: str, seed: int) -> None:
    for item in httpx.get(f"{address}/objects").json()["items"][:2]:
        points, paint = _computed(page, item["id"], 5000, seed)
        expected, colors = _sampled(address, item["id"], 5000, seed)
        assert np.abs(points - expected).max() < TOLERANCE
        if "color" in item:
            assert np.abs(paint[:, 2::-1] - colors).max() <= 1


def test_points_of_a_word_in_the_browser_are_those_of_the_service(page: Page, address: str) -> None:
    word = httpx.post(f"{address}/compose", json={"objects": _ids(address)}).json()
    points, _ = _computed(page, word["id"], 2000, 0)
    assert np.abs(points - _sampled(address, word["id"], 2000, 0)[0]).max() < TOLERANCE


def test_object_is_drawn_from_the_function_alone(page: Page, tmp_path: Path) -> None:
    fetched = pixels(page)
    urls: list[str] = []
    page.on("request", lambda request: urls.append(request.url))
    page.get_by_role("switch", name="From the function").check()
    expect(page.locator("#function p")).to_contain_text(re.compile(r"sent \d\d KB.* 10,000 points"))
    expect(page.locator("#count")).to_have_text("10,000 points")
    assert (np.abs(pixels(page) - fetched) > 8).mean() < 0.002  # the same points
    page.locator("#n").evaluate(
        "(slider) => { slider.value = 4.7; slider.dispatchEvent(new Event('input', { bubbles: true })) }"
    )
    expect(page.locator("#count")).to_have_text("50,000 points")
    assert len([url for url in urls if "/weights?" in url]) == 1
    assert not any("/points?" in url for url in urls)
    assert page.locator("#n").get_attribute("max") == "7"
    page.screenshot(path=PICTURES / "function.png", full_page=True)
    run(curl_line(page, "points"), tmp_path)
    assert np.load(tmp_path / "points.npy").shape == (50_000, 3)
    assert "n=50000, seed=0" in curl_line(page, "python")
    page.locator("#seed").fill("7")
    page.locator("#seed").press("Tab")
    expect(page.locator('.curl[data-of="python"] code')).to_contain_text("n=50000, seed=7")
    page.get_by_role("switch", name="Surface").check()
    expect(page.locator("#count")).to_have_text(TRIANGLES)
    expect(page.locator("#function")).to_be_hidden()


MORPH = """async ([ids, place, n]) => {
    const { WebGLRenderer } = await import("three");
    const { ComputedPoints } = await import("/viewer/js/stage/function.js");
    const { fetchFunctions } = await import("/viewer/js/object/weights.js");
    const { formAt, joined } = await import("/viewer/js/object/morph.js");
    const way = await Promise.all(ids.map(async (id) => (await fetch(`objects/${id}`)).json()));
    const functions = joined(await fetchFunctions(way[0]), await fetchFunctions(way.at(-1)));
    const renderer = new WebGLRenderer({ canvas: document.createElement("canvas") });
    const computed = new ComputedPoints(renderer, functions, formAt(way, place, functions));
    while (computed.done < n) await computed.extend(n);
    return [...computed.read(0, n).points];
}"""


def test_way_between_two_objects_meets_their_word(page: Page, address: str) -> None:
    ids = _ids(address)
    word = httpx.post(f"{address}/compose", json={"objects": ids}).json()["id"]
    way = [ids[0], word, ids[1]]
    for place, object_id in enumerate(way):
        points = np.array(page.evaluate(MORPH, [way, place, 2000])).reshape(-1, 3)
        assert np.abs(points - _sampled(address, object_id, 2000, 0)[0]).max() < TOLERANCE
    between = np.array(page.evaluate(MORPH, [way, 1.5, 2000])).reshape(-1, 3)
    assert np.abs(between).max() < 1
    assert np.abs(between - points).max() > 0.01


def test_slider_between_two_objects_draws_the_way(page: Page) -> None:
    mix = page.locator("#gallery .mix")
    mix.nth(0).press("Enter")
    mix.nth(1).press("Enter")
    expect(page.locator("#words button")).to_have_text(["A", "AB", "BA", "B"])
    shown = []
    for place in (0.5, 1.5):
        page.locator("#between").evaluate(
            "(slider, value) => { slider.value = value; slider.dispatchEvent(new Event('input')) }", place
        )
        expect(page.locator("#count")).to_have_text("60,000 points")
        expect(page.locator("#words")).to_be_hidden()
        shown.append(pixels(page))
    assert changed(*shown) > 0.02
    assert page.locator("#between").get_attribute("aria-valuetext") == "75% B"
    page.screenshot(path=PICTURES / "morph.png", full_page=True)
    page.get_by_role("button", name="Side by side").click()
    expect(page.locator("#words button")).to_have_count(4)
