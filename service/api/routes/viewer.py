"""The page at /, an object alone at /embed, and the API's documentation at /docs.

They are static files that load nothing from other origins. Their libraries, three.js and Swagger UI, are put into
service/viewer/static/bundle when the package is built.
"""

import base64
import gzip
import hashlib
import mimetypes
import re
from functools import lru_cache
from pathlib import Path
from typing import Final

from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import NotModifiedResponse, StaticFiles
from starlette.types import Scope

from service.api.wire.caching import accepts_gzip
from service.errors import NotFound

STATIC: Final = Path(__file__).resolve().parents[2] / "viewer" / "static"
BUNDLE: Final = STATIC / "bundle"
EMBED: Final = "embed.html"
TEXTS: Final = (".html", ".css", ".js", ".svg")  # compressed at first use, unless the package was built with a .gz
UNFRAMED: Final = "frame-ancestors 'none'"
NOT_BUILT: Final = (
    "this page was left out when the service was installed, because npm was missing: install Node.js, then install the "
    "service again (`make clean serve`, or `pip install .`)"
)


def content_security_policy(page: str) -> str:
    """Return the Content-Security-Policy of an HTML page: its own origin, and its import map as the only inline script.

    Import maps must be inline (HTML standard, section 8.1.5.3), so the policy names the map by its digest.
    """
    maps = re.findall(r'<script type="importmap">(.*?)</script>', page, re.DOTALL)
    digests = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode("ascii") for text in maps]
    scripts = " ".join(["'self'", *(f"'sha256-{digest}'" for digest in digests)])
    return (
        f"default-src 'none'; script-src {scripts}; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; "
        f"base-uri 'none'; form-action 'self'; {UNFRAMED}"
    )


class Pages(StaticFiles):
    """Static files that browsers cache but revalidate each time (ETag, 304); pages load nothing from other origins.

    Texts are sent compressed. The bundle's were compressed when the package was built (setup.py), the page's own
    are compressed once in each process, at first use.
    """

    async def get_response(self, path: str, scope: Scope) -> Response:
        """Return the answer for a file. Raises Starlette's 404 and 405."""
        response = await self._compressed(path, scope) or await super().get_response(path, scope)
        response.headers["Cache-Control"] = "no-cache"
        if path.endswith(".webp"):  # a type that mimetypes knows from Python 3.13 on
            response.headers["Content-Type"] = "image/webp"
        if path.endswith(".html"):
            response.headers["Content-Security-Policy"] = content_security_policy((STATIC / path).read_text("utf-8"))
        if path.endswith(TEXTS):
            response.headers["Vary"] = "Accept-Encoding"
        return response

    async def _compressed(self, path: str, scope: Scope) -> Response | None:
        """Return the answer with the compressed text, if the file is one and the browser accepts gzip."""
        if not path.endswith(TEXTS) or not accepts_gzip(Headers(scope=scope).get("accept-encoding")):
            return None
        if f"{path}.gz" in _compressed_files():
            response = await super().get_response(f"{path}.gz", scope)
            if response.status_code == 200:
                response.headers["Content-Type"] = f"{mimetypes.guess_type(path)[0]}; charset=utf-8"
        else:
            response = self._compressed_now(await super().get_response(path, scope), scope)
        if response.status_code == 200:
            response.headers["Content-Encoding"] = "gzip"
        return response

    def _compressed_now(self, plain: Response, scope: Scope) -> Response:
        """Return the answer with the text of a plain answer, compressed; what is no file stays as it is."""
        if not isinstance(plain, FileResponse):
            return plain
        content, tag = _gzip(Path(plain.path), plain.headers["last-modified"])
        response = Response(content, headers={"ETag": tag}, media_type=plain.media_type)
        fresh = self.is_not_modified(response.headers, Headers(scope=scope))
        return NotModifiedResponse(response.headers) if fresh else response


@lru_cache(256)
def _gzip(path: Path, modified: str) -> tuple[bytes, str]:
    """Compress a file: its bytes, and an ETag that tells them from those of the file itself."""
    content = gzip.compress(path.read_bytes(), mtime=0)
    return content, f'"{hashlib.sha256(content).hexdigest()[:32]}"'


@lru_cache(1)
def _compressed_files() -> frozenset[str]:
    """Return the paths of the compressed files, relative to STATIC. They do not change while the service runs."""
    return frozenset(path.relative_to(STATIC).as_posix() for path in BUNDLE.rglob("*.gz"))


_pages: Final = Pages(directory=STATIC)


async def _viewer(request: Request) -> Response:
    return await _page("index.html", request)


async def _embed(request: Request) -> Response:
    response = await _page(EMBED, request)
    origins = request.app.state.settings.embed_origins
    if origins:
        policy = response.headers["Content-Security-Policy"]
        allowed = f"frame-ancestors {origins.replace(',', ' ')}"
        response.headers["Content-Security-Policy"] = policy.replace(UNFRAMED, allowed)
    return response


async def _docs(request: Request) -> Response:
    return await _page("docs.html", request)


async def _page(name: str, request: Request) -> Response:
    if not BUNDLE.is_dir():
        raise NotFound(NOT_BUILT)
    return await _pages.get_response(name, request.scope)


routes: Final[list[BaseRoute]] = [
    Route("/", _viewer),
    Route("/docs", _docs),
    Route("/embed", _embed),
    Mount("/viewer", _pages),
]
