"""`CoreTime`: how long the threads of this process ran, and how long they were ready but had no core to run on.

On a loaded machine wall-clock times, and picks per hour with them, say more about the neighbours than about the code.
Linux counts both for each thread (``schedstat``), so a disturbed measurement can be labelled.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

DISTURBED = 0.1
"""Share of waiting above which a measurement counts as disturbed."""
_THREADS = Path("/proc/self/task")


@dataclass(frozen=True)
class CoreTime:
    """Times of all threads of a process, summed; both 0 where the system does not count them."""

    run_s: float = 0.0
    wait_s: float = 0.0
    """Ready to run, while other threads or processes had the cores."""

    def __add__(self, other: CoreTime) -> CoreTime:
        return CoreTime(self.run_s + other.run_s, self.wait_s + other.wait_s)

    @property
    def waiting(self) -> float:
        """Return the share of the time in which threads had to wait for a core, in [0, 1]."""
        total_s = self.run_s + self.wait_s
        return self.wait_s / total_s if total_s > 0 else 0.0

    @property
    def is_disturbed(self) -> bool:
        """Return whether times that were measured meanwhile are too long to be compared."""
        return self.waiting > DISTURBED


@contextmanager
def measured_core_time() -> Iterator[Callable[[], CoreTime]]:
    """Measure the threads of this process from here on; yields a function that returns the time so far."""
    before = _by_thread()

    def so_far() -> CoreTime:
        now = _by_thread()
        begun = [before.get(thread, CoreTime()) for thread in now]
        run_s = sum(time.run_s for time in now.values()) - sum(time.run_s for time in begun)
        wait_s = sum(time.wait_s for time in now.values()) - sum(time.wait_s for time in begun)
        return CoreTime(max(run_s, 0.0), max(wait_s, 0.0))

    yield so_far


def total(times: Iterable[CoreTime]) -> CoreTime:
    """Return the sum."""
    return sum(times, CoreTime())


def disturbance_lines(times: Mapping[str, CoreTime]) -> list[str]:
    """Return for the terminal which of these measurements, by name, were disturbed; nothing if none was."""
    disturbed = [f"{name} {time.waiting:.0%}" for name, time in times.items() if time.is_disturbed]
    if not disturbed:
        return []
    return [
        f"loaded machine: share of time spent waiting for a core: {', '.join(disturbed)}. Times are longer, and picks "
        "per hour fewer, than with nothing else running"
    ]


def _by_thread() -> dict[str, CoreTime]:
    times = {}
    with suppress(OSError):
        for thread in _THREADS.iterdir():
            # A thread may end meanwhile.
            with suppress(OSError, ValueError):
                run_ns, wait_ns, _ = (thread / "schedstat").read_text().split()
                times[thread.name] = CoreTime(int(run_ns) * 1e-9, int(wait_ns) * 1e-9)
    return times
