"""Speed of vector environments: episodes per hour against the number of environments."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from simpick.envs.bin_pick_vector import BinPickVectorEnv
from simpick.errors import ConfigError
from simpick.experiments.config import RunConfig
from simpick.experiments.episodes import make_scene_config
from simpick.experiments.perceptions import make_vector_perceptions
from simpick.policies import VectorPickPolicy


@dataclass(frozen=True)
class VectorSpeed:
    """Work of `num_envs` environments, and the time it took."""

    num_envs: int
    episodes: int
    """Ended while the clock ran."""
    attempts: int
    """Attempts while the clock ran, including those of unfinished episodes."""
    wall_s: float
    """Includes filling bins, but not starting the workers and filling the first bins."""
    decide_s: float
    """Spent in this process on perception and planning, while the environments wait."""

    @property
    def episodes_per_hour(self) -> float:
        """Return the number of episodes that end per hour."""
        return 3600 * self.episodes / self.wall_s

    @property
    def attempts_per_hour(self) -> float:
        """Return the number of attempts per hour: a steadier figure than episodes, where few have ended."""
        return 3600 * self.attempts / self.wall_s


def measure_vector(config: RunConfig, num_envs: int) -> VectorSpeed:
    """Pick bins in `num_envs` environments until ``config.episodes`` times as many episodes have ended.

    Raises:
        ConfigError: `num_envs` is below 1.
    """
    if num_envs < 1:
        raise ConfigError(f"envs must be numbers of 1 or more, got {num_envs}")
    envs = BinPickVectorEnv(
        num_envs, scene_config=make_scene_config(config), max_consecutive_failures=config.max_consecutive_failures
    )
    try:
        rngs = [np.random.default_rng([config.seed + k, 1]) for k in range(num_envs)]
        policy = VectorPickPolicy(make_vector_perceptions(config, envs, rngs), envs.parts, envs.scene_config)
        observations, _ = envs.reset(seed=config.seed)
        policy.act(observations)  # Fills caches and compiles, as the first bins did in the workers.
        observations, _ = envs.reset(seed=config.seed)
        episodes = attempts = 0
        decide_s = 0.0
        ended = np.zeros(num_envs, bool)
        start = time.perf_counter()
        while episodes < config.episodes * num_envs:
            attempts += int(np.count_nonzero(~ended))
            deciding = time.perf_counter()
            actions = policy.act(observations, ended)
            decide_s += time.perf_counter() - deciding
            observations, _, terminated, truncated, _ = envs.step(actions)
            ended = terminated | truncated
            episodes += int(np.count_nonzero(ended))
        return VectorSpeed(num_envs, episodes, attempts, time.perf_counter() - start, decide_s)
    finally:
        envs.close()
