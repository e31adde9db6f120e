"""`WorkerPool`: numbered jobs in spawned processes that may hang or die, and are then replaced.

Processes that render have been seen to hang while many of them start side by side. So they start one after the
other, each only when the one before has finished its first job; every job has a time limit; and a process that keeps
failing is given up, so that a run goes on with fewer.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess

from simpick.errors import ConfigError, SimpickError

_TICK_S = 0.1
# Read when numerical libraries and software OpenGL are loaded: a worker uses one core, there are others for the rest.
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "LP_NUM_THREADS": "1"}


@dataclass(frozen=True)
class WorkerLimits:
    """When a worker counts as hung, and when as hopeless."""

    first_job_s: float = 180.0
    """Longest time from a process's start to the end of its first job: imports and OpenGL included."""
    job_s: float = 120.0
    """Longest time of every later job."""
    failures: int = 3
    """A worker that died or hung so often in a row is not started again; nor is a job that ended so many workers."""

    def __post_init__(self) -> None:
        for name in ("first_job_s", "job_s"):
            if not getattr(self, name) > 0:
                raise ConfigError(f"{name} must be positive, got {getattr(self, name)}")
        if self.failures < 1:
            raise ConfigError(f"failures must be 1 or more, got {self.failures}")


@dataclass
class _Worker:
    """One place for a process, and the process that fills it now."""

    process: BaseProcess | None = None
    connection: Connection | None = None
    job: int | None = None
    deadline: float = 0.0
    proven: bool = False
    """Whether this process has finished a job."""
    failures: int = 0
    """Processes in a row that ended without finishing one."""


@dataclass
class _Board:
    """What the supervising thread and its owner share, under one lock."""

    condition: threading.Condition = field(default_factory=threading.Condition)
    wanted: list[int] = field(default_factory=list)
    done: set[int] = field(default_factory=set)
    error: SimpickError | None = None
    closing: bool = False


