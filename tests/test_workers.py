"""A pool outlives workers that die or hang, and says so when none is left."""

import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pytest

from simpick.errors import ConfigError, OutputError, SimpickError
from simpick.workers import WorkerLimits, WorkerPool


@contextmanager
def pool_of(task, workers: int, limits: WorkerLimits | None = None) -> Iterator[WorkerPool]:
    pool = WorkerPool(task, workers, limits)
    try:
        yield pool
    finally:
        pool.close()


def leave_pid(folder: Path, job: int) -> None:
    (folder / f"{job}").write_text(str(os.getpid()))


def misbehave_once(folder: Path, how: str, job: int) -> None:
    """Die or hang over job 1, the first time."""
    first = folder / "misbehaved"
    if job == 1 and not first.exists():
        first.touch()
        if how == "die":
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(100)
    leave_pid(folder, job)


def die(job: int) -> None:
    os._exit(7)


def die_over_one(job: int) -> None:
    if job == 1:
        os._exit(7)


def complain(job: int) -> None:
    if job == 0:
        raise OutputError("the disk is full")
    raise KeyError("a bug")


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_several_workers_share_the_jobs_and_end_with_the_pool(tmp_path: Path) -> None:
    with pool_of(partial(leave_pid, tmp_path), 2) as pool:
        # So many that the second worker is up before the first has done all.
        pool.want(range(20000))
        for job in (0, 1, 2):
            pool.wait(job)
        deadline = time.monotonic() + 20
        while len(pool.pids) < 2 and time.monotonic() < deadline:
            time.sleep(0.05)
        pids = pool.pids
        assert len(pids) == 2 and all(alive(pid) for pid in pids)
    assert not any(alive(pid) for pid in pids)
    with pytest.raises(SimpickError, match="closed"):
        pool.wait(10**6)


@pytest.mark.parametrize("how", ["die", "hang"])
def test_a_worker_that_dies_or_hangs_is_replaced_and_its_job_done(tmp_path: Path, how: str) -> None:
    with pool_of(partial(misbehave_once, tmp_path, how), 1, WorkerLimits(20.0, 0.5)) as pool:
        pool.want([0, 1, 2])
        for job in (0, 1, 2):
            pool.wait(job)
        assert pool.replaced == 1
    pids = {(tmp_path / str(job)).read_text() for job in (0, 1, 2)}
    assert len(pids) == 2


def test_when_no_worker_works_the_pool_says_so() -> None:
    with pool_of(die, 2, WorkerLimits(failures=2)) as pool:
        pool.want([0])
        with pytest.raises(SimpickError, match=r"none of 2 worker processes works; the last one died \(exit code 7\)"):
            pool.wait(0)


def test_a_job_that_ends_every_worker_is_named() -> None:
    with pool_of(die_over_one, 1, WorkerLimits(failures=2)) as pool:
        pool.want([0, 1])
        pool.wait(0)
        with pytest.raises(SimpickError, match=r"job 1 ended 2 worker processes|none of 1 worker processes works"):
            pool.wait(1)


@pytest.mark.parametrize(("job", "text"), [(0, "^the disk is full$"), (1, r"job 1 failed in its worker: KeyError")])
def test_what_a_job_raises_reaches_the_owner(job: int, text: str) -> None:
    with pool_of(complain, 1) as pool:
        pool.want([job])
        with pytest.raises(SimpickError, match=text):
            pool.wait(job)


def test_limits_out_of_range_are_refused() -> None:
    with pytest.raises(ConfigError, match="job_s must be positive, got 0"):
        WorkerLimits(job_s=0)
    with pytest.raises(ConfigError, match="failures must be 1 or more, got 0"):
        WorkerLimits(failures=0)
    with pytest.raises(ConfigError, match="workers of a pool must be 1 or more, got 0"):
        WorkerPool(die, 0)
