"""Compute the needs in docs/capacity.md from measured figures; `python -m tests.project.quoted_figures` writes them."""

from typing import Final

from service.mapping.spec import HOF_1, MappingSpec
from tests.project.documents import section
from tests.project.quoted_figures import Quote, measured_rows

DOCUMENT: Final = "docs/capacity.md"
NEEDS: Final = "What it takes"
PHOTOS: Final = Quote(DOCUMENT, "Photos", "LOAD.md", "POST /encode beside others")
POINTS: Final = Quote(DOCUMENT, "Points", "RESULTS.md", "HOF-1, k = 2: Mpoints/s, one core")
HTTP: Final = Quote(DOCUMENT, "Points", "RESULTS.md", None)
SHARE_OF_SAMPLER: Final = "HTTP, 1 M points as PLY: share of the bare sampler"

# The assumptions, in the document's words.
USERS: Final = (1_000_000, 10_000_000, 100_000_000)  # a day
PHOTOS_EACH, PHOTO_BYTES = 1, 300_000
CLOUDS_EACH, CLOUD_POINTS, POINT_BYTES = 3, 10_000, 12
PEAK: Final = 3  # times the mean of the day
LOAD_FACTOR: Final = 0.6  # of a core, so that queues stay short
POD_CORES: Final = 2  # deploy/deployment.yaml: the limit of a pod
CONNECTIONS_EACH: Final = 5  # of a pod: HOF_DATABASE_CONNECTIONS in deploy/
COLOR: Final = MappingSpec("HOF-C", 3, (256,), 3)  # the shipped models' colors
ROW_BYTES: Final = 1_000  # of an object beside its functions: about
DAY_S: Final = 86_400


def needs() -> list[str]:
    """Return the rows of the table of needs: a name, and a value for each number of users."""
    photos_each_core = _cell(PHOTOS, "ours", 5)  # 64 clients
    points_each_core = 1e6 * _cell(POINTS, "ours", 3) * _cell(HTTP, SHARE_OF_SAMPLER, 1)  # n = 10,000
    object_bytes = 4 * (HOF_1.size + COLOR.size) + ROW_BYTES
    table: dict[str, list[str]] = {}
    for users in USERS:
        photos_s = PEAK * users * PHOTOS_EACH / DAY_S
        clouds_s = PEAK * users * CLOUDS_EACH / DAY_S
        photo_cores = photos_s / photos_each_core / LOAD_FACTOR
        point_cores = clouds_s * CLOUD_POINTS / points_each_core / LOAD_FACTOR
        pods = max(2, -int(-(photo_cores + point_cores) // POD_CORES))
        cells = {
            "new photos a second, at the peak": f"{photos_s:,.0f}",
            "clouds a second, at the peak": f"{clouds_s:,.0f}",
            "cores for photos": f"{photo_cores:,.1f}",
            "cores for clouds": f"{point_cores:,.1f}",
            f"pods of {POD_CORES} cores, at least 2": f"{pods:,}",
            "connections to PostgreSQL": f"{pods * CONNECTIONS_EACH:,}",
            "database: rows written a second, at the peak": f"{photos_s:,.0f}",
            "database: MB read a second, at the peak": f"{clouds_s * object_bytes / 1e6:,.0f}",
            "database: GB more each day": f"{users * PHOTOS_EACH * object_bytes / 1e9:,.0f}",
            "network in: Mbit/s, at the peak": f"{8 * photos_s * PHOTO_BYTES / 1e6:,.0f}",
            "network out: Mbit/s, at the peak": f"{8 * clouds_s * CLOUD_POINTS * POINT_BYTES / 1e6:,.0f}",
        }
        for name, value in cells.items():
            table.setdefault(name, []).append(value)
    return [f"| {name} | {' | '.join(values)} |" for name, values in table.items()]


def updated(text: str) -> str:
    """Return the document with the rows that the figures give."""
    old = section(text, NEEDS)
    before, separator, rest = old.partition("|---|---|---|---|\n")
    after = rest[rest.index("\n\n") :] if rest.startswith("|") else f"\n{rest}"
    return text.replace(old, before + separator + "\n".join(needs()) + after)


def _cell(quote: Quote, row: str, column: int) -> float:
    return float(measured_rows(quote)[row].strip("|").split("|")[column])
