"""`hof encode-many`: photos per second of one and of two processes, against a plain loop; memory over many photos.

`python -m benchmarks.speed.bulk > benchmarks/BULK.md` encodes 100,000 photos and prints the memory on the way.
"""

import argparse
import os
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.load.photos import photos
from benchmarks.speed.timing import Seconds
from benchmarks.targets import Target, targets_table
from model.provenance import provenance
from service.encoding.decode import DEFAULT_MAX_PIXELS
from service.runtime.bulk.encoding import encode_many
from service.runtime.bulk.photos import Setup, encode_photos
from service.runtime.bulk.sources import photos_of
from service.settings import MIB, SHIPPED_MODEL
from tests.support.resources import status_bytes

PHOTOS: Final = 512
WARM_UP: Final = 64  # photos until all processes run
SAMPLES: Final = 20  # of resident memory
SETTLED: Final = 4  # of the samples; by then all buffers have been used
SETUP: Final = Setup(SHIPPED_MODEL, None, "auto", None, 20 * MIB, DEFAULT_MAX_PIXELS)


@dataclass(frozen=True)
class Figures:
    """Seconds for a photo, (rounds,): in a plain loop on one core, and with one and two processes.

    two : None on a machine of one core.
    """

    loop: Seconds
    one: Seconds
    two: Seconds | None


def measure(core: int, rounds: int) -> Figures:
    """Measure on `core`; two processes on all cores."""
    cores = os.sched_getaffinity(0)
    every = set(range(os.cpu_count() or 1))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "photos").mkdir()
        for number, photo in enumerate(islice(photos(), PHOTOS)):
            (folder / "photos" / f"{number:05}.jpg").write_bytes(photo)
        names = list(photos_of(str(folder / "photos")))
        encode_photos(SETUP, names[:WARM_UP])
        table = []
        for number in range(rounds):
            os.sched_setaffinity(0, {core})
            start = time.perf_counter()
            encode_photos(SETUP, names)
            row = [(time.perf_counter() - start) / PHOTOS, _seconds(folder, f"{number}-one.parquet", 1)]
            if len(every) > 1:
                os.sched_setaffinity(0, every)
                row.append(_seconds(folder, f"{number}-two.parquet", 2))
            table.append(row)
    os.sched_setaffinity(0, cores)
    loop, one, *more = np.array(table).T
    return Figures(loop, one, more[0] if more else None)


def _seconds(folder: Path, name: str, processes: int) -> float:
    """Return the seconds for a photo once the processes run."""
    stamps: list[float] = []
    listing: partial[Iterator[str]] = partial(photos_of, str(folder / "photos"))
    encode_many(SETUP, listing, folder / name, processes, lambda done, total: stamps.append(time.perf_counter()))
    return (stamps[-1] - stamps[WARM_UP]) / (len(stamps) - 1 - WARM_UP)


def main() -> None:
    """Encode many photos with two processes and print the resident memory of all processes on the way."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--photos", type=int, default=100_000)
    count: int = parser.parse_args().photos
    run, samples = provenance(0), list[tuple[int, int, int]]()

    def sample(done: int, total: int) -> None:
        if done % max(1, total // SAMPLES) == 0:
            workers = sum(status_bytes(pid, "VmRSS") for pid in _children())
            samples.append((done, status_bytes(os.getpid(), "VmRSS"), workers))

    with tempfile.TemporaryDirectory() as name:
        folder, listing = Path(name), Path(name) / "list.txt"
        files = []
        for number, photo in enumerate(islice(photos(), PHOTOS)):
            files.append(folder / f"{number:05}.jpg")
            files[-1].write_bytes(photo)
        listing.write_text("\n".join(str(files[number % len(files)]) for number in range(count)), "utf-8")
        start = time.perf_counter()
        encode_many(SETUP, partial(photos_of, str(listing)), folder / "objects.parquet", 2, sample)
        took, size = time.perf_counter() - start, (folder / "objects.parquet").stat().st_size
    total = [own + workers for _, own, workers in samples]
    growth = 100 * (total[-1] / total[min(SETTLED, len(total)) - 1] - 1)
    rows = "\n".join(f"| {done:,} | {own / MIB:.0f} | {workers / MIB:.0f} |" for done, own, workers in samples)
    print(
        f"# `hof encode-many`: {count:,} photos\n\nWritten by `python -m benchmarks.speed.bulk`. {run['machine']}; "
        f"{run['date']}, commit {run['commit']}. {PHOTOS} JPEGs of 512 x 512, again and again, two processes: "
        f"{took:.0f} s, a file of {size / MIB:.0f} MiB.\n\n"
        + targets_table([Target("growth of resident memory after the first fifth, %", growth, 10, at_most=True)])
        + f"\n\n| photos | main process, MiB | the others, MiB |\n|---|---|---|\n{rows}"
    )


def _children() -> list[int]:
    """Return the processes that this one has started."""
    tasks = Path("/proc/self/task").iterdir()  # the kernel lists them by the thread that started them
    return [int(pid) for task in tasks for pid in (task / "children").read_text("ascii").split()]


if __name__ == "__main__":
    main()
