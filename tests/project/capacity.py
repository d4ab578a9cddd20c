"""Compute the needs in docs/capacity.md from measured figures; `python -m tests.project.quoted_figures` writes them."""

import re
from math import ceil
from typing import Final, NamedTuple

from service.mapping.spec import HOF_1, MappingSpec
from tests.project.documents import rows, section, text_of

DOCUMENT: Final = "docs/capacity.md"
COSTS: Final = "Processor time of a call"
NEEDS: Final = "What it takes"
REPORT: Final = "benchmarks/REPLICAS.md"
THROUGHPUT: Final = "Throughput of 1, 2, 4 replicas on 2 cores"
ENCODE: Final = "`POST /encode`, new photos of 512 x 512"
CLOUD: Final = "`GET /objects/{id}/points`, n = 10,000"

# The assumptions, in the document's words.
USERS: Final = (1_000_000, 10_000_000, 100_000_000)  # a day
PHOTOS_EACH, PHOTO_BYTES = 1, 300_000
CLOUDS_EACH, CLOUD_POINTS, POINT_BYTES = 3, 10_000, 15  # x, y, z and a color
PEAK: Final = 3  # times the mean of the day
LOAD_FACTOR: Final = 0.6  # of a core, so that queues stay short
POD_CORES, POD_GIB = 2, 2  # deploy/deployment.yaml: the limits of a pod
CONNECTIONS_EACH: Final = 5  # of a pod: HOF_DATABASE_CONNECTIONS in deploy/
COLOR: Final = MappingSpec("HOF-C", 3, (256,), 3)  # the shipped models' colors
ROW_BYTES: Final = 1_000  # of an object beside its functions: about
KEPT_DAYS: Final = 30
DAY_S: Final = 86_400


class Cost(NamedTuple):
    """Processor time of a call to one replica, in milliseconds: of the service and of PostgreSQL."""

    service_ms: float
    database_ms: float


def costs() -> dict[str, Cost]:
    """Return the cost of each call that REPLICAS.md measures."""
    table = rows(section(text_of(REPORT), THROUGHPUT))
    return {call: Cost(float(row[3]), float(row[4])) for call, *row in table if row[0] == "1"}


def cost_rows() -> list[str]:
    """Return the rows of the table of costs."""
    return [f"| {call} | {cost.service_ms:.1f} | {cost.database_ms:.1f} |" for call, cost in costs().items()]


def need_rows() -> list[str]:
    """Return the rows of the table of needs: a name, and a value for each number of users."""
    columns = [_needs(users) for users in USERS]
    return [f"| {name} | {' | '.join(column[name] for column in columns)} |" for name in columns[0]]


def _needs(users: int) -> dict[str, str]:
    object_bytes = 4 * (HOF_1.size + COLOR.size) + ROW_BYTES
    photos_s = PEAK * users * PHOTOS_EACH / DAY_S
    clouds_s = PEAK * users * CLOUDS_EACH / DAY_S
    photo, cloud = costs()[ENCODE], costs()[CLOUD]
    photo_cores = photos_s * photo.service_ms / 1000 / LOAD_FACTOR
    cloud_cores = clouds_s * cloud.service_ms / 1000 / LOAD_FACTOR
    database_cores = (photos_s * photo.database_ms + clouds_s * cloud.database_ms) / 1000 / LOAD_FACTOR
    pods = max(2, ceil((photo_cores + cloud_cores) / POD_CORES))
    growth = users * PHOTOS_EACH * object_bytes
    return {
        "new photos a second, at the peak": f"{photos_s:,.0f}",
        "clouds a second, at the peak": f"{clouds_s:,.0f}",
        "cores for photos": f"{photo_cores:,.1f}",
        "cores for clouds": f"{cloud_cores:,.1f}",
        f"pods of {POD_CORES} cores, at least 2": f"{pods:,}",
        "memory that the pods may take, GiB": f"{pods * POD_GIB:,}",
        "connections to PostgreSQL": f"{pods * CONNECTIONS_EACH:,}",
        "database: cores": f"{database_cores:,.1f}",
        "database: rows written a second, at the peak": f"{photos_s:,.0f}",
        "database: MB read a second, at the peak": f"{clouds_s * object_bytes / 1e6:,.0f}",
        "database: GB more each day": f"{growth / 1e9:,.0f}",
        f"database: TB after {KEPT_DAYS} days": f"{KEPT_DAYS * growth / 1e12:,.1f}",
        "network in: Mbit/s, at the peak": f"{8 * photos_s * PHOTO_BYTES / 1e6:,.0f}",
        "network out: Mbit/s, at the peak": f"{8 * clouds_s * CLOUD_POINTS * POINT_BYTES / 1e6:,.0f}",
    }


def updated(text: str) -> str:
    """Return the document with the rows that the figures give."""
    for heading, lines in ((COSTS, cost_rows()), (NEEDS, need_rows())):
        old = section(text, heading)
        before, separator, rest = re.split(r"(^(?:\|-+)+\|\n)", old, maxsplit=1, flags=re.MULTILINE)
        after = re.sub(r"\A(\|.*\n)*", "", rest)
        text = text.replace(old, before + separator + "".join(f"{line}\n" for line in lines) + after)
    return text
