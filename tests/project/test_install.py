"""Wheels with and without the compiled kernel: `pip wheel`, then an installation of the wheel alone."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import httpx
import pytest

from service.mapping.compiled import NOT_BUILT
from service.settings import SHIPPED_MODEL
from tests.support import ROOT
from tests.support.processes import hof_serve

INSTALL_TIMEOUT_S = 300
SOURCES = ("pyproject.toml", "setup.py", "MANIFEST.in", "README.md", "LICENSE", "NOTICE")
HOF = (sys.executable, "-c", "import sys; from service.cli import main; sys.exit(main())")


@pytest.fixture(scope="module")
def install(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[str, Path]]:
    """Return a function that builds the wheel with a C compiler and installs it: its name, and the folder."""

    def build(compiler: str) -> tuple[str, Path]:
        folder = tmp_path_factory.mktemp("install")
        sources, wheels, site = folder / "sources", folder / "wheels", folder / "site"
        sources.mkdir()
        for name in SOURCES:
            shutil.copy(ROOT / name, sources)
        for name in ("service", "model"):
            shutil.copytree(ROOT / name, sources / name, ignore=shutil.ignore_patterns("node_modules", "*.so", "*.pyc"))
        (folder / "npm").write_text("#!/bin/sh\n")  # the page is not the subject
        (folder / "npm").chmod(0o755)
        environment = os.environ | {"CC": compiler, "PATH": f"{folder}:{os.environ['PATH']}"}
        pip = (sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check")
        for arguments in (
            ("wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", str(wheels), str(sources)),
            ("install", "--no-deps", "--no-index", "--find-links", str(wheels), "--target", str(site), "hof-service"),
        ):
            subprocess.run([*pip, *arguments], env=environment, check=True, timeout=INSTALL_TIMEOUT_S)
        (wheel,) = wheels.iterdir()
        return wheel.name, site

    return build


def _run(site: Path, *arguments: str) -> str:
    run = subprocess.run(
        [*HOF, *arguments],
        cwd=site,
        env=os.environ | {"PYTHONPATH": str(site), "HOF_DATABASE_URL": f"sqlite:///{site}/hof.db", "HOF_PORT": "0"},
        capture_output=True,
        text=True,
        check=True,
        timeout=INSTALL_TIMEOUT_S,
    )
    return run.stdout


@pytest.mark.slow
def test_install_without_a_compiler_succeeds_and_serves_by_numpy(
    install: Callable[[str], tuple[str, Path]], photo: bytes
) -> None:
    _, site = install("false")
    assert not list(site.glob("service/*/_*.so"))
    assert f"warn kernel    {NOT_BUILT}" in _run(site, "doctor")
    with hof_serve(site, SHIPPED_MODEL, command=HOF, PYTHONPATH=str(site)) as served:
        answer = httpx.post(
            f"{served.url}/encode", files={"image": photo}, timeout=INSTALL_TIMEOUT_S
        ).raise_for_status()
        points = httpx.get(f"{served.url}/objects/{answer.json()['id']}/points", params={"n": 20_000, "format": "f32"})
    assert len(points.content) == 20_000 * 3 * 4
    assert NOT_BUILT in (site / "log").read_text("utf-8")


@pytest.mark.system
def test_install_with_a_compiler_has_a_kernel_for_every_python(install: Callable[[str], tuple[str, Path]]) -> None:
    name, site = install("cc")
    assert "-cp311-abi3-" in name
    assert [path.name for path in site.glob("service/mapping/_kernel*")] == ["_kernel.abi3.so"]
    assert [path.name for path in site.glob("service/encoding/_pixels*")] == ["_pixels.abi3.so"]
    assert not list(site.glob("service/*/kernel/*"))
    assert "ok   kernel    compiled, with " in _run(site, "doctor")
