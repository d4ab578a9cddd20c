"""Security headers of every answer, and CORS, which is off by default."""

import httpx
import pytest

from service.api.middleware.security_headers import SECURE
from service.settings import Settings
from tests.support.server import running

SHOP = "https://shop.example"


@pytest.mark.parametrize("path", ["/objects", "/objects/x", "/nope", "/health/live", "/openapi.json", "/metrics"])
def test_security_headers_are_on_every_answer(client: httpx.Client, path: str) -> None:
    headers = client.get(path).headers
    assert {name: headers.get(name) for name in SECURE} == SECURE


def test_security_headers_of_pages_keep_their_own_policies(client: httpx.Client) -> None:
    headers = client.get("/").headers
    assert "script-src 'self'" in headers["content-security-policy"]
    assert headers.get_list("content-security-policy") == [headers["content-security-policy"]]
    assert headers["referrer-policy"] == "no-referrer"


def test_cors_by_default_is_off(client: httpx.Client) -> None:
    answer = client.get("/objects", headers={"Origin": SHOP})
    assert not [name for name in answer.headers if name.startswith("access-control")]


def test_cors_with_named_origins_allows_no_other(settings: Settings) -> None:
    changed = settings.model_copy(update={"cors_origins": f"http://a.example:8000,{SHOP}"})
    with running(changed) as server, httpx.Client(base_url=f"http://127.0.0.1:{server.port}") as client:
        for path, status in (("/objects", 200), ("/objects/x", 404)):
            answer = client.get(path, headers={"Origin": SHOP})
            assert (answer.status_code, answer.headers["access-control-allow-origin"]) == (status, SHOP)
            assert "X-Request-ID" in answer.headers["access-control-expose-headers"]
        headers = {
            "Access-Control-Request-Method": "POST",
            "Access-Control-Request-Headers": "authorization,content-type",
        }
        assert client.options("/encode", headers={"Origin": SHOP, **headers}).status_code == 200
        other = client.options("/encode", headers={"Origin": "https://other.example", **headers})
        assert (other.status_code, "access-control-allow-origin" in other.headers) == (400, False)
