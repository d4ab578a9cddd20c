"""Liveness of a part whose pings fail or hang. The parts of a real service are in test_health.py."""

import asyncio
import math
from collections.abc import Callable, Coroutine

import pytest

from service.runtime import liveness
from service.runtime.liveness import LivenessProbe

Ping = Callable[[], Coroutine[None, None, None]]


async def _answer() -> None:
    pass


async def _fail() -> None:
    raise ConnectionError("the part is gone")


async def _hang() -> None:
    await asyncio.sleep(600)


@pytest.mark.parametrize(
    ("pings", "expected"),
    [
        ([_answer], [True]),
        ([_fail], [False]),
        ([_hang], [True, True]),  # one ping, which has time
        ([_fail, _hang], [False, False]),  # what failed must answer before it is believed
        ([_fail, _answer], [False, True]),
        ([_fail, _hang, _answer], [False, False, False]),
    ],
)
def test_liveness_probe_trusts_a_part_whose_last_answer_succeeded(
    pings: list[Ping], expected: list[bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(liveness, "PROBE_TIMEOUT_S", 0.01)
    coming = iter(pings)

    async def ask() -> list[bool]:
        part = LivenessProbe(lambda: next(coming)(), lambda: -math.inf)
        return [await part.is_alive() for _ in expected]

    assert asyncio.run(ask()) == expected
