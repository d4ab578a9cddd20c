import asyncio
from collections.abc import AsyncIterator
from typing import Any

import numpy as np
import pytest

from service.formats.points.registry import PointFormat
from service.formats.points.writer import write
from service.mapping.cloud import FIRST_PART, PART, Cloud
from service.mapping.spec import Color, Functions, MappingSpec, initial_theta
from service.runtime.streaming import stream
from tests.support.small.clouds import EVERY, label

SPEC = MappingSpec("small", 3, (16,), 3, k=2)
COLOR_SPEC = MappingSpec("small-color", 3, (8,), 3)
N = FIRST_PART + PART + 100  # three parts


async def joined(pieces: AsyncIterator[bytes]) -> bytes:
    return b"".join([piece async for piece in pieces])


@pytest.mark.parametrize("fmt", EVERY, ids=label)
def test_stream_of_any_format_gives_the_bytes_of_write(fmt: PointFormat) -> None:
    functions = Functions(initial_theta(SPEC), Color(COLOR_SPEC, initial_theta(COLOR_SPEC)))
    cloud = Cloud(SPEC, functions, N if not fmt.is_text else FIRST_PART + 100, scale=2.0)
    expected = b"".join(write(fmt, cloud))
    assert asyncio.run(joined(stream(fmt, cloud, asyncio.to_thread, ahead=2))) == expected


def test_stream_with_slow_parts_computes_at_most_ahead_at_a_time() -> None:
    cloud = Cloud(SPEC, Functions(initial_theta(SPEC)), FIRST_PART + 5 * PART)
    running, most = 0, 0

    async def run(function: Any, *arguments: Any) -> Any:  # noqa: ANN401
        nonlocal running, most
        running += 1
        most = max(most, running)
        await asyncio.sleep(0.01)
        running -= 1
        return np.zeros((0, 3), np.float32).tobytes()

    plain = next(fmt for fmt in EVERY if fmt.name == "f32")
    assert asyncio.run(joined(stream(plain, cloud, run, ahead=3))) == b""
    assert most == 3
