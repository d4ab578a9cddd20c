"""Kill and stop a server under write load, again and again, and count the acknowledged objects that are missing."""

import random
import tempfile
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.targets import Target
from tests.support.ledger import WRITERS, Ledger, kill, lost, stop

MOST_WRITES: Final = 100  # before a kill


def faults(targets: list[Target], kills: int, stops: int) -> str:
    """Kill the service so many times, stop it so many times, count what is missing, and return the page's section."""
    draw, ledger, missing = random.Random(0), Ledger(), 0  # noqa: S311
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for _ in range(kills):
            kill(folder, ledger, draw.randrange(MOST_WRITES))
            missing += len(lost(folder, ledger))
        stopped = [stop(folder, ledger) for _ in range(stops)]
        missing += len(lost(folder, ledger))
    unready = np.array([each.unready_ms for each in stopped])
    targets += [
        Target(f"{kills} kills: acknowledged objects that are lost or half there", missing, 0, at_most=True),
        Target("stopped: ms until it is unready, the slowest", float(unready.max()), 100, at_most=True),
        Target("stopped: calls that broke off", sum(each.broken for each in stopped), 0, at_most=True),
    ]
    return (
        f"## Faults: SIGKILL {kills} times, SIGTERM {stops} times, amid the writes of {WRITERS} clients\n\n"
        f"Acknowledged: {len(ledger.thetas):,} objects and {len(ledger.words):,} words of them; after each end all are "
        f"looked for. Unready after SIGTERM: {np.median(unready):.1f} ms, the median."
    )
