"""Damaged images of every sort at a real process: a few hundred of the ten thousand of `python -m benchmarks.fuzz`."""

from collections import Counter
from pathlib import Path

import httpx
import pytest
from conftest import hof_serve

from benchmarks.mutations import MUTATIONS, mutant, seeds
from service.images import Framing, preprocess

COUNT = 400
ANSWERS = {200, 201, 400, 413, 415, 422}


@pytest.mark.parametrize("seed", seeds(), ids=range(len(seeds())))
def test_what_is_damaged_was_sound(seed: bytes) -> None:
    preprocess(seed, Framing())


def test_a_number_tells_an_image() -> None:
    assert mutant(7) == mutant(7) != mutant(8)
    assert len({mutant(number) for number in range(COUNT)}) > 0.9 * COUNT
    assert len(MUTATIONS) == 7


def test_every_damaged_image_is_answered_and_none_by_a_fault(model_path: Path, tmp_path: Path) -> None:
    answers: Counter[int] = Counter()
    with hof_serve(tmp_path, model_path) as (url, process), httpx.Client(base_url=url, timeout=60) as client:
        for number in range(COUNT):
            answer = client.post("/encode", content=mutant(number))
            assert answer.status_code in ANSWERS, f"mutant({number}): {answer.text}"
            is_problem = answer.headers["content-type"] == "application/problem+json"
            assert is_problem == (answer.status_code >= 400), number
            answers[answer.status_code] += 1
        assert client.get("/health/ready").status_code == 200
        assert process.poll() is None
    assert "Warning: " not in (tmp_path / "log").read_text()
    assert {201, 400, 413, 415} <= answers.keys(), answers
