"""The shards and queries of each step, which depend only on seed and step, so that a run can resume exactly."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int

from simpick.training.config import TrainConfig


def window_at(config: TrainConfig, step: int) -> range:
    """Return the indices of the shards that a step may draw from."""
    passed = int(step * config.batch / (config.repeats_per_query * config.data.queries))
    stop = max(config.min_ready_shards, config.parts) + passed
    return range(max(0, stop - config.window), stop)


def step_rng(config: TrainConfig, step: int, rank: int) -> np.random.Generator:
    """Return the random generator of a step's data."""
    return np.random.default_rng([config.seed, 7, rank, step])


def draw_shards(config: TrainConfig, step: int, rng: np.random.Generator) -> list[int]:
    """Return the indices of the shards of a step."""
    window = window_at(config, step)
    return [int(window[k]) for k in rng.choice(len(window), config.parts, replace=False)]


def draw_queries(count: int, wanted: int, rng: np.random.Generator) -> Int[np.ndarray, "wanted"]:
    """Return indices of a shard's queries; with repetition if there are too few."""
    return rng.choice(count, wanted, replace=count < wanted)
