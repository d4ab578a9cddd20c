"""A start of `hof serve`: what it imports, and how often it opens the models."""

import asyncio
import subprocess
import sys
from pathlib import Path

import pytest

from service.encoding.encoder import Encoder
from service.server import serve
from service.server.process import Server
from service.settings import Settings
from tests.support import ROOT

COSTLY = ("alembic", "asyncpg", "pyarrow", "sqlalchemy.orm", "torch")
IMPORTS = f"""
import asyncio, sys
from service.server.serve import serve
from service.storage import database
asyncio.run(database.verify(sys.argv[1]))
asyncio.run(database.verify(sys.argv[1]))
print(*(name for name in {COSTLY} if name in sys.modules))
"""


def test_imports_of_a_start_on_sqlite_lack_what_only_others_need(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path}/hof.db"
    result = subprocess.run(
        [sys.executable, "-c", IMPORTS, url], cwd=ROOT, capture_output=True, text=True, check=True, timeout=60
    )
    assert result.stdout.split() == []


def test_a_start_of_one_process_opens_each_model_once(
    tmp_path: Path, model_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[object] = []
    make = Encoder.__init__

    def init(encoder: Encoder, source: Path | bytes, threads: int) -> None:
        opened.append(source)
        make(encoder, source, threads)

    def run(server: Server) -> None:
        server.config.load()
        app = server.config.loaded_app
        while hasattr(app, "app"):
            app = app.app

        async def open_and_close() -> None:
            async with app.router.lifespan_context(app):
                server.started = True

        asyncio.run(open_and_close())

    monkeypatch.setattr(Encoder, "__init__", init)
    monkeypatch.setattr(Server, "run", run)
    serve.serve(Settings(model=(model_path,), matting_model=None, database_url=f"sqlite:///{tmp_path}/hof.db"))
    assert opened == [model_path]
