"""`ShardStream`: shards in order, made in advance by renderer processes and stored on disk."""

from __future__ import annotations

import re
import threading
import time
from concurrent.futures import Future
from functools import partial
from pathlib import Path

import mujoco

from simpick.caching import cache_key
from simpick.closing import Closing
from simpick.errors import ConfigError, DatasetError
from simpick.training.data.data_config import DataConfig, Split
from simpick.training.data.shard import Shard
from simpick.training.data.shard_factory import VERSION, make_shard
from simpick.workers import WorkerLimits, WorkerPool


class ShardStream(Closing):
    """Shards by index; a context manager. Index k always gives the same shard, so a run can resume at k.

    Files are named by split, configuration and index. Undamaged files of an earlier run with the same configuration are
    used again; those of another configuration are left alone.
    """

    def __init__(
        self,
        folder: Path,
        config: DataConfig,
        *,
        split: Split,
        workers: int = 1,
        prefetch: int = 4,
        start: int = 0,
        keep: bool = False,
        limits: WorkerLimits | None = None,
    ) -> None:
        """Start to make the shards from `start`.

        Args:
            folder: Where they are stored, about 5 MB each with the default configuration.
            config: The settings of the data.
            split: Which of the two disjoint sets of parts to draw from.
            workers: Renderer processes; 0 makes each shard in this process on request.
            prefetch: How many shards after the last requested one are made in advance.
            start: The first index that will be requested; files of lower indices are deleted.
            keep: Never delete files.
            limits: Time limits of the workers.

        Raises:
            ConfigError: a number is negative, or there are workers and `prefetch` is 0.
        """
        if workers < 0 or prefetch < 0 or start < 0:
            raise ConfigError(
                f"workers, prefetch and start must not be negative, got {workers}, {prefetch} and {start}"
            )
        if workers and not prefetch:
            raise ConfigError(f"prefetch must be 1 or more with {workers} workers, got 0")
        self.folder, self.prefetch, self.keep = folder, prefetch, keep
        self.waited_s = 0.0
        """Seconds spent in `get` so far."""
        self._prefix = f"{split}-{cache_key(VERSION, repr(config), mujoco.__version__)}"
        if not keep:
            self._delete_below(start)
        self._write = partial(write_shard, config, split, folder, self._prefix)
        # One thread each: the other cores are for training. Staggered, because each first shard starts a renderer.
        self._pool = WorkerPool(workers, limits, threads=1, staggered=True) if workers else None
        self._calls: dict[int, Future[object]] = {}
        self._aiming = threading.Lock()
        self._aim(start)

    def path(self, index: int) -> Path:
        """Return the file of a shard."""
        return _path(self.folder, self._prefix, index)

    @property
    def worker_pids(self) -> list[int]:
        """Return the process ids of the workers that run now."""
        return self._pool.pids if self._pool is not None else []

    @property
    def workers_replaced(self) -> int:
        """Return how many workers died or hung so far."""
        return self._pool.replaced if self._pool is not None else 0

    def get(self, index: int) -> Shard:
        """Return a shard as soon as it is ready, while the next ones are made in the background.

        A damaged file is made again.

        Raises:
            SimpickError: it cannot be made, or no worker works.
        """
        start = time.perf_counter()
        try:
            self._aim(index)
            self._make(index)
            try:
                return Shard.load(self.path(index))
            except DatasetError:
                self.path(index).unlink(missing_ok=True)
                self._aim(index)
                self._make(index)
                return Shard.load(self.path(index))
        finally:
            self.waited_s += time.perf_counter() - start

    def release(self, index: int) -> None:
        """Delete a shard that is no longer needed, unless the stream keeps its files."""
        if not self.keep:
            self.path(index).unlink(missing_ok=True)

    def close(self) -> None:
        """Stop the workers; finished shards remain for the next run. May be called more than once."""
        if self._pool is not None:
            self._pool.close()

    def _make(self, index: int) -> None:
        if self.path(index).exists():
            return
        if self._pool is None:
            self._write(index)
        else:
            with self._aiming:
                call = self._calls[index]
            call.result()

    def _aim(self, index: int) -> None:
        """Submit the missing shards from this index to the workers."""
        if self._pool is None:
            return
        with self._aiming:
            self._submit_from(index)

    def _submit_from(self, index: int) -> None:
        assert self._pool is not None
        wanted = range(index, index + 1 + self.prefetch)
        for k in self._calls.keys() - wanted:
            self._calls.pop(k).cancel()
        for k in wanted:
            call = self._calls.get(k)
            # Made again if its file was deleted since, but not if it failed.
            if not self.path(k).exists() and (call is None or (call.done() and call.exception() is None)):
                self._calls[k] = self._pool.submit(self._write, k)

    def _delete_below(self, start: int) -> None:
        for path in self.folder.glob(f"{self._prefix}-*.shard"):
            number = re.fullmatch(r".*-(\d+)", path.stem)
            if number is not None and int(number.group(1)) < start:
                path.unlink(missing_ok=True)


def write_shard(config: DataConfig, split: Split, folder: Path, prefix: str, index: int) -> None:
    """Make a shard and write it to its file; raises OutputError."""
    make_shard(config, index, split=split).save(_path(folder, prefix, index))


def _path(folder: Path, prefix: str, index: int) -> Path:
    return folder / f"{prefix}-{index:07d}.shard"
