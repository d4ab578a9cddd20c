"""URLs of PostgreSQL as hosts hand them out: all are read, and none shows its password."""

import asyncio
from typing import Any

import pytest

from service.errors import UnusableStore
from service.storage.database import connect, parse
from service.storage.postgres_url import PostgresUrl, parse_postgres
from tests.support.systems.postgres import Postgres, running_postgres

SECRET = "s3cret"


def _arguments(url: str) -> dict[str, Any]:
    return parse_postgres(url).arguments


@pytest.mark.parametrize(
    ("url", "expected"),
    [
        ("postgres://u:p@h/d", {"user": "u", "password": "p", "host": ["h"], "port": [5432], "database": "d"}),
        ("postgresql+psycopg2://u@h:6000/d", {"user": "u", "host": ["h"], "port": [6000], "database": "d"}),
        ("postgresql://", {}),
        ("postgresql:///d", {"database": "d"}),
        ("postgresql://u:a:b/c#d@e%3F@h/d", {"password": "a:b/c#d@e?", "user": "u"}),
        ("postgresql://u%40x:100%@h/d", {"user": "u@x", "password": "100%"}),
        ("postgresql://h1:1,h2/d", {"host": ["h1", "h2"], "port": [1, 5432]}),
        ("postgresql://[::1]:6000/d", {"host": ["::1"], "port": [6000]}),
        ("postgresql:///d?host=/run/postgresql", {"host": ["/run/postgresql"], "port": [5432]}),
        ("postgresql://%2Frun%2Fpostgresql:6000/d", {"host": ["/run/postgresql"], "port": [6000]}),
        ("postgresql://u:p@/d?host=/cloudsql/a:b:c", {"host": ["/cloudsql/a:b:c"]}),
        ("postgresql:///d?host=a&host=b&port=1,2", {"host": ["a", "b"], "port": [1, 2]}),
        ("postgresql:///d?user=u&password=p&dbname=e", {"user": "u", "password": "p", "database": "e"}),
        ("postgresql://h/d?sslmode=require&channel_binding=require", {"dsn": "postgresql://?sslmode=require"}),
        ("postgresql://h/d?ssl=true", {"dsn": "postgresql://?sslmode=require"}),
        ("postgresql://h/d?application_name=a%20b", {"dsn": "postgresql://?application_name=a+b"}),
        ("postgresql://h/d?pgbouncer=true&connection_limit=1", {"host": ["h"]}),
    ],
)
def test_parse_postgres_of_a_hosts_url_returns_the_drivers_arguments(url: str, expected: dict[str, Any]) -> None:
    arguments = _arguments(url)
    assert {name: arguments.get(name) for name in expected} == expected
    if "dsn" not in expected and "," not in url and "&host" not in url:
        assert "dsn" not in arguments


def test_parse_postgres_of_several_hosts_wants_the_one_that_accepts_writes() -> None:
    assert _arguments("postgresql://a,b/d")["dsn"] == "postgresql://?target_session_attrs=read-write"
    assert _arguments("postgresql://a,b/d?target_session_attrs=any")["dsn"] == "postgresql://?target_session_attrs=any"


def test_parse_postgres_reads_the_limit_of_a_connection() -> None:
    assert parse_postgres("postgresql://h/d?connect_timeout=3").connect_timeout_s == 3
    assert parse_postgres("postgresql://h/d?connect_timeout=0").connect_timeout_s is None


@pytest.mark.parametrize(
    "url",
    [
        f"postgres://u:{SECRET}",
        f"postgres://u:{SECRET}?x@h/d",
        f"postgres://u:{SECRET}@h:70000/d",
        f"postgres://u:{SECRET}@h:port/d",
        f"postgres://u:{SECRET}@a,b:1,/d",
        f"postgres://u:{SECRET}@h/d?port=1,2",
        f"postgres://u:{SECRET}@h/d?connect_timeout={SECRET}",
        f"postgres://u:{SECRET}@h/d?sslrootcert=/none",
        f"postgres://u:{SECRET}@h/d?sslmode=sometimes",
        f"postgres://u:{SECRET}@127.0.0.1:1/d",
        f"postgres://127.0.0.1:1/d?password={SECRET}",
        f"mysql://u:{SECRET}@h/d",
        f"u:{SECRET}@h/d",
    ],
)
def test_connect_with_an_unusable_url_is_one_sentence_without_the_password(url: str) -> None:
    with pytest.raises(UnusableStore, match="database") as caught:
        asyncio.run(connect(url))
    assert SECRET not in caught.value.detail
    assert "\n" not in caught.value.detail


def test_parsed_url_in_a_traceback_hides_its_password() -> None:
    url = f"postgres://u:{SECRET}@h/d?sslpassword={SECRET}"
    address = parse(url)
    assert isinstance(address.target, PostgresUrl)
    assert address.secrets == (SECRET, SECRET)
    assert SECRET not in repr(address) + address.shown


def test_connect_with_hosts_urls_reaches_a_real_server() -> None:
    async def open_and_close(url: str) -> None:
        database = await connect(url, timeout_s=60)
        assert await database.run(lambda connection: connection.exec_driver_sql("SELECT 1").scalar()) == 1
        await database.close()

    def urls(postgres: Postgres) -> list[str]:
        plain = postgres.create()
        name, port = plain.rpartition("/")[2], postgres.port
        return [
            plain.replace("postgresql://", "postgres://"),
            plain.replace("postgres@", "postgres:a:b/c@d@"),
            f"{plain}?sslmode=disable&channel_binding=prefer&application_name=x&connect_timeout=9",
            f"{plain}?sslmode=prefer&options=-c%20lock_timeout%3D9s&gssencmode=disable",
            f"postgresql://postgres@127.0.0.1:1,127.0.0.1:{port}/{name}",
            f"postgresql://postgres@/{name}?host={postgres.folder}&port={port}",
            f"postgresql://postgres@{str(postgres.folder).replace('/', '%2F')}:{port}/{name}",
        ]

    with running_postgres() as postgres:
        for url in urls(postgres):
            asyncio.run(open_and_close(url))
