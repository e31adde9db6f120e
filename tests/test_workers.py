"""A pool outlives workers that die or hang, and says so when none is left."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from simpick.errors import ConfigError, OutputError, SimpickError
from simpick.workers import LostCallError, WorkerLimits, WorkerPool


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


def return_what_cannot_be_pickled() -> object:
    return lambda: None


def complain(job: int) -> None:
    if job == 0:
        raise OutputError("the disk is full")
    raise KeyError("a bug")


PARENT = """
import os, time
from simpick.workers import WorkerPool

if __name__ == "__main__":
    with WorkerPool(1) as pool:
        print(pool.submit(os.getpid).result(), flush=True)
        pool.submit(time.sleep, 100)
        time.sleep(100)
"""


def is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    # A process that ended but was not waited for yet is there still, as a zombie.
    status = Path(f"/proc/{pid}/stat")
    return not status.exists() or status.read_text().rpartition(")")[2].split()[0] != "Z"


def is_alive_after(seconds: float, pid: int) -> bool:
    deadline = time.monotonic() + seconds
    while is_alive(pid) and time.monotonic() < deadline:
        time.sleep(0.05)
    return is_alive(pid)


def environment(name: str) -> str | None:
    return os.environ.get(name)


def test_results_come_back_and_workers_end_with_the_pool(tmp_path: Path) -> None:
    with WorkerPool(2) as pool:
        # So many that the second worker is up before the first has done all.
        calls = [pool.submit(leave_pid, tmp_path, job) for job in range(20000)]
        for call in calls[:3]:
            call.result()
        deadline = time.monotonic() + 20
        while len(pool.pids) < 2 and time.monotonic() < deadline:
            time.sleep(0.05)
        pids = pool.pids
        assert len(pids) == 2 and all(is_alive(pid) for pid in pids)
    assert not any(is_alive(pid) for pid in pids)
    with pytest.raises(SimpickError, match="closed"):
        calls[-1].result()
    with pytest.raises(SimpickError, match="closed"):
        pool.submit(os.getpid)


@pytest.mark.parametrize("how", ["die", "hang"])
def test_a_worker_that_dies_or_hangs_is_replaced_and_its_call_repeated(tmp_path: Path, how: str) -> None:
    with WorkerPool(1, WorkerLimits(20.0, 0.5)) as pool:
        for call in [pool.submit(misbehave_once, tmp_path, how, job) for job in (0, 1, 2)]:
            call.result()
        assert pool.replaced == 1
    pids = {(tmp_path / str(job)).read_text() for job in (0, 1, 2)}
    assert len(pids) == 2


def test_when_no_worker_works_every_call_reports_so() -> None:
    with WorkerPool(2, WorkerLimits(failures=2)) as pool:
        for call in [pool.submit(die, job) for job in (0, 1)]:
            with pytest.raises(
                LostCallError, match=r"none of 2 worker processes works; the last one died \(exit code 7\)"
            ):
                call.result()


def test_a_call_that_ends_every_worker_fails() -> None:
    with WorkerPool(1, WorkerLimits(failures=2)) as pool:
        fine, fatal = (pool.submit(die_over_one, job) for job in (0, 1))
        fine.result()
        with pytest.raises(LostCallError, match=r"2 worker processes were lost|none of 1 worker processes works"):
            fatal.result()


@pytest.mark.parametrize(("job", "text"), [(0, "^the disk is full$"), (1, r"a worker process failed: KeyError")])
def test_what_a_call_raises_reaches_the_caller(job: int, text: str) -> None:
    with WorkerPool(1) as pool, pytest.raises(SimpickError, match=text):
        pool.submit(complain, job).result()


def test_what_cannot_be_pickled_is_reported_and_costs_no_process() -> None:
    with WorkerPool(1) as pool:
        for call in (pool.submit(return_what_cannot_be_pickled), pool.submit(len, (lambda: None for _ in ()))):
            with pytest.raises(SimpickError, match="pickle"):
                call.result()
        assert pool.replaced == 0


def test_staggered_processes_start_one_after_the_other(tmp_path: Path) -> None:
    with WorkerPool(2, staggered=True) as pool:
        calls = [pool.submit(time.sleep, seconds) for seconds in (1.5, 0.5, 0.5)]
        started: list[int] = []
        while not calls[0].done():
            started.append(len(pool.pids))
            time.sleep(0.02)
        calls[1].result()
        assert max(started) == 1


def test_a_cancelled_call_is_not_made(tmp_path: Path) -> None:
    with WorkerPool(1) as pool:
        first, second, third = (pool.submit(leave_pid, tmp_path, job) for job in (0, 1, 2))
        assert second.cancel()
        third.result()
    assert first.done() and sorted(file.name for file in tmp_path.iterdir()) == ["0", "2"]


def test_threads_are_shared_unless_the_environment_sets_their_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setenv("MKL_NUM_THREADS", "7")
    with WorkerPool(1, threads=3) as pool:
        assert pool.submit(environment, "OMP_NUM_THREADS").result() == "3"
        assert pool.submit(environment, "MKL_NUM_THREADS").result() == "7"
    assert "OMP_NUM_THREADS" not in os.environ


def test_workers_end_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    parent = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    worker = int(parent.stdout.readline())
    assert is_alive(worker)
    os.kill(parent.pid, signal.SIGKILL)
    parent.wait()
    parent.stdout.close()
    assert not is_alive_after(20, worker)


def test_numbers_out_of_range_are_refused() -> None:
    with pytest.raises(ConfigError, match="call_s must be above 0, got 0"):
        WorkerLimits(call_s=0)
    with pytest.raises(ConfigError, match="failures must be at least 1, got 0"):
        WorkerLimits(failures=0)
    with pytest.raises(ConfigError, match="workers must be 1 or more, got 0"):
        WorkerPool(0)
