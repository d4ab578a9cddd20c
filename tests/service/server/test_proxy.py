"""The service behind a real nginx, which offers it under a prefix: every address leads back through the proxy."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urljoin

import httpx
import pytest
from playwright.sync_api import Browser, Page

from service.formats.weights import Weights, dump
from service.mapping.spec import initial_theta
from tests.support.browsing import opened
from tests.support.photos import disc, image_file
from tests.support.processes import hof_serve
from tests.support.slow import DEADLINE_S, until
from tests.support.small.model import SPEC
from tests.support.systems.nginx import behind_nginx

PREFIX = "/tools/hof"
TRUSTED = ("--trusted-proxies=127.0.0.1", "--log-format=json", "--allowed-hosts=hof.example")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("proxy")


@pytest.fixture(scope="module")
def url(folder: Path, model_path: Path) -> Iterator[str]:
    with (
        hof_serve(folder, model_path, f"--root-path={PREFIX}", *TRUSTED) as (url, _),
        behind_nginx(url, PREFIX, folder) as proxied,
    ):
        yield proxied


def references(page: str) -> list[str]:
    """Return the addresses in a page or a script."""
    return ["".join(pair) for pair in re.findall(r'(?:src|href|data-schema)="([^"#]+)"|: "(\./[^"]+)"', page)]


@pytest.mark.parametrize("page", ["/", "/docs"])
def test_page_under_a_prefix_loads_its_files(url: str, page: str) -> None:
    answer = httpx.get(url + page)
    assert answer.status_code == 200
    addresses = [urljoin(url + page, reference) for reference in references(answer.text)]
    assert len(addresses) >= 5
    assert {address: httpx.get(address).status_code for address in addresses} == dict.fromkeys(addresses, 200)
    assert all(address.startswith(url) for address in addresses)


def test_location_and_links_under_a_prefix_lead_to_the_object(url: str) -> None:
    photo = httpx.post(f"{url}/encode", content=image_file(disc()), timeout=DEADLINE_S)
    other = httpx.post(f"{url}/encode", content=image_file(disc("blue")), timeout=DEADLINE_S)
    weights = dump(Weights(SPEC, initial_theta(SPEC), "m"), "safetensors")
    imported = httpx.post(f"{url}/objects", content=weights)
    ids = [photo.json()["id"], other.json()["id"]]
    composed = httpx.post(f"{url}/compose", json={"objects": ids})
    for answer in (photo, other, imported, composed):
        assert answer.status_code == 201
        assert httpx.get(urljoin(str(answer.url), answer.headers["location"])).json()["id"] == answer.json()["id"]
    listed = httpx.get(f"{url}/objects").json()["items"]
    one = httpx.get(f"{url}/objects/{ids[0]}").json()
    objects = [*(answer.json() for answer in (photo, other, imported, composed)), *listed, one]
    for item in objects:
        assert item["links"]["self"] == f"{PREFIX}/objects/{item['id']}"
        for link in item["links"].values():
            assert httpx.get(urljoin(url, link), timeout=DEADLINE_S).status_code == 200


def test_client_behind_the_proxy_is_the_one_that_the_proxy_names(url: str, folder: Path) -> None:
    forged = {"X-Forwarded-For": "6.6.6.6", "X-Request-ID": "forged"}
    assert httpx.get(f"{url}/model", headers=forged).status_code == 200
    lines = (folder / "log").read_text
    until(lambda: '"request_id": "forged"' in lines())
    entry = next(json.loads(line) for line in lines().splitlines() if '"request_id": "forged"' in line)
    assert entry["client"] == "6.6.6.6"  # nginx as configured here appends; 127.0.0.1 is a trusted proxy itself


def test_upgrade_that_the_proxy_passes_on_is_ignored(url: str) -> None:
    headers = {"Connection": "Upgrade, HTTP2-Settings", "Upgrade": "h2c", "HTTP2-Settings": "AAMAAABkAAQAoAAAAAIAAAAA"}
    assert httpx.post(f"{url}/encode", content=image_file(disc("green")), headers=headers).status_code == 201


def test_host_and_origin_behind_the_proxy_are_checked(url: str) -> None:
    for host, status in (("hof.example", 422), ("evil.example", 421)):
        answer = httpx.post(f"{url}/compose", json={}, headers={"Host": host, "Origin": f"https://{host}"})
        assert answer.status_code == status


def _draw_a_photo(page: Page, url: str, folder: Path) -> None:
    """Give the open page a photo, and wait until it has asked for the points of its object."""
    path = folder / "photo.png"
    path.write_bytes(image_file(disc("red")))
    with page.expect_response(lambda answer: "/points?" in answer.url) as points:
        page.locator("#file").set_input_files(path)
    assert points.value.url.startswith(f"{url}/objects/")


def _failures(page: Page) -> list[str]:
    """Return a list that gets the address of each answer that is an error."""
    failures: list[str] = []
    page.on("response", lambda answer: failures.append(answer.url) if answer.status >= 400 else None)
    return failures


def test_page_under_a_prefix_encodes_and_draws(browser: Browser, url: str, folder: Path) -> None:
    httpx.post(f"{url}/encode", content=image_file(disc("blue")), timeout=DEADLINE_S).raise_for_status()
    with browser.new_context() as context:
        page = opened(context.new_page(), url)
        failures = _failures(page)
        _draw_a_photo(page, url, folder)
        page.goto(f"{url}/docs")
        page.locator(".opblock").first.wait_for()
        assert page.locator(".servers option").first.get_attribute("value") == PREFIX
        assert failures == []


def test_page_under_a_prefix_without_the_setting_encodes_and_draws(
    browser: Browser, tmp_path: Path, model_path: Path
) -> None:
    with hof_serve(tmp_path, model_path) as (address, _), behind_nginx(address, PREFIX, tmp_path) as url:
        httpx.post(f"{url}/encode", content=image_file(disc("blue")), timeout=DEADLINE_S).raise_for_status()
        with browser.new_context() as context:
            page = opened(context.new_page(), url)
            failures = _failures(page)
            _draw_a_photo(page, url, tmp_path)
            assert failures == []
