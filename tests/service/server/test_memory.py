"""Memory of every serving process: one arena for all threads; collections skip startup objects."""

import gc
import time
from contextlib import suppress
from importlib import import_module
from pathlib import Path

import httpx
import pytest

from service.server.memory import importing
from tests.support import ROOT
from tests.support.processes import hof_serve

ARENA = 64 * 2**20  # bytes of address space that glibc reserves for an arena, aligned: the rest of it is inaccessible


def arenas(pid: int) -> int:
    """Count the arenas of a process, without the first."""
    accessible: set[tuple[int, int]] = set()
    reserved: set[tuple[int, int]] = set()
    for line in Path(f"/proc/{pid}/maps").read_text().splitlines():
        region, rights, *_ = line.split()
        start, end = (int(address, 16) for address in region.split("-"))
        {"rw-p": accessible, "---p": reserved}.get(rights, set()).add((start, end))
    return sum(start % ARENA == 0 and (end, start + ARENA) in reserved for start, end in accessible)


def processes(pid: int) -> list[int]:
    """Return a process and its children."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [pid, *map(int, children)]


def send_work(url: str, photo: bytes) -> None:
    with httpx.Client(base_url=url) as client:
        for _ in range(4):
            path = client.post("/encode", content=photo).raise_for_status().json()["links"]["self"]
            client.get(f"{path}/points?n=100000").raise_for_status()


@pytest.mark.parametrize("flags", [(), ("--workers", "2")])
def test_serve_by_default_uses_one_arena_for_all_threads(
    flags: tuple[str, ...], model_path: Path, photo: bytes, tmp_path: Path
) -> None:
    with hof_serve(tmp_path, model_path, *flags) as (url, process):
        send_work(url, photo)
        assert [arenas(pid) for pid in processes(process.pid)] == [0] * len(processes(process.pid))


def test_serve_with_malloc_arena_max_set_keeps_the_users_number(model_path: Path, photo: bytes, tmp_path: Path) -> None:
    with hof_serve(tmp_path, model_path, MALLOC_ARENA_MAX="8") as (url, process):
        send_work(url, photo)
        assert arenas(process.pid) > 0


AFTER_FULL_COLLECTIONS = """
import gc, os
def note(phase, info):
    if phase == "stop" and info["generation"] == 2:
        with open(f"{folder}/{{os.getpid()}}.frozen", "w") as file:
            file.write(str(gc.get_freeze_count()))
gc.callbacks.append(note)
"""


@pytest.mark.parametrize(("flags", "serving"), [((), 1), (("--workers", "2"), 2)])
def test_full_collection_after_startup_skips_startup_objects(
    flags: tuple[str, ...], serving: int, model_path: Path, photo: bytes, tmp_path: Path
) -> None:
    (tmp_path / "sitecustomize.py").write_text(AFTER_FULL_COLLECTIONS.format(folder=tmp_path))
    end, kept = time.monotonic() + 60, 0
    with hof_serve(tmp_path, model_path, *flags, PYTHONPATH=f"{tmp_path}:{ROOT}") as (url, _):
        send_work(url, photo)
        while kept < serving and time.monotonic() < end:
            counts = [int(path.read_text() or 0) for path in tmp_path.glob("*.frozen")]
            kept = sum(count > 100_000 for count in counts)
            time.sleep(0.05)
    assert kept == serving


@pytest.mark.parametrize("was_enabled", [True, False])
@pytest.mark.parametrize("module", ["gc", "no_such_module"])
def test_importing_stops_collections_and_restores_them_even_if_it_fails(module: str, was_enabled: bool) -> None:
    (gc.enable if was_enabled else gc.disable)()
    try:
        with suppress(ModuleNotFoundError), importing():
            is_enabled_meanwhile = gc.isenabled()
            import_module(module)
        assert not is_enabled_meanwhile
        assert gc.isenabled() == was_enabled
    finally:
        gc.enable()
