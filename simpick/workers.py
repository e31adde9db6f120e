"""`WorkerPool`: calls in spawned processes that may hang or die, and are then replaced.

Written here because pebble, whose pools also have time limits, starts all its processes at the same time and restarts
dead ones without end; processes that render have been seen to hang when many of them start together.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, TypeVar

from simpick.config import Config, PositiveFloat, PositiveInt
from simpick.errors import ConfigError, SimpickError

_TICK_S = 0.1
_GRACE_S = 5.0
"""Time between the request to terminate and the kill."""
# Read when numerical libraries and software OpenGL are loaded.
_THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "LP_NUM_THREADS")

_Result = TypeVar("_Result")


class LostCallError(SimpickError, RuntimeError):
    """The process of a call died or hung, each time that the call was tried, or no process of the pool works."""


@dataclass(frozen=True)
class WorkerLimits(Config):
    """When a worker process counts as hung, and when it is given up."""

    first_call_s: PositiveFloat | None = 180.0
    """Longest time from a process's start to the end of its first call, imports and OpenGL included; None: no limit."""
    call_s: PositiveFloat | None = 120.0
    """Longest time of each later call; None: no limit."""
    failures: PositiveInt = 3
    """A worker whose processes died or hung this many times in a row is not started again, nor is a call repeated that
    lost this many processes."""


UNLIMITED = WorkerLimits(None, None, failures=2)
"""For calls that take as long as they take; one that ends its process is repeated once."""


@dataclass(eq=False)
class _Call:
    """A function, its arguments, and where its result goes."""

    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    future: Future[Any]
    losses: int = 0
    """Processes that died or hung during this call."""


@dataclass(eq=False)
class _Worker:
    """A slot for a process, and the process that fills it now."""

    process: BaseProcess | None = None
    connection: Connection | None = None
    call: _Call | None = None
    deadline: float = 0.0
    proven: bool = False
    """Whether this process has finished a call."""
    failures: int = 0
    """Processes in a row that ended without finishing one."""