class WorkerPool:
    """Runs ``task(job)`` for wanted job numbers in up to `workers` spawned processes.

    `task` must be picklable. What it returns is dropped: it leaves its result in a file. Processes ignore the
    interrupt signal, which is the owner's to handle, and end when the owner does.
    """

    def __init__(self, task: Callable[[int], object], workers: int, limits: WorkerLimits | None = None) -> None:
        if workers < 1:
            raise ConfigError(f"workers of a pool must be 1 or more, got {workers}")
        self._task, self._limits = task, limits or WorkerLimits()
        self._workers = [_Worker() for _ in range(workers)]
        self._board = _Board()
        self._ended: dict[int, int] = {}
        self._last_failure = ""
        self.replaced = 0
        """How many processes died or were killed because they hung."""
        self._thread = threading.Thread(target=self._supervise, name="worker-pool", daemon=True)
        self._thread.start()

    @property
    def pids(self) -> list[int]:
        """Return the process ids of the workers that run now."""
        return [w.process.pid for w in self._workers if w.process is not None and w.process.pid is not None]

    def want(self, jobs: Sequence[int]) -> None:
        """Say which jobs shall be done, in this order; jobs that have begun are finished all the same."""
        with self._board.condition:
            self._board.wanted = list(jobs)

    def wait(self, job: int) -> None:
        """Block until a wanted job is done.

        Raises:
            SimpickError: a job raised it, ended too many workers, or no worker is left.
        """
        board = self._board
        with board.condition:
            while job not in board.done:
                if board.error is not None:
                    raise board.error
                if board.closing:
                    raise SimpickError("the worker pool is closed; make a new one")
                board.condition.wait(_TICK_S)

    def forget(self, job: int) -> None:
        """Let a job count as not done again."""
        with self._board.condition:
            self._board.done.discard(job)

    def close(self) -> None:
        """End all workers at once, whatever they do; may be called again."""
        with self._board.condition:
            self._board.closing = True
            self._board.condition.notify_all()
        self._thread.join()

    # -- the supervising thread ---------------------------------------------------------------------------------

    def _supervise(self) -> None:
        try:
            while not (self._board.closing or self._board.error):
                self._start_next()
                self._hand_out()
                connections = [w.connection for w in self._workers if w.connection is not None]
                if not connections:
                    time.sleep(_TICK_S)
                for connection in wait(connections, _TICK_S):
                    self._hear(next(w for w in self._workers if w.connection is connection))
                now = time.monotonic()
                for worker in self._workers:
                    if worker.job is not None and now > worker.deadline:
                        limit = self._limits.job_s if worker.proven else self._limits.first_job_s
                        self._replace(worker, f"took longer than {limit:g} s over job {worker.job}")
        # Whatever goes wrong here, the owner must not wait for ever.
        except Exception as error:
            self._fail(SimpickError(f"the worker pool failed: {error!r}\n{traceback.format_exc()}"))
        finally:
            for worker in self._workers:
                self._end(worker)

    def _start_next(self) -> None:
        """Start one process, unless one has yet to prove itself."""
        if any(w.process is not None and not w.proven for w in self._workers):
            return
        hopeful = [w for w in self._workers if w.failures < self._limits.failures]
        if not hopeful:
            self._fail(
                SimpickError(
                    f"none of {len(self._workers)} worker processes works; the last one {self._last_failure}. Try"
                    " fewer workers, or none, which shows the cause where it arises; `simpick doctor` checks OpenGL"
                )
            )
            return
        worker = next((w for w in hopeful if w.process is None), None)
        if worker is None or not self._next_job():
            return
        context = multiprocessing.get_context("spawn")
        worker.connection, theirs = context.Pipe()
        worker.process = context.Process(target=_serve, args=(theirs, self._task), daemon=True)
        before = {name: os.environ.get(name) for name in _ONE_THREAD}
        os.environ.update(_ONE_THREAD)
        try:
            worker.process.start()
        finally:
            for name, value in before.items():
                os.environ.pop(name) if value is None else os.environ.__setitem__(name, value)
        # Only the process holds its end now, so that its death closes the connection.
        theirs.close()

    def _hand_out(self) -> None:
        for worker in self._workers:
            if worker.connection is None or worker.job is not None:
                continue
            job = self._next_job()
            if not job:
                return
            worker.job = job[0]
            worker.deadline = time.monotonic() + (self._limits.job_s if worker.proven else self._limits.first_job_s)
            try:
                worker.connection.send(worker.job)
            except OSError:
                self._replace(worker, "died while it waited for a job")

    def _next_job(self) -> list[int]:
        """Return the first wanted job that nobody has begun; nothing if there is none."""
        begun = {w.job for w in self._workers}
        with self._board.condition:
            return [job for job in self._board.wanted if job not in self._board.done and job not in begun][:1]

    def _hear(self, worker: _Worker) -> None:
        """Take a worker's answer: None for a job that is done, or what it raised."""
        assert worker.connection is not None and worker.process is not None
        try:
            answer = worker.connection.recv()
        except (EOFError, OSError):
            worker.process.join(1.0)
            self._replace(worker, f"died (exit code {worker.process.exitcode}) over job {worker.job}")
            return
        job, worker.job, worker.proven, worker.failures = worker.job, None, True, 0
        if answer is not None:
            self._fail(answer)
            return
        assert job is not None
        with self._board.condition:
            self._board.done.add(job)
            self._board.condition.notify_all()

    def _replace(self, worker: _Worker, cause: str) -> None:
        """End a worker that died or hung; its place is filled again while there is hope."""
        self.replaced += 1
        self._last_failure = cause
        job = worker.job
        self._end(worker)
        worker.failures += 1
        if job is not None:
            self._ended[job] = self._ended.get(job, 0) + 1
            # A job is blamed only where others work; otherwise it is the workers that do not.
            if self._ended[job] >= self._limits.failures and self._board.done:
                self._fail(SimpickError(f"job {job} ended {self._ended[job]} worker processes; the last one {cause}"))

    def _end(self, worker: _Worker) -> None:
        if worker.process is not None:
            worker.process.kill()
            worker.process.join(5.0)
        if worker.connection is not None:
            worker.connection.close()
        worker.process = worker.connection = worker.job = None
        worker.proven = False

    def _fail(self, error: SimpickError) -> None:
        with self._board.condition:
            self._board.error = error
            self._board.condition.notify_all()


def _serve(connection: Connection, task: Callable[[int], object]) -> None:
    """Do jobs until the connection closes; runs in the worker's process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        while True:
            job = connection.recv()
            answer: SimpickError | None = None
            try:
                task(job)
            except SimpickError as error:
                answer = error
            except Exception as error:
                answer = SimpickError(f"job {job} failed in its worker: {error!r}\n{traceback.format_exc()}")
            connection.send(answer)
    # The owner has closed its end, or is gone.
    except (EOFError, OSError):
        return
