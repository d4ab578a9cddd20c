"""compose.yaml fits the specification, the service, its image and PostgreSQL. PgBouncer runs; Docker is not needed."""

import asyncio
import configparser
import re
import shlex
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import yaml
from compose_spec import PyCompose

from service.errors import UnusableStore
from service.settings import Settings
from service.storage.store import Store
from tests.project.documents import commands, text_of
from tests.support import ROOT
from tests.support.processes import free_port
from tests.support.systems.postgres import USER, Postgres, tool, unprivileged, wait_for_port

TEXT = (ROOT / "compose.yaml").read_text("utf-8")
SECRET = re.compile(r"\$\{(\w+):\?[^}]+\}")  # compose refuses to start without it
PASSWORD = "0123abcd" * 6  # as the documented command makes it
COMPOSE: dict[str, Any] = yaml.safe_load(SECRET.sub(PASSWORD, TEXT))
SERVICES: dict[str, dict[str, Any]] = COMPOSE["services"]
HOF, BOUNCER, POSTGRES = SERVICES["hof"], SERVICES["pgbouncer"], SERVICES["postgres"]
INI = configparser.ConfigParser()
INI.read(ROOT / "deploy" / "pgbouncer.ini", "utf-8")
POOL = INI["pgbouncer"]
DOCKERFILE = (ROOT / "Dockerfile").read_text("utf-8")
MANIFEST = yaml.safe_load((ROOT / "deploy" / "deployment.yaml").read_text("utf-8"))
POSTGRES_CONNECTIONS = 100 - 3  # max_connections less superuser_reserved_connections, by default


def test_compose_file_is_read_as_the_specification_has_it() -> None:
    assert sorted(PyCompose.from_yaml(TEXT).service_names()) == sorted(SERVICES)


NAMES = {*SERVICES, *COMPOSE["networks"]}
FIELDS = sorted(set(re.findall(r"^ +([a-z_]+):", TEXT, re.MULTILINE)) - NAMES)


@pytest.mark.parametrize("field", FIELDS)
def test_compose_file_with_a_misspelled_field_is_refused(field: str) -> None:
    text = re.sub(rf"^( +){field}:", rf"\1{field[:-1]}:", TEXT, flags=re.MULTILINE)
    with pytest.raises(ValueError, match=r"unknown|missing|extension key"):
        PyCompose.from_yaml(text)


def test_variables_of_the_service_are_settings() -> None:
    assert set(HOF["environment"]) <= {f"HOF_{name.upper()}" for name in Settings.model_fields}
    assert Settings(**{name.removeprefix("HOF_").lower(): value for name, value in HOF["environment"].items()})


def test_compose_file_holds_no_password() -> None:
    assert {match[1] for match in SECRET.finditer(TEXT)} == {"POSTGRES_PASSWORD"}
    values = re.findall(r"^ +\w*PASSWORD\w*: (.+)$", TEXT, re.MULTILINE)
    assert all(value.startswith("${") for value in values)
    assert "/.env\n" in (ROOT / ".gitignore").read_text("utf-8")
    (command,) = (line for line in commands(text_of("docs/operations.md")) if line.endswith("> .env"))
    script = command.replace("> .env", "")
    line = subprocess.run(["sh", "-c", script], check=True, capture_output=True, text=True).stdout
    assert re.fullmatch(r"POSTGRES_PASSWORD=[0-9a-f]{48}\n", line)  # nothing that a URL or a shell would change


def test_images_are_exact() -> None:
    assert re.fullmatch(r"postgres:\d+\.\d+-[a-z]+", POSTGRES["image"])
    stages = re.findall(r"^FROM (\S+)(?: AS (\w+))?$", DOCKERFILE, re.MULTILINE)
    assert all(re.search(r":[\d.]+-\S+@sha256:[0-9a-f]{64}$", image) for image, _ in stages)
    assert BOUNCER["build"]["target"] in {name for _, name in stages}
    assert stages[-1][1] == ""  # of the service: built without a target


@pytest.mark.parametrize("name", SERVICES)
def test_container_has_a_read_only_file_system_and_no_privileges(name: str) -> None:
    container = SERVICES[name]
    assert (container["read_only"], container["cap_drop"]) == (True, ["ALL"])
    assert container["security_opt"] == ["no-new-privileges:true"]
    assert {"mem_limit", "restart"} <= set(container)
    user = container.get("user") or re.findall(r"^USER (\d+)", DOCKERFILE, re.MULTILINE)[-1]
    assert int(user.split(":")[0]) > 0


@pytest.mark.parametrize("name", SERVICES)
def test_container_has_a_health_check_that_others_wait_for(name: str) -> None:
    assert "healthcheck" in SERVICES[name] or (name == "hof" and re.search(r"^HEALTHCHECK ", DOCKERFILE, re.MULTILINE))
    conditions = {need["condition"] for each in SERVICES.values() for need in each.get("depends_on", {}).values()}
    assert conditions == {"service_healthy"}


