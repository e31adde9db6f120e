"""`WorkerPool`: calls in spawned processes that may hang or die, and are then replaced.

Written here because pebble, whose pools also have time limits, starts all its processes at the same time and restarts
dead ones without end; processes that render have been seen to hang when many of them start together.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import nullcontext
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.reduction import ForkingPickler
from typing import Any, TypeVar

from simpick.closing import Closing
from simpick.config import Config, PositiveFloat, PositiveInt
from simpick.errors import ConfigError, SimpickError
from simpick.threads import limited_threads, usable_cores

_GRACE_S = 5.0
"""Time between the request to terminate and the kill."""

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


class WorkerPool(Closing):
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
        self._limits = limits or WorkerLimits()
        self._threads = threads or max(1, usable_cores() // workers)
        self._starting = threading.Lock() if staggered else nullcontext()
        # Guards everything below.
        self._changed = threading.Condition()
        self._waiting: deque[_Call] = deque()
        self._processes: set[_Process] = set()
        self._error: SimpickError | None = None
        self._given_up = 0
        self._any_result = False
        self.replaced = 0
        """How many processes died or were killed because they hung."""
        self._supervisors = [threading.Thread(target=self._supervise, daemon=True) for _ in range(workers)]
        for supervisor in self._supervisors:
            supervisor.start()

    @property
    def pids(self) -> list[int]:
        """Return the process ids of the workers that run now."""
        with self._changed:
            return [process.pid for process in self._processes]

    def submit(self, function: Callable[..., _Result], *arguments: Any) -> Future[_Result]:
        """Return the future result of a call, which must be picklable; calls begin in the order of submission.

        The future raises the `SimpickError` that the call raised, a `SimpickError` with the traceback of any other
        exception, or `LostCallError`.

        Raises:
            SimpickError: the pool is closed or has failed.
        """
        future: Future[_Result] = Future()
        with self._changed:
            if self._error is not None:
                raise self._error
            self._waiting.append(_Call(function, arguments, future))
            self._changed.notify()
        return future

    def close(self) -> None:
        """End all workers now, whatever they do; may be called again."""
        self._fail(SimpickError("the worker pool is closed; make a new one"))
        # First a request, so that recordings that are open are closed.
        for end in ("terminate", "kill"):
            with self._changed:
                for process in self._processes:
                    getattr(process, end)()
            deadline = time.monotonic() + _GRACE_S
            for supervisor in self._supervisors:
                supervisor.join(max(0.0, deadline - time.monotonic()))

    # -- one supervising thread per worker -----------------------------------------------------------------------

    def _supervise(self) -> None:
        """Run calls in one process after another, until the pool is closed or this worker is given up."""
        process, failures, cause = None, 0, None
        while failures < self._limits.failures and (call := self._next_call()) is not None:
            if process is None:
                # With its first call, in which libraries are loaded and OpenGL contexts opened.
                with self._starting:
                    process = self._start()
                    cause = process.run(call, self._limits.first_call_s) if process else "was not started"
            else:
                cause = process.run(call, self._limits.call_s)
            if cause is None:
                failures, self._any_result = 0, True
            else:
                failures += 1
                process = self._end(process)
                self._lose(call, cause)
        self._end(process)
        if failures == self._limits.failures:
            self._give_up(cause)

    def _next_call(self) -> _Call | None:
        """Return the next call as soon as there is one; None if the pool is closed."""
        with self._changed:
            while self._error is None:
                while self._waiting:
                    call = self._waiting.popleft()
                    if call.losses or call.future.set_running_or_notify_cancel():
                        return call
                self._changed.wait()
        return None

    def _start(self) -> _Process | None:
        """Return a new process; None if the pool is closed."""
        with self._changed:
            if self._error is not None:
                return None
            process = _Process(self._threads)
            self._processes.add(process)
            return process

    def _end(self, process: _Process | None) -> None:
        if process is not None:
            process.end()
            with self._changed:
                self._processes.discard(process)

    def _lose(self, call: _Call, cause: str) -> None:
        """Let a call whose process was lost be repeated or fail."""
        call.losses += 1
        with self._changed:
            # A call is at fault only where others work; otherwise the workers are.
            is_at_fault = call.losses >= self._limits.failures and self._any_result
            if self._error is None:
                self.replaced += 1
                if not is_at_fault:
                    self._waiting.appendleft(call)
                    self._changed.notify()
                    return
        lost = LostCallError(f"{call.losses} worker processes were lost; the last one {cause}")
        call.future.set_exception(self._error or lost)

    def _give_up(self, cause: str | None) -> None:
        with self._changed:
            self._given_up += 1
        if self._given_up == len(self._supervisors):
            self._fail(
                LostCallError(
                    f"none of {self._given_up} worker processes works; the last one {cause}. Try fewer workers, or "
                    "none, which shows the cause where it arises; `simpick doctor` checks OpenGL"
                )
            )

    def _fail(self, error: SimpickError) -> None:
        """Accept no more calls, and let those that wait raise `error`."""
        with self._changed:
            self._error = self._error or error
            waiting, self._waiting = self._waiting, deque()
            self._changed.notify_all()
        for call in waiting:
            if call.losses or call.future.set_running_or_notify_cancel():
                call.future.set_exception(self._error)


class _Process:
    """A spawned process that runs one call at a time."""

    def __init__(self, threads: int) -> None:
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs,), daemon=True)
        with limited_threads(threads):
            self._process.start()
        # Only the process holds its end now, so that its death closes the connection.
        theirs.close()
        assert self._process.pid is not None
        self.pid: int = self._process.pid
        self.terminate, self.kill = self._process.terminate, self._process.kill

    def run(self, call: _Call, limit_s: float | None) -> str | None:
        """Complete a call; if the process died or hung instead, return how."""
        try:
            self._connection.send((call.function, call.arguments))
            if not self._connection.poll(limit_s):
                return f"took longer than {limit_s:g} s"
            result, error = self._connection.recv()
        except (EOFError, OSError):
            self._process.join(1.0)
            return f"died (exit code {self._process.exitcode})"
        except Exception as failure:
            result, error = None, SimpickError(f"a call or its result cannot be pickled: {failure!r}")
        if error is None:
            call.future.set_result(result)
        else:
            call.future.set_exception(error)
        return None

    def end(self) -> None:
        self.terminate()
        self._process.join(_GRACE_S)
        self.kill()
        self._process.join()
        self._connection.close()


def _serve(connection: Connection) -> None:
    """Run calls until the connection closes; runs in the worker's process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        while True:
            function, arguments = connection.recv()
            try:
                answer = ForkingPickler.dumps((function(*arguments), None))
            except SimpickError as error:
                answer = ForkingPickler.dumps((None, error))
            except Exception as error:
                failure = SimpickError(f"a worker process failed: {error!r}\n{traceback.format_exc()}")
                answer = ForkingPickler.dumps((None, failure))
            connection.send_bytes(answer)
    # The parent has closed its end, or is gone.
    except (EOFError, OSError):
        return


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    # A request rather than an exit, so that a recording that is open is closed.
    os.kill(os.getpid(), signal.SIGTERM)
