"""Damaged images of every sort at a real process: some hundred; `python -m benchmarks.load.fuzz` sends ten thousand."""

import random
from collections import Counter
from pathlib import Path

import httpx
import pytest
from hypothesis import HealthCheck, example, given, seed, settings, strategies

from service.encoding.framing import Framing, preprocess
from tests.support.mutations import MUTATIONS, mutant, mutated, seeds
from tests.support.processes import hof_serve

COUNT = 400
TOO_LARGE = 31  # a number whose image claims more pixels than the limit: one in 200 does
ANSWERS = {200, 201, 400, 413, 415, 422}


@pytest.mark.parametrize("sound", seeds(), ids=range(len(seeds())))
def test_images_before_damage_are_accepted(sound: bytes) -> None:
    preprocess(sound, Framing())


def test_mutation_of_one_number_is_always_the_same_image() -> None:
    assert mutant(7) == mutant(7) != mutant(8)
    assert len({mutant(number) for number in range(COUNT)}) > 0.9 * COUNT
    assert len(MUTATIONS) == 7


def test_damaged_images_are_all_answered_without_a_fault(model_path: Path, tmp_path: Path) -> None:
    answers: Counter[int] = Counter()
    with hof_serve(tmp_path, model_path) as (url, process), httpx.Client(base_url=url, timeout=60) as client:

        @settings(max_examples=COUNT, deadline=None, database=None, suppress_health_check=list(HealthCheck))
        @seed(0)
        @given(strategies.randoms(use_true_random=False))  # dice that shrink to the smallest damage that fails
        @example(random.Random(TOO_LARGE))  # Hypothesis' own choices depend on which modules this process has loaded
        def check(dice: random.Random) -> None:
            answer = client.post("/encode", content=mutated(dice))
            assert answer.status_code in ANSWERS, answer.text
            is_problem = answer.headers["content-type"] == "application/problem+json"
            assert is_problem == (answer.status_code >= 400)
            answers[answer.status_code] += 1

        check()
        assert client.get("/health/ready").status_code == 200
        assert process.poll() is None
    assert "Warning: " not in (tmp_path / "log").read_text()
    assert {201, 400, 413, 415} <= answers.keys(), answers
