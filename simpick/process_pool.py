"""Worker processes on this machine."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from concurrent.futures import ProcessPoolExecutor


def spawned_pool(workers: int) -> ProcessPoolExecutor:
    """Return a pool whose workers share the machine's cores between them.

    Its processes are spawned, because a forked child would share its parent's OpenGL context. They end with this
    process, however it ends: a pool's workers would otherwise outlive one that is killed, and wait for ever.
    """
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(workers, mp_context=context, initializer=_begin, initargs=(workers,))


def _begin(workers: int) -> None:
    """Prepare a worker."""
    _share_cores(workers)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    # Terminated rather than ended at once, so that a recording that is open is closed.
    os.kill(os.getpid(), signal.SIGTERM)


def _share_cores(workers: int) -> None:
    """Keep libraries that are loaded later, such as torch, to this worker's share of the cores."""
    os.environ.setdefault("OMP_NUM_THREADS", str(max(1, (os.cpu_count() or 1) // workers)))
