"""Settings of a client's connections, for httpx."""

from typing import TypedDict

import httpx

from hof_client.version import __version__


class Connection(TypedDict):
    """Arguments of httpx's clients."""

    base_url: str
    headers: dict[str, str]
    timeout: httpx.Timeout


def connection_of(base_url: str, api_key: str | None, timeout_s: float | None, connect_timeout_s: float) -> Connection:
    """Return the settings. Raises ValueError for a URL without http:// or https://."""
    if not base_url.startswith(("http://", "https://")):
        raise ValueError(f"base_url is {base_url!r}: it must begin with http:// or https://")
    headers = {"User-Agent": f"hof-client/{__version__}", "Accept": "*/*"}
    if api_key:
        headers["Authorization"] = f"Bearer {api_key}"
    return Connection(base_url=base_url, headers=headers, timeout=httpx.Timeout(timeout_s, connect=connect_timeout_s))
