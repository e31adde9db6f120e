"""A time limit for code that may hang, such as another package's plug-in.

An alarm of the operating system interrupts the main thread's Python code, sleeping and waiting for files or sockets
included, and raises an error in it. What it cannot interrupt:

- native code that does not return to the interpreter: the error is raised as soon as it does;
- code outside the main thread, and any code on Windows: the error is raised once the code has ended.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from simpick.errors import ConfigError

VARIABLE = "SIMPICK_TIME_LIMIT_S"
"""The environment variable that sets the limit of an answer."""
DEFAULT_S = 600.0
"""Per image: ten times and more what shipped estimators take for 50 parts on two busy cores."""
_REPEAT_S = 1.0


class TimeLimitError(BaseException):
    """The time is over. No `Exception`, so that the code inside does not take it for an error of its own."""


def answer_limit_s() -> float:
    """Return how long a plug-in may take per image, in seconds.

    Raises:
        ConfigError: the environment variable does not hold a positive number.
    """
    text = os.environ.get(VARIABLE, "")
    try:
        limit_s = float(text) if text else DEFAULT_S
    except ValueError:
        limit_s = float("nan")
    if not 0 < limit_s < float("inf"):
        raise ConfigError(f"{VARIABLE} must be a number of seconds above 0, got {text!r}")
    return limit_s


@contextmanager
def time_limit(limit_s: float) -> Iterator[None]:
    """Raise `TimeLimitError` in the code inside once it has run for this long.

    An alarm that was set outside is kept, and may interrupt the code earlier.
    """
    start = time.monotonic()
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
        yield
        if time.monotonic() - start > limit_s:
            raise TimeLimitError
        return
    outer_s, outer_interval_s = signal.getitimer(signal.ITIMER_REAL)
    if 0 < outer_s <= limit_s:
        yield
        return
    outer_handler = signal.signal(signal.SIGALRM, _raise)
    # Again and again, for code that catches everything.
    signal.setitimer(signal.ITIMER_REAL, limit_s, _REPEAT_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, outer_handler)
        if outer_s > 0:
            left_s = outer_s - (time.monotonic() - start)
            signal.setitimer(signal.ITIMER_REAL, max(left_s, 1e-3), outer_interval_s)


def _raise(signum: int, frame: FrameType | None) -> None:
    raise TimeLimitError