class WorkerPool:
    """Runs submitted calls in up to `workers` spawned processes. A context manager.

    Processes are spawned, because a forked one would share its parent's OpenGL context. They ignore the interrupt
    signal, which the parent handles, and end with the parent, however it ends. A call whose process dies or exceeds
    its time limit is repeated in another process. A worker that keeps failing is given up: the pool continues with
    fewer.
    """

    def __init__(
        self, workers: int, limits: WorkerLimits | None = None, *, threads: int | None = None, staggered: bool = False
    ) -> None:
        """Make a pool, whose processes start when there are calls for them.

        Args:
            workers: Number of processes.
            limits: Time limits and tolerated failures.
            threads: Threads per process for numerical libraries; an equal share of the cores if None. Variables
                such as ``OMP_NUM_THREADS`` that are set already have priority.
            staggered: Start each process only when the one before it has finished its first call.

        Raises:
            ConfigError: `workers` is below 1.
        """
        if workers < 1:
            raise ConfigError(f"workers must be 1 or more, got {workers}")
        self._limits, self._staggered = limits or WorkerLimits(), staggered
        self._threads = threads or max(1, (os.cpu_count() or 1) // workers)
        self._workers = [_Worker() for _ in range(workers)]
        self._waiting: deque[_Call] = deque()
        self._lock = threading.Lock()
        self._closing = False
        self._any_result = False
        self._last_failure = ""
        self.replaced = 0
        """How many processes died or were killed because they hung."""
        self._thread = threading.Thread(target=self._supervise, name="worker-pool", daemon=True)
        self._thread.start()

    @property
    def pids(self) -> list[int]:
        """Return the process ids of the workers that run now."""
        return [w.process.pid for w in self._workers if w.process is not None and w.process.pid is not None]

    def submit(self, function: Callable[..., _Result], *arguments: Any) -> Future[_Result]:
        """Return the future result of a call, which must be picklable; calls begin in the order of submission.

        The future raises the `SimpickError` that the call raised, a `SimpickError` with the traceback of any other
        exception, or `LostCallError`.

        Raises:
            SimpickError: the pool is closed or has failed.
        """
        future: Future[_Result] = Future()
        with self._lock:
            if self._closing:
                raise SimpickError("the worker pool is closed; make a new one")
            self._waiting.append(_Call(function, arguments, future))
        return future

    def close(self) -> None:
        """End all workers now, whatever they do; may be called again."""
        with self._lock:
            self._closing = True
        self._thread.join()

    def __enter__(self) -> WorkerPool:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    # -- the supervising thread ---------------------------------------------------------------------------------

    def _supervise(self) -> None:
        error = SimpickError("the worker pool is closed; make a new one")
        try:
            while not self._closing:
                self._hand_out()
                self._start_next()
                connections = [w.connection for w in self._workers if w.connection is not None]
                if not connections:
                    time.sleep(_TICK_S)
                for connection in wait(connections, _TICK_S):
                    self._receive(next(w for w in self._workers if w.connection is connection))
                for worker in self._workers:
                    if worker.call is not None and time.monotonic() > worker.deadline:
                        self._replace(worker, f"took longer than {self._limit_s(worker):g} s")
        except LostCallError as failure:
            error = failure
        # Whatever goes wrong here, nobody must wait forever for a result.
        except Exception as failure:
            error = SimpickError(f"the worker pool failed: {failure!r}\n{traceback.format_exc()}")
        finally:
            with self._lock:
                self._closing = True
            unfinished = [*(w.call for w in self._workers if w.call is not None), *self._waiting]
            self._end(self._workers)
            for call in unfinished:
                if call.future.running() or call.future.set_running_or_notify_cancel():
                    call.future.set_exception(error)

    def _start_next(self) -> None:
        """Start one process if calls wait for it; raises `LostCallError` if every worker was given up."""
        hopeful = [w for w in self._workers if w.failures < self._limits.failures]
        if not hopeful:
            raise LostCallError(
                f"none of {len(self._workers)} worker processes works; the last one {self._last_failure}. Try fewer "
                "workers, or none, which shows the cause where it arises; `simpick doctor` checks OpenGL"
            )
        worker = next((w for w in hopeful if w.process is None), None)
        must_wait = self._staggered and any(w.process is not None and not w.proven for w in self._workers)
        if worker is None or must_wait or not self._waiting:
            return
        context = multiprocessing.get_context("spawn")
        worker.connection, theirs = context.Pipe()
        worker.process = context.Process(target=_serve, args=(theirs,), daemon=True)
        with _thread_limit(self._threads):
            worker.process.start()
        # Only the process holds its end now, so that its death closes the connection.
        theirs.close()

    def _hand_out(self) -> None:
        for worker in self._workers:
            if worker.connection is None or worker.call is not None:
                continue
            call = self._next_call()
            if call is None:
                return
            worker.call, worker.deadline = call, time.monotonic() + self._limit_s(worker)
            try:
                worker.connection.send((call.function, call.arguments))
            except OSError:
                self._replace(worker, "died while it waited for a call")

    def _next_call(self) -> _Call | None:
        with self._lock:
            while self._waiting:
                call = self._waiting.popleft()
                if call.losses or call.future.set_running_or_notify_cancel():
                    return call
        return None

    def _receive(self, worker: _Worker) -> None:
        """Take a worker's answer, which is what the call returned or raised."""
        assert worker.connection is not None and worker.process is not None
        try:
            result, error = worker.connection.recv()
        except (EOFError, OSError):
            worker.process.join(1.0)
            self._replace(worker, f"died (exit code {worker.process.exitcode})")
            return
        assert worker.call is not None
        future, worker.call, worker.proven, worker.failures = worker.call.future, None, True, 0
        self._any_result = True
        if error is None:
            future.set_result(result)
        else:
            future.set_exception(error)

    def _replace(self, worker: _Worker, cause: str) -> None:
        """End a worker that died or hung; its slot is filled again until it is given up."""
        self.replaced += 1
        self._last_failure = cause
        call = worker.call
        self._end([worker])
        worker.failures += 1
        if call is None:
            return
        call.losses += 1
        # A call is at fault only where others work; otherwise the workers are.
        if call.losses >= self._limits.failures and self._any_result:
            call.future.set_exception(LostCallError(f"{call.losses} worker processes were lost; the last one {cause}"))
        else:
            with self._lock:
                self._waiting.appendleft(call)

    def _limit_s(self, worker: _Worker) -> float:
        limit_s = self._limits.call_s if worker.proven else self._limits.first_call_s
        return math.inf if limit_s is None else limit_s

    @staticmethod
    def _end(workers: list[_Worker]) -> None:
        processes = [w.process for w in workers if w.process is not None]
        # First a request, so that a recording that is open is closed.
        for process in processes:
            process.terminate()
        deadline = time.monotonic() + _GRACE_S
        for process in processes:
            process.join(max(0.0, deadline - time.monotonic()))
            process.kill()
            process.join(_GRACE_S)
        for worker in workers:
            if worker.connection is not None:
                worker.connection.close()
            worker.process = worker.connection = worker.call = None
            worker.proven = False


@contextmanager
def _thread_limit(threads: int) -> Iterator[None]:
    """Limit the threads of processes that start in this context, where the environment sets no number."""
    added = {name: str(threads) for name in _THREAD_VARIABLES if name not in os.environ}
    os.environ.update(added)
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]


def _serve(connection: Connection) -> None:
    """Run calls until the connection closes; runs in the worker's process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        while True:
            function, arguments = connection.recv()
            result, error = None, None
            try:
                result = function(*arguments)
            except SimpickError as raised:
                error = raised
            except Exception as raised:
                error = SimpickError(f"a worker process failed: {raised!r}\n{traceback.format_exc()}")
            connection.send((result, error))
    # The parent has closed its end, or is gone.
    except (EOFError, OSError):
        return


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    # A request rather than an exit, so that a recording that is open is closed.
    os.kill(os.getpid(), signal.SIGTERM)
