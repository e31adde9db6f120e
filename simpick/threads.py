"""Threads of numerical libraries and of software OpenGL: how many there are, and how they wait.

Libraries read environment variables once, when they load or start their threads, so these are set first. A program
that uses simpick as a library calls `configure_threads` before it imports torch::

    from simpick.threads import configure_threads

    configure_threads()

What the user has set in the environment has priority everywhere.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "LP_NUM_THREADS")
"""Numbers of threads of OpenMP (torch), OpenBLAS (NumPy), MKL and software OpenGL."""
WAIT_VARIABLE = "OMP_WAIT_POLICY"
_CORE_LISTS = Path("/sys/devices/system/cpu")
_QUOTA = Path("/sys/fs/cgroup/cpu.max")

_own: dict[str, str] = {}
"""What `configure_threads` has set, which is no wish of the user's."""


def usable_cores() -> int:
    """Return how many physical cores this process may use: those of its affinity, within a container's quota."""
    if hasattr(os, "sched_getaffinity"):
        logical = os.sched_getaffinity(0)
        cores = len({_siblings(cpu) for cpu in logical})
    else:
        cores = os.cpu_count() or 1
    with suppress(OSError, ValueError):
        quota, period = _QUOTA.read_text().split()
        cores = min(cores, int(quota) // int(period))
    return max(1, cores)


def configure_threads() -> None:
    """Let OpenMP's threads sleep while they wait, and start as many as there are usable cores.

    Threads that spin lose their cores to busy neighbours while others wait for them. Call it before torch is imported;
    later it has no effect in this process, only in those that it starts.
    """
    defaults = {WAIT_VARIABLE: "PASSIVE", "OMP_NUM_THREADS": str(usable_cores())}
    _own.update({name: value for name, value in defaults.items() if name not in os.environ})
    for name, value in _own.items():
        os.environ.setdefault(name, value)


@contextmanager
def limited_threads(threads: int) -> Iterator[None]:
    """Limit the threads of processes that start in this context, except where the user has set a number."""
    before = {name: os.environ.get(name) for name in VARIABLES}
    ours = [name for name, value in before.items() if value is None or value == _own.get(name)]
    os.environ.update(dict.fromkeys(ours, str(threads)))
    try:
        yield
    finally:
        for name in ours:
            value = before[name]
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _siblings(cpu: int) -> str:
    """Return which logical cores share a physical one with this; where the system does not say, it is alone."""
    with suppress(OSError):
        return (_CORE_LISTS / f"cpu{cpu}" / "topology" / "thread_siblings_list").read_text().strip()
    return str(cpu)
