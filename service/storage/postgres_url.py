"""PostgreSQL URLs as hosts hand them out, and what the driver (asyncpg) needs of them.

The driver refuses some URLs that PostgreSQL's own library reads, and shows parts of others in its messages; so they are
read here.
"""

import re
import ssl
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final
from urllib.parse import parse_qsl, unquote, urlencode

from service.errors import UnusableStore

DEFAULT_PORT: Final = 5432
MAX_PORT: Final = 65_535
HOST: Final = re.compile(r"(\[[^\]]*\]|/.*?|[^:]*)(?::(\d+))?")  # an address in brackets, a socket's folder, a name
FILES: Final = ("sslcert", "sslkey", "sslrootcert", "sslcrl")
SSL_SWITCH: Final = {"true": "require", "1": "require", "false": "disable", "0": "disable"}
# What the driver has no counterpart for, and what other programs put into their URLs.
IGNORED: Final = {
    "channel_binding",
    "connection_limit",
    "gssencmode",
    "keepalives",
    "keepalives_count",
    "keepalives_idle",
    "keepalives_interval",
    "load_balance_hosts",
    "pgbouncer",
    "pool_timeout",
    "prepared_statement_cache_size",
    "sslcertmode",
    "sslcompression",
    "sslsni",
    "statement_cache_size",
    "tcp_user_timeout",
}


@dataclass(frozen=True)
class PostgresUrl:
    """A PostgreSQL URL.

    Attributes
    ----------
    arguments : those of `asyncpg.connect`.
    shown : the URL without its password and parameters.
    secrets : texts that no message may contain.
    connect_timeout_s : the URL's own limit for a connection, if it has one.
    """

    arguments: dict[str, Any] = field(repr=False)
    shown: str
    secrets: tuple[str, ...] = field(repr=False, default=())
    connect_timeout_s: float | None = None


def parse_postgres(url: str) -> PostgresUrl:
    """Read `postgresql://USER:PASSWORD@HOST:PORT,HOST:PORT/NAME?PARAMETERS`; every part may be missing.

    Raises
    ------
    UnusableStore : the URL cannot be read. The message names the part, and never shows it.
    """
    location, _, query = url.partition("://")[2].partition("?")
    login, _, location = location.rpartition("@")
    hosts, _, database = location.partition("/")
    user, _, password = login.partition(":")
    parameters = _parameters(query)
    user = parameters.pop("user", unquote(user))
    password = parameters.pop("password", unquote(password))
    database = parameters.pop("dbname", parameters.pop("database", unquote(database)))
    hosts = parameters.pop("host", parameters.pop("hostaddr", unquote(hosts)))
    connect_timeout_s = _seconds(parameters.pop("connect_timeout", "0"))
    addresses = _addresses(hosts, parameters.pop("port", ""))
    arguments: dict[str, Any] = {"user": user, "password": password, "database": database}
    if hosts:
        arguments |= {"host": [host for host, _ in addresses], "port": [port for _, port in addresses]}
    elif addresses[0][1] != DEFAULT_PORT:
        arguments["port"] = addresses[0][1]
    if len(addresses) > 1:
        parameters.setdefault("target_session_attrs", "read-write")
    if parameters.get("sslrootcert") == "system":
        del parameters["sslrootcert"]
        arguments["ssl"] = ssl.create_default_context()
    _check_files(parameters)
    if parameters:
        arguments["dsn"] = f"postgresql://?{urlencode(parameters)}"
    shown = f"postgresql://{user}{':***' if password else ''}{'@' if user else ''}{hosts}/{database}"
    secrets = tuple(text for text in (password, parameters.get("sslpassword", "")) if text)
    arguments = {name: value for name, value in arguments.items() if value}
    return PostgresUrl(arguments, shown, secrets, connect_timeout_s)


def _parameters(query: str) -> dict[str, str]:
    """Return the parameters that count. A host may be named several times."""
    parameters: dict[str, str] = {}
    for name, value in parse_qsl(query, keep_blank_values=True):
        if name == "host" and name in parameters:
            parameters[name] += f",{value}"
        elif value and name not in IGNORED:
            parameters[name] = value
    if switch := parameters.pop("ssl", ""):
        parameters.setdefault("sslmode", SSL_SWITCH.get(switch.lower(), switch))
    if name := parameters.pop("fallback_application_name", ""):
        parameters.setdefault("application_name", name)
    return parameters


def _addresses(hosts: str, ports: str) -> list[tuple[str, int]]:
    """Return hosts and their ports. A single port of the parameters counts for all hosts without one."""
    texts = hosts.split(",")
    defaults = ports.split(",")
    if len(defaults) == 1:
        defaults *= len(texts)
    matches = [HOST.fullmatch(text) for text in texts]
    if len(defaults) != len(texts) or not all(matches) or (len(texts) > 1 and not all(texts)):
        raise _unreadable("its hosts and ports")
    pairs = [(match[1].strip("[]"), match[2] or port) for match, port in zip(matches, defaults, strict=True) if match]
    return [(host, _port(port)) for host, port in pairs]


def _port(text: str) -> int:
    if not text:
        return DEFAULT_PORT
    if not text.isdecimal() or not 1 <= int(text) <= MAX_PORT:
        raise _unreadable("a port, which is a number up to 65535")
    return int(text)


def _seconds(text: str) -> float | None:
    try:
        seconds = float(text)
    except ValueError as error:
        raise _unreadable("connect_timeout, which is a number of seconds") from error
    return seconds if seconds > 0 else None


def _check_files(parameters: dict[str, str]) -> None:
    for name in FILES:
        if name in parameters and not Path(parameters[name]).is_file():
            raise UnusableStore(f"invalid database URL: {name} names the file {parameters[name]}, which does not exist")


def _unreadable(part: str) -> UnusableStore:
    return UnusableStore(
        f"invalid database URL: cannot read {part}; expected postgresql://USER:PASSWORD@HOST:PORT/NAME, with special "
        "characters of the password percent-encoded (%40 for @)"
    )
