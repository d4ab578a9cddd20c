import asyncio
from contextlib import ExitStack

import pytest

from service.errors import InvalidModel, InvalidParameter, Overloaded
from service.runtime.admission import ClientLeft, Gate


def test_gate_when_empty_admits_any_amount_and_when_full_none() -> None:
    gate = Gate("points", 10)
    with gate.admit(25):
        for amount in (1, 25):
            with pytest.raises(Overloaded, match="10 points"), gate.admit(amount):
                pass
    with gate.admit(6), gate.admit(4), pytest.raises(Overloaded), gate.admit(1):
        pass
    assert (gate.held, gate.finished, gate.refused) == (0, 3, 3)


@pytest.mark.parametrize(
    ("error", "counted"),
    [
        (InvalidParameter("no"), "finished"),
        (InvalidModel("no"), "failed"),
        (ValueError("no"), "failed"),
        (ClientLeft(), "cancelled"),
        (asyncio.CancelledError(), "cancelled"),
    ],
)
def test_gate_however_work_ends_counts_it_once(error: BaseException, counted: str) -> None:
    gate = Gate("images", 1)
    with pytest.raises(type(error)), gate.admit():
        raise error
    counts = {name: getattr(gate, name) for name in ("held", "finished", "cancelled", "failed", "refused")}
    assert counts == {"held": 0, "finished": 0, "cancelled": 0, "failed": 0, "refused": 0, counted: 1}


def test_gate_retry_time_grows_with_the_queue_up_to_a_minute(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0
    monkeypatch.setattr("service.runtime.admission.time.monotonic", lambda: now)
    gate = Gate("images", 20)

    def retry_after(held: int) -> int:
        with ExitStack() as stack:
            for _ in range(held):
                stack.enter_context(gate.admit())
            with pytest.raises(Overloaded) as caught, gate.admit(20):
                pass
            gate._last_left = now  # what follows leaves at once
        return caught.value.retry_after_s

    assert retry_after(1) == 1
    for _ in range(200):  # one at a time, two seconds each
        with gate.admit():
            now += 2
    assert retry_after(1) == 2
