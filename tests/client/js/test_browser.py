"""The package in Chromium: calls, and functions drawn there by the processor and by WebGL2."""

from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest
from playwright.sync_api import Browser, Page

from tests.support.browsing import photo

TOLERANCE = 1e-4  # longest sides of the object
N = 20_000

DRAWN = """async ([way, id, n, seed]) => {
    const hof = await import("/hof-client/index.js");
    const client = new hof.Client(location.origin);
    const functions = await client.functions(id);
    const points = await hof[way](functions, n, { seed });
    return { points: [...points], expected: [...await client.points(id, { n, seed })] };
}"""
ENCODED = """async () => {
    const { Client } = await import("/hof-client/index.js");
    const photo = await (await fetch("viewer/photos/chair.webp")).blob();
    const first = await new Client(location.origin).encode(photo);
    const second = await new Client(location.href).encode(photo);
    return [first.id, second.id];
}"""


@pytest.fixture
def bare(browser: Browser, address: str, built: Path) -> Iterator[Page]:
    """Open a page of the service's origin that offers the package under /hof-client/."""
    with browser.new_context(reduced_motion="reduce") as context:
        page = context.new_page()
        page.route(
            "**/hof-client/**",
            lambda route: route.fulfill(path=built / "dist" / route.request.url.split("/hof-client/")[1]),
        )
        page.goto(f"{address}/embed")  # shows nothing
        yield page


@pytest.mark.parametrize("seed", [0, 2**53 - 1])
@pytest.mark.parametrize("way", ["sample", "sampleOnCard"])
def test_function_drawn_in_a_browser_gives_the_points_of_the_service(
    bare: Page, address: str, way: str, seed: int
) -> None:
    object_id = httpx.post(f"{address}/encode", content=photo("chair").read_bytes(), timeout=60).json()["id"]
    result = bare.evaluate(DRAWN, [way, object_id, N, seed])
    assert len(result["points"]) == 3 * N
    np.testing.assert_allclose(result["points"], result["expected"], rtol=0, atol=TOLERANCE)


def test_photo_is_encoded_from_a_browser(bare: Page, address: str) -> None:
    bare.goto(f"{address}/")
    first, second = bare.evaluate(ENCODED)
    assert first == second
