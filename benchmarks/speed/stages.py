"""Processor time of a new photo, stage by stage.

`python -m benchmarks.speed.stages` prints the table. Each stage runs alone, on the photos that
a running `hof serve` is then sent; what the stages leave of the server's time is HTTP, middleware and threads.
"""

import argparse
import asyncio
import tempfile
import time
from collections.abc import Callable
from itertools import islice
from typing import Any, Final

import numpy as np

from benchmarks.load.photos import photos
from benchmarks.speed import photos as over_http
from benchmarks.speed.timing import pin
from model.provenance import provenance
from service.api.responses.objects import EncodedObject
from service.encoding.decode import DEFAULT_MAX_PIXELS, decode_with_size
from service.encoding.encoder import Encoder
from service.encoding.framing import preprocess
from service.encoding.masks import matte_of
from service.encoding.report import ImageReport
from service.mapping import compiled
from service.mapping.box import measure
from service.mapping.sampler import hold_blas_to_one_thread
from service.runtime.inputs.photos import photo_id, photo_key, photo_record
from service.settings import SHIPPED_MODEL
from service.storage.rows import Record
from service.storage.store import Store

ROUNDS: Final = 5
PHOTOS: Final = 24  # all kinds

Stages = dict[str, float]  # ms for a photo


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    arguments = parser.parse_args()
    core = pin()
    hold_blas_to_one_thread()
    engine = "the compiled kernel" if compiled.load() else "NumPy"
    stages = measure_stages(arguments.rounds)
    figures = over_http.measure(core, arguments.rounds)
    total = 1000 * float(np.median(figures.new_s))
    print(_page(stages, total, 1000 * float(np.median(figures.encode_s)), engine))


def measure_stages(rounds: int) -> Stages:
    """Return the processor time of each stage, the median over the rounds of the mean over the photos."""
    encoder, data = Encoder.open(SHIPPED_MODEL, threads=1), list(islice(photos(), PHOTOS))
    images = [decode_with_size(photo, DEFAULT_MAX_PIXELS)[0] for photo in data]
    framed = [preprocess(photo, encoder.framing) for photo in data]
    batches = np.concatenate([each.tensor for each in framed]).reshape(
        -1, over_http.CLIENTS, *framed[0].tensor.shape[1:]
    )
    encoded = [each for batch in batches for each in encoder.encode(batch)]
    boxes = [measure(encoder.spec, each.theta) for each in encoded]
    ratio = encoder.framing.foreground_ratio
    ids = [photo_id(photo, view, ratio, encoder, None) for photo, view in zip(data, framed, strict=True)]
    records = [photo_record(*each[:2], encoder, *each[2:]) for each in zip(ids, framed, encoded, boxes, strict=True)]
    reports = [(ImageReport.of(view),) for view in framed]

    def timed(run: Callable[[int], object]) -> float:
        return float(np.median([_each(run) for _ in range(rounds)]))

    decoding = timed(lambda i: decode_with_size(data[i], DEFAULT_MAX_PIXELS))
    mask = timed(lambda i: matte_of(images[i], None))
    whole = timed(lambda i: preprocess(data[i], encoder.framing))
    return {
        "digest of the bytes": timed(lambda i: photo_key([data[i]], encoder, "auto", ratio)),
        "decoding": decoding,
        "mask": mask,
        "box of the mask, square, resizing, over white": whole - decoding - mask,
        "encoder, in batches": timed(lambda i: encoder.encode(batches[i]) if i < len(batches) else None),
        "box of the function": timed(lambda i: measure(encoder.spec, encoded[i].theta)),
        "database: look up and write": asyncio.run(_database(records, encoded, rounds)),
        "answer": timed(lambda i: EncodedObject.of_image(records[i], reports[i], None).model_dump_json()),
    }


async def _database(records: list[Record], encoded: list[Any], rounds: int) -> float:
    """Return the time to look an object up and to write it, to SQLite: those of a call of the encoder together."""
    times = []
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as folder:
            store = await Store.open(f"sqlite:///{folder}/hof.db")
            await store.find("")
            before = time.process_time()
            for first in range(0, len(records), over_http.CLIENTS):
                together = slice(first, first + over_http.CLIENTS)
                for record in records[together]:
                    await store.find_record(record.id)
                await asyncio.gather(*map(store.put, records[together], encoded[together]))
            times.append(1000 * (time.process_time() - before) / len(records))
            await store.close()
    return float(np.median(times))


def _each(run: Callable[[int], object]) -> float:
    before = time.process_time()
    for index in range(PHOTOS):
        run(index)
    return 1000 * (time.process_time() - before) / PHOTOS


def _page(stages: Stages, total: float, encoder: float, engine: str) -> str:
    run = provenance(0)
    rows = stages | {"HTTP, middleware, threads: the rest": total - sum(stages.values())}
    lines = [f"| {name} | {ms:.2f} | {100 * ms / total:.0f}% |" for name, ms in rows.items()]
    return "\n".join(
        [
            "# Where the processor time of a new photo goes\n",
            f"Printed by `python -m benchmarks.speed.stages`. {run['machine']}; {run['date']}, commit {run['commit']}; "
            f"one core, {over_http.CLIENTS} clients, JPEGs of 512 x 512 pixels, points by {engine}. The whole request "
            f"takes {total / encoder:.2f} times what the encoder takes alone.\n",
            "| stage | ms | share |\n|---|---|---|",
            *lines,
            f"| **whole request** | {total:.2f} | 100% |",
        ]
    )


if __name__ == "__main__":
    main()
