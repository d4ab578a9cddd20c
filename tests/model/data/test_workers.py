"""Isolation of jobs in worker processes, with real crashes."""

import multiprocessing
import os
import time
from collections.abc import Generator, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import spawn
from pathlib import Path

import pytest

from model.data import workers
from model.data.workers import run_isolated, run_with_report
from tests.support.processes import dying_python
from tests.support.small.jobs import wait_unless_ready, work


@pytest.mark.slow
def test_run_isolated_crash_error_and_hang_fail_one_job_each() -> None:
    outcomes = {outcome.job: outcome.failure for outcome in run_isolated(work, range(8), processes=2, timeout_s=20)}
    assert len(outcomes) == 8
    assert outcomes[1] == "the worker process crashed"
    assert outcomes[2] == "ValueError: bad mesh"
    assert outcomes[3] == "took longer than 20 s"
    assert [job for job, failure in outcomes.items() if failure] == sorted((1, 2, 3), key=list(outcomes).index)


def test_run_isolated_one_process_is_replaced_after_each_crash() -> None:
    outcomes = [(outcome.job, outcome.failure) for outcome in run_isolated(work, (1, 0, 1, 4), processes=1)]
    crash = "the worker process crashed"
    assert outcomes == [(1, crash), (0, None), (1, crash), (4, None)]


def test_run_isolated_with_pools_that_break_before_a_job_ends_runs_the_rest_in_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pools: list[Sequence[int]] = []

    def ended(
        function: object, jobs: Sequence[int], *options: object
    ) -> Generator[tuple[int, Future[str | None]], None, None]:
        pools.append(jobs)
        for job in jobs:
            future: Future[str | None] = Future()
            if job < 2 or len(pools) == 1:  # the first pool breaks at once, the second after one job
                future.set_exception(BrokenProcessPool("All workers expired"))
            else:
                future.set_result(None)
            yield job, future

    monkeypatch.setattr(workers, "_ended", ended)
    outcomes = [(outcome.job, outcome.failure) for outcome in run_isolated(work, (1, 4, 0), processes=1)]
    assert outcomes == [(1, workers.CRASHED), (4, None), (0, workers.CRASHED)]
    assert [list(jobs) for jobs in pools] == [[1, 4, 0], [4, 0], [0]]


@pytest.mark.slow
def test_run_isolated_with_processes_that_die_as_they_start_fails_every_job(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(spawn, "_python_exe", dying_python(tmp_path))
    jobs = [10_000 + number for number in range(30)]
    outcomes = [(outcome.job, outcome.failure) for outcome in run_isolated(work, jobs, processes=2)]
    assert outcomes == [(job, workers.CRASHED) for job in jobs]
    assert not multiprocessing.active_children()


def test_run_isolated_closed_early_leaves_no_process_behind(tmp_path: Path) -> None:
    outcomes = run_isolated(wait_unless_ready, [tmp_path / "ready", tmp_path / "pid", tmp_path / "waits"], processes=2)
    assert next(outcomes).failure is None
    while not (tmp_path / "pid").exists() or not (tmp_path / "pid").read_text():
        time.sleep(0.05)
    outcomes.close()
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "pid").read_text()), 0)
    assert not multiprocessing.active_children()


def test_run_with_report_failures_are_returned_by_name_and_printed(capsys: pytest.CaptureFixture[str]) -> None:
    failures = run_with_report(work, range(3), lambda job: f"job {job}", 2, "work", "job").failures
    assert failures == {"job 1": "the worker process crashed", "job 2": "ValueError: bad mesh"}
    assert "skipped job 2: ValueError: bad mesh" in capsys.readouterr().out


def test_run_with_report_remarks_are_returned_by_name_and_printed(capsys: pytest.CaptureFixture[str]) -> None:
    report = run_with_report(work, (2, 5), lambda job: f"job {job}", 1, "work", "job")
    assert report.failures == {"job 2": "ValueError: bad mesh"}
    assert report.remarks == {"job 5": "half of it"}
    assert "job 5: half of it" in capsys.readouterr().out
