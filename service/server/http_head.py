"""Rules for the head of an HTTP/1.1 request that the parser does not enforce (RFC 9110 and RFC 9112)."""

import re
from collections.abc import Sequence
from typing import Final
from urllib.parse import urlsplit

from service.errors import InvalidInput, UnsupportedVersion

Field = tuple[bytes, bytes]  # name, value

VERSIONS: Final = ("1.0", "1.1")
HOST: Final = re.compile(rb"([A-Za-z0-9._~!$&'()*+,;=%-]+|\[[0-9A-Fa-f:.]+\])(:[0-9]*)?")


def check_version(version: str, method: bytes) -> None:
    """Raise UnsupportedVersion for another version than 1.0 and 1.1, InvalidInput for CONNECT."""
    if version not in VERSIONS:
        raise UnsupportedVersion(f"HTTP/{version} is not supported on this connection, use HTTP/1.1")
    if method == b"CONNECT":
        raise InvalidInput("CONNECT is not supported: this service is no proxy")


def check_framing(version: str, fields: Sequence[Field]) -> None:
    """Raise InvalidInput for a body of HTTP/1.0 in chunks, which that version does not have (RFC 9112, section 6.1)."""
    if version == "1.0" and any(name == b"transfer-encoding" for name, _ in fields):
        raise InvalidInput("HTTP/1.0 has no Transfer-Encoding: send Content-Length, or use HTTP/1.1")


def check_host(version: str, target: bytes, fields: list[Field]) -> None:
    """Check the Host field, and replace it by the host in the target if that has one (RFC 9112, section 3.2).

    Raises
    ------
    InvalidInput : HTTP/1.1 without Host; more than one Host; a Host that is no name or address with an optional port.
    """
    hosts = [value for name, value in fields if name == b"host"]
    if len(hosts) > 1:
        raise InvalidInput(f"the request has {len(hosts)} Host fields, it must have one")
    if not hosts and version != "1.0":
        raise InvalidInput("the request has no Host field, it must have one")
    if not target.startswith((b"/", b"*")):
        authority = urlsplit(target).netloc
        fields[:] = [(b"host", authority), *(field for field in fields if field[0] != b"host")]
        hosts.append(authority)
    if not all(HOST.fullmatch(host) for host in hosts):
        raise InvalidInput("the Host field is not a host with an optional port")


def combine(fields: list[Field]) -> None:
    """Combine fields of the same name into one, in order, as a list (RFC 9110, section 5.3).

    Readers of a single value, such as Authorization, then see an invalid value instead of silently the first one.
    """
    if len({name for name, _ in fields}) == len(fields):
        return
    values: dict[bytes, list[bytes]] = {}
    for name, value in fields:
        values.setdefault(name, []).append(value)
    fields[:] = [(name, b", ".join(parts)) for name, parts in values.items()]


def without_upgrade(method: bytes, target: bytes, version: str, fields: Sequence[Field]) -> bytes:
    """Return a request's head without its wish to change the protocol, which a server may ignore (RFC 9110, 7.8)."""
    lines = [b"%b %b HTTP/%b" % (method, target, version.encode("ascii"))]
    for name, value in fields:
        if name == b"connection":
            value = b",".join(option for option in value.split(b",") if option.strip().lower() != b"upgrade")
        if name != b"upgrade":
            lines.append(b"%b: %b" % (name, value))
    return b"\r\n".join(lines) + b"\r\n\r\n"
