"""Probes, the model, and a service without torch."""

import asyncio
import os
import subprocess
import sys
import time
from pathlib import Path

import httpx
import pytest
from sqlalchemy.exc import OperationalError

from service.api.app import create_app
from service.encoding.encoder import Encoder
from service.settings import Settings
from tests.support.small import model as tiny_model


def test_probes_of_a_running_service_answer_200(client: httpx.Client) -> None:
    assert client.get("/health/live").json() == {"status": "live"}
    assert client.get("/health/ready").json() == {"status": "ready"}


def test_ready_outside_the_lifespan_answers_503(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    warm: list[Encoder] = []
    monkeypatch.setattr(Encoder, "warm_up", lambda encoder: warm.append(encoder))

    async def scenario() -> list[tuple[int, int, int]]:
        app = create_app(settings)
        transport = httpx.ASGITransport(app)
        states = []
        async with httpx.AsyncClient(transport=transport, base_url="http://x") as client:

            async def look() -> None:
                live, ready, objects = [
                    (await client.get(path)).status_code for path in ("/health/live", "/health/ready", "/objects")
                ]
                states.append((live, ready, objects))

            await look()
            async with app.router.lifespan_context(app):
                assert len(warm) == 1
                await look()
            await look()
        return states

    assert asyncio.run(scenario()) == [(200, 503, 503), (200, 200, 200), (200, 503, 503)]


def test_ready_with_a_silent_store_answers_503_and_live_200(
    client: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def broken(*_: object) -> None:
        raise OperationalError("SELECT 1", {}, OSError("gone"))

    monkeypatch.setattr("service.storage.store.Store.ping", broken)
    answer = client.get("/health/ready")
    assert (answer.status_code, answer.headers["retry-after"]) == (503, "1")
    assert answer.json()["detail"] == "the store does not answer"
    assert client.get("/health/live").status_code == 200


def test_model_answers_with_its_card_and_spec(client: httpx.Client, model_path: Path) -> None:
    answer = client.get("/model").json()
    encoder = Encoder.open(model_path, 1)
    assert (answer["name"], answer["digest"], answer["card"]) == ("tiny-k2", encoder.digest, tiny_model.CARD)
    assert answer["spec"]["k"] == 2
    assert answer["framing"] == {"size": tiny_model.SIZE, "foreground_ratio": 0.85}


WITHOUT_TRAINING_CODE = """
import importlib.abc, sys

class Blocker(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("torch", "model"):
            raise ImportError(f"{name} is not installed here")

sys.meta_path.insert(0, Blocker())
from service.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


def test_service_without_torch_and_model_runs(model_path: Path, tmp_path: Path, photo: bytes) -> None:
    log = tmp_path / "log"
    command = [sys.executable, "-c", WITHOUT_TRAINING_CODE, "serve", "--port", "0", "--model", str(model_path)]
    command += ["--database-url", f"sqlite:///{tmp_path / 'hof.db'}", "--drain-s", "0"]
    root = Path(__file__).parents[4]
    with log.open("wb") as file:
        process = subprocess.Popen(command, stderr=file, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(root)})
    try:
        while "running on" not in (text := log.read_text()):
            assert process.poll() is None, text
            time.sleep(0.05)
        url = text.split("running on ")[1].split()[0]
        assert httpx.get(f"{url}/health/ready").json() == {"status": "ready"}
        assert httpx.post(f"{url}/encode", content=photo).status_code == 201
    finally:
        process.terminate()
        process.wait(30)
    assert process.returncode in (0, -15)
