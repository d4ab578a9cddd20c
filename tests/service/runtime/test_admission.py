import asyncio
from contextlib import ExitStack, nullcontext, suppress

import pytest

from service.errors import InvalidModel, InvalidParameter, Overloaded
from service.runtime.admission import ClientLeft, Gate, Gates
from service.settings import POINTS_PER_CPU, Settings


def test_gate_when_empty_admits_any_amount_and_when_full_none() -> None:
    gate = Gate("points", 10)
    with gate.admit(25):
        for amount in (1, 25):
            with pytest.raises(Overloaded, match="10 points"), gate.admit(amount):
                pass
    with gate.admit(6), gate.admit(4), pytest.raises(Overloaded), gate.admit(1):
        pass
    assert (gate.held, gate.finished, gate.refused) == (0, 3, 3)


def test_gate_with_a_bound_on_requests_lets_small_work_in_beside_a_large_one() -> None:
    gate = Gate("points", 100, largest=75)
    with gate.admit(25, "a"), gate.admit(1_000, "b"):
        assert gate.held == 100
        with pytest.raises(Overloaded), gate.admit(1, "c"):
            pass
    with gate.admit(1_000, "b"), gate.admit(25, "a"), pytest.raises(Overloaded), gate.admit(1_000, "c"):
        pass
    with gate.admit(26, "a"), pytest.raises(Overloaded), gate.admit(1_000, "b"):
        pass
    with gate.admit() as work:
        work.grow_to(1_000)
        assert gate.held == 75
    assert gate.held == 0


@pytest.mark.parametrize("limit", [1, 2, 3, POINTS_PER_CPU])
def test_points_gate_of_any_limit_admits_the_largest_request_beside_a_quarter_of_others(limit: int) -> None:
    gate = Gates.of(Settings(max_points_in_flight=limit)).points
    others = limit // 4
    with gate.admit(others, "a") if others else nullcontext(), gate.admit(10**12, "b"):
        assert gate.held <= limit


def test_gate_work_that_grows_needs_room_beside_the_others() -> None:
    gate = Gate("images", 10)
    with gate.admit() as alone:
        alone.grow_to(25)
        assert gate.held == 25
    with gate.admit(6), gate.admit() as other:
        other.grow_to(4)
        with pytest.raises(Overloaded):
            other.grow_to(5)
        assert gate.held == 10
    assert (gate.held, gate.finished, gate.refused) == (0, 3, 1)


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


def test_gate_leaves_room_for_clients_that_hold_less() -> None:
    gate = Gate("images", 128)
    counts = dict.fromkeys("abc", 0)
    with ExitStack() as stack:
        for client in counts:
            with suppress(Overloaded):
                while True:
                    stack.enter_context(gate.admit(client=client))
                    counts[client] += 1
            with pytest.raises(Overloaded, match="share of the service's 128 images"), gate.admit(client=client):
                pass
        assert counts == {"a": 96, "b": 24, "c": 6}
        stack.enter_context(gate.admit(2))  # work without a client takes what is left
        with pytest.raises(Overloaded, match="limit of 128 images"), gate.admit(client="e"):
            pass
    assert gate.held == 0
    with ExitStack() as stack:  # nothing of a client that has left is remembered
        for _ in range(96):
            stack.enter_context(gate.admit(client="a"))


@pytest.mark.parametrize("limit", [1, 2, 3])
def test_gate_that_is_small_is_one_client_s_alone(limit: int) -> None:
    gate = Gate("images", limit)
    with ExitStack() as stack:
        for _ in range(limit):
            stack.enter_context(gate.admit(client="a"))
        with pytest.raises(Overloaded, match=f"limit of {limit} images"), gate.admit(client="a"):
            pass


def test_admitted_work_grows_up_to_the_limit_and_alone_over_it() -> None:
    gate = Gate("bytes", 100)
    with gate.admit(0, "a") as first:
        first.grow_to(150)
        with pytest.raises(Overloaded), gate.admit(0, "b"):
            pass
    with gate.admit(0, "a") as first, gate.admit(0, "b") as second:
        first.grow_to(60)
        second.grow_to(40)
        for admitted in (first, second):
            with pytest.raises(Overloaded):
                admitted.grow_to(61)
        assert gate.held == 100
    assert gate.held == 0
