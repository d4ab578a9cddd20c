"""Four processes on one database, of which one is killed now and then: no write is lost or done twice."""

import asyncio
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from service.settings import Settings
from tests.support.photos import disc, image_file
from tests.support.server import Server
from tests.support.systems.fleets import running_replicas, running_workers
from tests.support.systems.owners import Held, Owner, Report, check_database, check_list
from tests.support.systems.postgres import Postgres
from tests.support.systems.turmoil import Turmoil, turmoil

pytestmark = pytest.mark.system

PROCESSES = 4
OPERATIONS = 400
KILLS = 2


def _photos(number: int) -> Iterator[bytes]:
    """Yield photos of which no two are alike."""
    return (image_file(disc(size=(90 + number, 60 + index))) for index in itertools.count())


async def _faults(settings: Settings, urls: Sequence[str], *owners: Owner) -> list[str]:
    """Return what the last comparison finds."""
    report = Report()
    await check_list(urls, owners, report)
    await check_database(settings.database_url, owners, report)
    return report.faults


def test_checks_with_lost_doubled_and_changed_objects_name_them(server: Server, settings: Settings) -> None:
    url = f"http://127.0.0.1:{server.port}"
    report = Report()
    owner = Owner(0, [url], _photos(0), report)
    asyncio.run(owner.work(lambda: len(owner.objects) == 8))
    assert report.faults == []
    assert asyncio.run(_faults(settings, [url], owner)) == []
    held = dict(owner.objects)
    labeled, forgotten = list(held)[:2]
    owner.objects = held | {"0" * 32: Held(), labeled: Held(label="other")}
    del owner.objects[forgotten]
    faults = "\n".join(asyncio.run(_faults(settings, [url], owner)))
    for text in (
        f"lost: ['{'0' * 32}']",
        f"doubled, or back after a deletion: ['{forgotten}']",
        f"{labeled} is Held(",
        f"{forgotten} is in the database, and no client holds it",
        f"the database lacks ['{'0' * 32}']",
    ):
        assert text in faults


def _check(result: Turmoil) -> None:
    report = result.report
    assert report.faults == []
    assert report.server_errors == 0
    assert report.operations >= OPERATIONS
    assert result.kills >= KILLS  # whether a client is being answered just then is chance
    assert result.objects > PROCESSES


def test_replicas_on_postgresql_behind_pgbouncer_that_are_killed_lose_and_double_nothing(
    postgres: Postgres, tmp_path: Path, model_path: Path
) -> None:
    url = postgres.create()
    with postgres.bouncer(url) as pooled, running_replicas(PROCESSES, tmp_path, model_path, pooled) as fleet:
        _check(turmoil(fleet, url, OPERATIONS, KILLS, _photos))


def test_workers_on_sqlite_that_are_killed_lose_and_double_nothing(tmp_path: Path, model_path: Path) -> None:
    with running_workers(PROCESSES, tmp_path, model_path) as fleet:
        _check(turmoil(fleet, f"sqlite:///{tmp_path / 'hof.db'}", OPERATIONS, KILLS, _photos))
