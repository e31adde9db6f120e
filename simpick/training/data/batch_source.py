"""`BatchSource`: the batches of all steps in order: planned in advance by loader processes, sampled on the device."""

from __future__ import annotations

import dataclasses
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path

import numpy as np

from simpick.closing import Closing
from simpick.estimators.raypose.network.config import RayPoseConfig
from simpick.training.config import TrainConfig
from simpick.training.data.batch_plan import PartPlan, plan_batch
from simpick.training.data.batches import ShardImages, TrainingBatch, sample_batch
from simpick.training.data.data_order import draw_queries, draw_shards, step_rng, window_at
from simpick.training.data.shard import Shard
from simpick.training.data.shard_stream import ShardStream
from simpick.training.distributed import Distributed
from simpick.training.resources import Resources
from simpick.workers import UNLIMITED, WorkerPool


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
        self._config, self._rank, self._device = config, processes.rank, processes.device
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
        self._images: dict[int, ShardImages] = {}
        # Guards the dictionaries; each shard has a lock of its own, so that several are read at the same time.
        self._lock = threading.Lock()
        self._reading: dict[int, threading.Lock] = {}
        self._planners = WorkerPool(resources.loaders, UNLIMITED, threads=1) if resources.loaders else None
        ahead = 2 * max(1, resources.loaders)
        # Threads wait for shards and plans; one more reads the next step's shards in the meantime.
        self._pool = ThreadPoolExecutor(ahead, thread_name_prefix="loader")
        self._prefetch = ahead
        self._plans: dict[int, Future[tuple[list[int], list[PartPlan]]]] = {}
        self._waited_s, self._since = 0.0, time.perf_counter()

    def get(self, step: int) -> TrainingBatch:
        """Return the batch of a step, while the next ones are planned in the background."""
        for k in range(step, step + self._prefetch + 1):
            if k not in self._plans:
                self._plans[k] = self._pool.submit(self._plan, k)
        start = time.perf_counter()
        indices, plan = self._plans.pop(step).result()
        images = [self._shard(index) for index in indices]
        self._waited_s += time.perf_counter() - start
        return sample_batch(images, plan, self._network)

    def waiting_share(self) -> float:
        """Return the share of the time since the last call that was spent waiting for data."""
        now = time.perf_counter()
        share = self._waited_s / max(now - self._since, 1e-9)
        self._waited_s, self._since = 0.0, now
        return share

    def close(self) -> None:
        """Stop threads, loaders and renderers; may be called more than once."""
        self._pool.shutdown(wait=False, cancel_futures=True)
        if self._planners is not None:
            self._planners.close()
        self._pool.shutdown(wait=True)
        self._stream.close()

    def _plan(self, step: int) -> tuple[list[int], list[PartPlan]]:
        """Return the shards of a step, which are loaded now, and its plan."""
        config = self._config
        indices = draw_shards(config, step, step_rng(config, step, self._rank))
        for index in indices:
            self._shard(index)
        self._forget_below(window_at(config, step).start)
        paths = tuple(self._stream.path(index) for index in indices)
        arguments = (config, self._network, step, self._rank, paths)
        if self._planners is not None:
            return indices, self._planners.submit(plan_step, *arguments).result()
        return indices, _plan_of(config, self._network, step, self._rank, [self._shard(k).shard for k in indices])

    def _shard(self, index: int) -> ShardImages:
        with self._lock:
            reading = self._reading.setdefault(index, threading.Lock())
        with reading:
            images = self._images.get(index)
            if images is None:
                images = self._images[index] = ShardImages.of(self._stream.get(index), self._device)
            return images

    def _forget_below(self, index: int) -> None:
        # Batches that are made at the same time may still need a few earlier shards.
        with self._lock:
            while self._first < index - self._config.parts:
                self._images.pop(self._first, None)
                self._reading.pop(self._first, None)
                self._stream.release(self._first)
                self._first += 1


def plan_step(
    config: TrainConfig, network: RayPoseConfig, step: int, rank: int, paths: tuple[Path, ...]
) -> list[PartPlan]:
    """Return the plan of a step of these shards; runs in a loader process, which keeps the shards it has read."""
    return _plan_of(config, network, step, rank, [_read(path) for path in paths])


@lru_cache(maxsize=512)
def _read(path: Path) -> Shard:
    """Return a shard without the images that no plan needs."""
    shard = Shard.load(path)
    templates = dataclasses.replace(shard.templates, rgb=_blank(shard.templates.rgb))
    return dataclasses.replace(shard, rgb=_blank(shard.rgb), relief_m=_blank(shard.relief_m), templates=templates)


def _blank(image: np.ndarray) -> np.ndarray:
    """Return zeros of this shape that take no memory."""
    return np.broadcast_to(np.zeros((), image.dtype), image.shape)


def _plan_of(config: TrainConfig, network: RayPoseConfig, step: int, rank: int, shards: list[Shard]) -> list[PartPlan]:
    rng = step_rng(config, step, rank)
    draw_shards(config, step, rng)  # Comes first in the step's random numbers.
    each = config.batch // config.parts
    queries = [draw_queries(len(shard), each, rng) for shard in shards]
    return plan_batch(shards, queries, network, rng, config.augmentation)
