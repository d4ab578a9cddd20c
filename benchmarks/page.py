"""The page for a visitor: Lighthouse's scores and the time from a photo to its object on the stage.

`python -m benchmarks.page` writes PAGE.md. It needs chromium, Node, and what `make test` installs for the page.
"""

import argparse
import io
import json
import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np
from PIL import Image
from playwright.sync_api import Page, sync_playwright

from benchmarks.targets import Target, targets_table
from model.provenance import provenance
from tests.support.browsing import TIMEOUT_MS, WEBGL, launched, photo
from tests.support.processes import hof, serving

HERE: Final = Path(__file__).resolve().parent
LIGHTHOUSE: Final = Path("tests/service/viewer/tools/node_modules/lighthouse/cli/index.js")
CATEGORIES: Final = {"performance": 95, "accessibility": 95}  # least score of each
FIRST_S: Final = 1.5  # most of them, from a photo to its object on the stage
CORES: Final = 2  # of the machine: of the service and of the browser together
TIMEOUT_S: Final = 300

HEAD: Final = (
    "# The page\n\n"
    "Written by `python -m benchmarks.page`. {machine}; {date}, seed {seed}, commit {commit}. Service and browser "
    "share {cores} cores; the load average at the end was {load:.1f}. Chromium draws without a graphics card. Each of "
    "{rounds} photos is new to the service, and the page is opened anew for it; the longest took {longest:.2f} s.\n\n"
)

# Resolves to the milliseconds from the choice of a photo until its surface is drawn.
WATCH: Final = """() => {
    globalThis.drawn = new Promise((done) => {
        let start;
        document.addEventListener("change", () => (start ??= performance.now()), true);
        const count = document.getElementById("count");
        new MutationObserver(() => {
            if (start === undefined || !/triangles$/.test(count.textContent)) return;
            requestAnimationFrame(() => requestAnimationFrame(() => {
                const gl = document.querySelector("#stage canvas").getContext("webgl2");
                gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
                done(performance.now() - start);
            }));
        }).observe(count, { childList: true });
    });
}"""


def main() -> None:
    """Measure the page; write PAGE.md and print it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.page", description=main.__doc__)
    parser.add_argument("--rounds", type=int, default=7, help="photos")
    parser.add_argument("-o", "--output", type=Path, default=HERE, help="folder of PAGE.md; default: benchmarks")
    arguments = parser.parse_args()
    rounds = arguments.rounds
    chromium = shutil.which("chromium")
    if not chromium or not LIGHTHOUSE.is_file():
        parser.error("it needs chromium, and `npm ci --prefix tests/service/viewer/tools`")
    cores = sorted(os.sched_getaffinity(0))[:CORES]
    os.sched_setaffinity(0, cores)
    run = provenance(0)
    with serving(hof(threads=1), set(cores)) as (url, _):
        targets = []
        for device in ("desktop", "mobile"):
            scores = lighthouse(chromium, url, device)
            targets += [Target(f"Lighthouse, {device}: {name}", scores[name], CATEGORIES[name]) for name in CATEGORIES]
        times = first_results_s(url, rounds)
    what = "s from a photo to its object on the stage, median"
    targets.append(Target(what, float(np.median(times)), FIRST_S, at_most=True))
    head = HEAD.format(**run, load=os.getloadavg()[0], cores=len(cores), rounds=rounds, longest=max(times))
    report = f"{head}{targets_table(targets)}\n"
    (arguments.output / "PAGE.md").write_text(report, encoding="utf-8")
    print(report, end="")


def lighthouse(chromium: str, url: str, device: str) -> dict[str, float]:
    """Return Lighthouse's scores of the page, from 0 to 100, by category."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        command = [shutil.which("node") or "node", str(LIGHTHOUSE), f"{url}/", "--quiet"]
        command += ["--output=json", f"--output-path={report}"]
        command += [f"--only-categories={','.join(CATEGORIES)}"]
        command += [f"--chrome-flags=--headless=new --no-sandbox {' '.join(WEBGL)}"]
        command += ["--preset=desktop"] if device == "desktop" else []
        subprocess.run(command, check=True, timeout=TIMEOUT_S, env={**os.environ, "CHROME_PATH": chromium})  # noqa: S603 - no input of others
        categories: dict[str, Any] = json.loads(report.read_text("utf-8"))["categories"]
    return {name: 100 * float(categories[name]["score"]) for name in CATEGORIES}


def first_results_s(url: str, rounds: int) -> list[float]:
    """Return the seconds from the choice of a photo that the service does not know until its object is drawn."""
    with sync_playwright() as playwright:
        browser = launched(playwright, "chromium")
        page = browser.new_page(viewport={"width": 1280, "height": 900}, reduced_motion="reduce")
        page.set_default_timeout(TIMEOUT_MS)
        times = [_first_result_s(page, url, number) for number in range(rounds)]
        browser.close()
    return times


def _first_result_s(page: Page, url: str, number: int) -> float:
    """Open the page anew, choose a photo, and wait for its object."""
    image = Image.open(photo("chair"))
    image.putpixel((0, 0), (number, 0, 0, 1))  # another photo for the service, the same object
    content = io.BytesIO()
    image.save(content, "PNG")
    page.goto("about:blank")
    page.goto(f"{url}/")
    page.wait_for_load_state("networkidle")
    page.evaluate(WATCH)
    with page.expect_file_chooser() as chooser:
        page.locator("#drop").click()  # as a visitor does; no time passes in the dialog
    chooser.value.set_files({"name": "chair.png", "mimeType": "image/png", "buffer": content.getvalue()})
    return float(page.evaluate("drawn")) / 1000


if __name__ == "__main__":
    main()
