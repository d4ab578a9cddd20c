"""What browsers are told by every answer, and CORS, which is off unless it is set."""

import httpx
import pytest

from service.api.middleware.security_headers import SECURE
from service.settings import Settings
from tests.support.server import running

SHOP = "https://shop.example"


@pytest.mark.parametrize("path", ["/objects", "/objects/x", "/nope", "/health/live", "/openapi.json", "/metrics"])
def test_every_answer_is_safe_in_a_browser(client: httpx.Client, path: str) -> None:
    headers = client.get(path).headers
    assert {name: headers.get(name) for name in SECURE} == SECURE


def test_pages_keep_their_own_policies(client: httpx.Client) -> None:
    headers = client.get("/").headers
    assert "script-src 'self'" in headers["content-security-policy"]
    assert headers.get_list("content-security-policy") == [headers["content-security-policy"]]
    assert headers["referrer-policy"] == "no-referrer"


def test_cors_is_off_by_default(client: httpx.Client) -> None:
    answer = client.get("/objects", headers={"Origin": SHOP})
    assert not [name for name in answer.headers if name.startswith("access-control")]


def test_cors_lets_the_named_origins_in_and_no_other(settings: Settings) -> None:
    given = settings.model_copy(update={"cors_origins": f"http://a.example:8000,{SHOP}"})
    with running(given) as server, httpx.Client(base_url=f"http://127.0.0.1:{server.port}") as client:
        for path, status in (("/objects", 200), ("/objects/x", 404)):
            answer = client.get(path, headers={"Origin": SHOP})
            assert (answer.status_code, answer.headers["access-control-allow-origin"]) == (status, SHOP)
            assert "X-Request-ID" in answer.headers["access-control-expose-headers"]
        asked = {
            "Access-Control-Request-Method": "POST",
            "Access-Control-Request-Headers": "authorization,content-type",
        }
        assert client.options("/encode", headers={"Origin": SHOP, **asked}).status_code == 200
        other = client.options("/encode", headers={"Origin": "https://other.example", **asked})
        assert (other.status_code, "access-control-allow-origin" in other.headers) == (400, False)