def test_database_is_reached_by_the_service_alone() -> None:
    assert COMPOSE["networks"]["database"] == {"internal": True}
    assert BOUNCER["networks"] == POSTGRES["networks"] == ["database"]
    assert [name for name, container in SERVICES.items() if "ports" in container] == ["hof"]
    (port,) = HOF["ports"]
    address, _, inner = port.rsplit(":", 2)
    assert (address, int(inner)) == ("127.0.0.1", Settings.model_fields["port"].default)


def test_url_of_the_service_leads_through_pgbouncer_to_postgresql() -> None:
    url = f"postgresql://{POSTGRES['environment']['POSTGRES_USER']}:{PASSWORD}@pgbouncer:{POOL['listen_port']}/hof"
    assert HOF["environment"]["HOF_DATABASE_URL"] == url
    target = dict(part.split("=") for part in INI["databases"]["hof"].split())
    assert target == {"host": "postgres", "port": "5432", "dbname": POSTGRES["environment"]["POSTGRES_DB"]}
    (mount,) = BOUNCER["volumes"]
    source, inside, mode = mount.split(":")
    assert ((ROOT / source).name, mode) == ("pgbouncer.ini", "ro")
    assert BOUNCER["command"][-1].endswith(f"exec pgbouncer {inside}")


def test_connections_fit_into_pgbouncer_and_postgresql() -> None:
    replicas = 1  # the port is of this machine
    assert "HOF_WORKERS" not in HOF["environment"]
    assert replicas * Settings.model_fields["database_connections"].default <= int(POOL["max_client_conn"])
    assert POOL["pool_mode"] == "transaction"
    assert int(POOL["default_pool_size"]) <= POSTGRES_CONNECTIONS


def test_bounds_are_those_of_the_manifests() -> None:
    pod = MANIFEST["spec"]["template"]["spec"]
    assert HOF["mem_limit"].upper() + "I" == pod["containers"][0]["resources"]["limits"]["memory"].upper()
    assert HOF["stop_grace_period"] == f"{pod['terminationGracePeriodSeconds']}s"


@contextmanager
def _bouncer(postgres: Postgres, database: str) -> Iterator[int]:
    """Run PgBouncer by compose.yaml's command and file; only places and ports differ. Yields its port."""
    port, folder = free_port(), postgres.folder / f"compose-{database}"
    folder.mkdir(mode=0o777)
    folder.chmod(0o777)
    text = (ROOT / "deploy" / "pgbouncer.ini").read_text("utf-8")
    changes: list[tuple[str, str]] = [
        (INI["databases"]["hof"], f"host=127.0.0.1 port={postgres.port} dbname={database}"),
        (f"listen_port = {POOL['listen_port']}", f"listen_port = {port}"),
        (POOL["auth_file"], str(folder / "users.txt")),
    ]
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "hof.ini").write_text(text)
    program, option, script = BOUNCER["command"]
    script = script.replace("$$", "$").replace(POOL["auth_file"], str(folder / "users.txt"))
    script = script.replace("/etc/pgbouncer", str(folder)).replace("exec pgbouncer", f"exec {tool('pgbouncer')} -q")
    environment = {"POSTGRES_PASSWORD": PASSWORD, "PATH": "/usr/bin:/bin"}
    with subprocess.Popen([*unprivileged(), program, option, script], env=environment) as process:
        try:
            wait_for_port(port, process)
            yield port
        finally:
            process.terminate()


@pytest.mark.system
def test_pgbouncer_with_the_file_lets_the_service_in_by_password_alone(postgres: Postgres) -> None:
    database = postgres.create().rpartition("/")[2]
    postgres.run(f"CREATE ROLE hof LOGIN PASSWORD '{PASSWORD}'", database)
    postgres.run(f"ALTER DATABASE {database} OWNER TO hof", database)

    async def count(password: str) -> int:
        store = await Store.open(f"postgresql://hof:{password}@127.0.0.1:{port}/hof", connections=2)
        try:
            return await store.count()
        finally:
            await store.close()

    try:
        with _bouncer(postgres, database) as port:
            assert asyncio.run(count(PASSWORD)) == 0
            with pytest.raises(UnusableStore, match="SASL authentication failed"):
                asyncio.run(count("wrong"))
    finally:
        postgres.run(f"ALTER DATABASE {database} OWNER TO {USER}; DROP OWNED BY hof CASCADE; DROP ROLE hof", database)


def test_health_check_of_pgbouncer_tells_whether_its_port_is_open() -> None:
    kind, program, *arguments = BOUNCER["healthcheck"]["test"]
    assert (kind, program, shlex.join(arguments).count(str(POOL["listen_port"]))) == ("CMD", "python", 1)
    compile(arguments[-1], "health check", "exec")
