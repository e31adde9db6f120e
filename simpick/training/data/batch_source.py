"""`BatchSource`: the batches of all steps in order, assembled in advance by threads from streamed shards."""

from __future__ import annotations

import dataclasses
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from simpick.closing import Closing
from simpick.estimators.raypose.network.config import RayPoseConfig
from simpick.training.config import TrainConfig
from simpick.training.data.batches import TrainingBatch, make_batch
from simpick.training.data.data_order import draw_queries, draw_shards, step_rng, window_at
from simpick.training.data.shard import Shard
from simpick.training.data.shard_stream import ShardStream
from simpick.training.distributed import Distributed
from simpick.training.resources import Resources


class BatchSource(Closing):
    """Batches that depend only on the configuration and the number of the step. A context manager."""

    def __init__(
        self,
        config: TrainConfig,
        network: RayPoseConfig,
        folder: Path,
        resources: Resources,
        processes: Distributed,
        step: int,
    ) -> None:
        """Start at `step`; each of several processes has its own shards."""
        self._config, self._rank = config, processes.rank
        self._network = dataclasses.replace(network, templates=config.templates)
        data = dataclasses.replace(config.data, seed=config.data.seed + processes.rank)
        self._first = window_at(config, step).start
        self._stream = ShardStream(
            folder,
            data,
            split="train",
            workers=resources.renderers,
            prefetch=max(2, 2 * resources.renderers) if resources.renderers else 0,
            start=self._first,
            keep=resources.shards is not None,
        )
        self._shards: dict[int, Shard] = {}
        self._lock = threading.Lock()
        self._pool = ThreadPoolExecutor(max(1, resources.loaders), thread_name_prefix="loader")
        self._prefetch = 2 * max(1, resources.loaders)
        self._futures: dict[int, Future[TrainingBatch]] = {}
        self._waited_s, self._since = 0.0, time.perf_counter()

    def get(self, step: int) -> TrainingBatch:
        """Return the batch of a step, while the next ones are made in the background."""
        for k in range(step, step + self._prefetch + 1):
            if k not in self._futures:
                self._futures[k] = self._pool.submit(self._make, k)
        start = time.perf_counter()
        batch = self._futures.pop(step).result()
        self._waited_s += time.perf_counter() - start
        return batch

    def waiting_share(self) -> float:
        """Return the share of the time since the last call that was spent waiting for data."""
        now = time.perf_counter()
        share = self._waited_s / max(now - self._since, 1e-9)
        self._waited_s, self._since = 0.0, now
        return share

    def close(self) -> None:
        """Stop threads and renderers; may be called more than once."""
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._stream.close()

    def _make(self, step: int) -> TrainingBatch:
        config, rng = self._config, step_rng(self._config, step, self._rank)
        shards = [self._shard(index) for index in draw_shards(config, step, rng)]
        self._forget_below(window_at(config, step).start)
        each = config.batch // config.parts
        queries = [draw_queries(len(shard), each, rng) for shard in shards]
        return make_batch(shards, queries, self._network, rng, augmentation=config.augmentation)

    def _shard(self, index: int) -> Shard:
        with self._lock:
            if index not in self._shards:
                self._shards[index] = self._stream.get(index)
            return self._shards[index]

    def _forget_below(self, index: int) -> None:
        # Batches that are made at the same time may still need a few earlier shards.
        with self._lock:
            while self._first < index - self._config.parts:
                self._shards.pop(self._first, None)
                self._stream.release(self._first)
                self._first += 1
