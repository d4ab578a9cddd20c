"""Points in a JavaScript client: downloaded, or drawn there from the downloaded weights; bytes and milliseconds."""

import json
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import httpx
import numpy as np
from playwright.sync_api import Page, Route, sync_playwright

from benchmarks.speed.timing import Seconds
from tests.support import ROOT
from tests.support.browsing import launched, photo
from tests.support.processes import hof, serving
from tests.support.resources import others

SIZES: Final = (10_000, 100_000)
SCRIPT: Final = Path(__file__).with_suffix(".mjs")
PACKAGE: Final = ROOT / "client" / "js"
ON_CARD: Final = """async ([id, n]) => {
    const { Client, sampleOnCard } = await import("/hof-client/index.js");
    const start = performance.now();
    await sampleOnCard(await new Client(location.origin).functions(id), n);
    return performance.now() - start;
}"""


@dataclass(frozen=True)
class Figures:
    """Figures of the demo's chair; the service runs on one core, the client on another.

    points_bytes : bytes of n points as float32, by n.
    weights_bytes : bytes of the weights, color included.
    download_s, draw_s, card_s : seconds until n points are there: fetched, or drawn from the weights, which are fetched
        each time, by Node's processor and by the browser's WebGL2; (rounds,) by n.
    renderer : the browser's WebGL.
    """

    points_bytes: dict[int, int]
    weights_bytes: int
    download_s: dict[int, Seconds]
    draw_s: dict[int, Seconds]
    card_s: dict[int, Seconds]
    renderer: str


def measure(core: int, rounds: int) -> Figures:
    """Start `hof serve` on `core` and measure clients of it on the other cores."""
    subprocess.run([PACKAGE / "node_modules" / ".bin" / "tsc"], cwd=PACKAGE, check=True)  # noqa: S603
    with serving(hof(threads=1), {core}) as (url, _):
        encoded = httpx.post(f"{url}/encode", content=photo("chair").read_bytes(), timeout=60).json()["id"]
        sizes = {n: len(httpx.get(f"{url}/objects/{encoded}/points?n={n}&format=f32").content) for n in SIZES}
        weights = len(httpx.get(f"{url}/objects/{encoded}/weights").content)
        command = ["node", str(SCRIPT), url, encoded, str(rounds), *map(str, SIZES)]
        run = subprocess.run(_elsewhere(core, command), capture_output=True, text=True, check=True)  # noqa: S603
        table: dict[str, dict[str, list[float]]] = json.loads(run.stdout)
        download, draw = ({int(n): np.array(ms) / 1000 for n, ms in table[way].items()} for way in ("download", "draw"))
        card, renderer = _in_browser(url, encoded, rounds)
    return Figures(sizes, weights, download, draw, card, renderer)


def _elsewhere(core: int, command: list[str]) -> list[str]:
    """Return a command that runs on the other cores."""
    cores = ",".join(map(str, sorted(others(core))))
    return ["taskset", "--cpu-list", cores, *command]


def _in_browser(url: str, object_id: str, rounds: int) -> tuple[dict[int, Seconds], str]:
    """Time points by WebGL2 in Chromium; return them by n, and the name of its WebGL."""
    with sync_playwright() as playwright:
        browser = launched(playwright, "chromium")
        page = browser.new_page()
        page.route("**/hof-client/**", _package)
        page.goto(f"{url}/")
        times = {n: _times(lambda n=n: page.evaluate(ON_CARD, [object_id, n]), rounds) for n in SIZES}  # type: ignore[misc]
        renderer = _renderer(page)
        browser.close()
    return times, renderer


def _times(run: Callable[[], float], rounds: int) -> Seconds:
    run()
    return np.array([run() for _ in range(rounds)]) / 1000


def _package(route: Route) -> None:
    route.fulfill(path=PACKAGE / "dist" / route.request.url.split("/hof-client/")[1])


def _renderer(page: Page) -> str:
    name: str = page.evaluate(
        """() => {
            const gl = new OffscreenCanvas(1, 1).getContext("webgl2");
            return gl.getParameter(gl.getExtension("WEBGL_debug_renderer_info").UNMASKED_RENDERER_WEBGL);
        }"""
    )
    return name
