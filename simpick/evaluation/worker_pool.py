"""Worker processes on this machine."""

from __future__ import annotations

import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor


def spawned_pool(workers: int) -> ProcessPoolExecutor:
    """Return a pool whose workers share the machine's cores between them.

    Its processes are spawned, because a forked child would share its parent's OpenGL context.
    """
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(workers, mp_context=context, initializer=_share_cores, initargs=(workers,))


def _share_cores(workers: int) -> None:
    """Keep libraries that are loaded later, such as torch, to this worker's share of the cores."""
    os.environ.setdefault("OMP_NUM_THREADS", str(max(1, (os.cpu_count() or 1) // workers)))
