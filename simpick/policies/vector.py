"""Perception and picking for several bins at once: `PoseVectorObservation` and `VectorPickPolicy`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorObservationWrapper
from gymnasium.vector.utils import batch_space
from jaxtyping import Bool, Float32

from simpick.assets.part import Part
from simpick.envs.actions import ABSTAIN
from simpick.envs.bin_pick_vector import BinPickVectorEnv
from simpick.envs.observations import frame_from_observation
from simpick.envs.spaces import outcome_from_index
from simpick.errors import ConfigError
from simpick.policies.grasp_chooser import GraspChooser
from simpick.policies.perception import Percept, Perception, perceive_together
from simpick.policies.pick_policy import PickPolicy
from simpick.policies.pose_observation import check_can_be_perceived, pose_arrays, with_poses
from simpick.scene import SceneConfig


class PoseVectorObservation(VectorObservationWrapper):
    """`PoseObservation` for a `BinPickVectorEnv`: the estimator answers the images of all environments at once."""

    def __init__(self, env: BinPickVectorEnv, perceptions: Sequence[Perception]) -> None:
        """Wrap `env` and onboard its parts; `perceptions` holds one for each environment.

        What works from images alone should be one estimator in all of them. A detector must know its own bin:
        ``SegmentationDetector(instance_parts=partial(env.instance_part_names, k))``.

        Raises:
            ConfigError: `env` is not a `BinPickVectorEnv`, perceptions and environments differ in number, or
                `env` resets in the same step, which no wrapper of observations supports.
        """
        if not isinstance(env.unwrapped, BinPickVectorEnv):
            raise ConfigError(f"PoseVectorObservation needs a BinPickVectorEnv, got {type(env.unwrapped).__name__}")
        if env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP:
            raise ConfigError(
                "PoseVectorObservation needs autoreset_mode NextStep or Disabled, got SameStep, whose last "
                "observations would stay without poses; make the environment with another one"
            )
        check_count(perceptions, env.num_envs)
        check_can_be_perceived(env.single_observation_space, type(self).__name__)
        super().__init__(env)
        self.perceptions = tuple(perceptions)
        self.parts = env.unwrapped.parts
        self.percepts: list[Percept] = []
        """What perception saw last in each environment: for recording; empty before the first reset."""
        assert isinstance(env.single_observation_space, spaces.Dict)
        self.single_observation_space = with_poses(env.single_observation_space)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)
        for perception in self.perceptions:
            perception.onboard(self.parts)

    def observations(self, observations: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return the observations with the estimated poses added."""
        rows = [row(observations, k) for k in range(self.num_envs)]
        frames = [frame_from_observation(observation) for observation in rows]
        self.percepts = perceive_together(self.perceptions, frames, self.parts)
        arrays = [
            pose_arrays(percept, observation["T_world_camera"], self.parts)
            for percept, observation in zip(self.percepts, rows, strict=True)
        ]
        return {**observations, **{key: np.stack([a[key] for a in arrays]) for key in arrays[0]}}


class VectorPickPolicy:
    """A `PickPolicy` for each of several bins, which perceive all of them in one batch.

    Each remembers the failures of its own bin. An environment's first observation (no outcome yet) begins a new
    episode, so that environments that reset themselves need no call of `reset`.
    """

    def __init__(self, perceptions: Sequence[Perception], parts: Sequence[Part], config: SceneConfig) -> None:
        """Pick `parts` in several cells that `config` describes; `perceptions` holds one for each.

        Raises:
            ConfigError: there are no perceptions.
        """
        if not perceptions:
            raise ConfigError("perceptions must hold one for each environment, got none")
        chooser = GraspChooser(parts, config)
        self.policies = tuple(PickPolicy(perception, parts, config, chooser=chooser) for perception in perceptions)
        self.parts = tuple(parts)

    def __len__(self) -> int:
        return len(self.policies)

    def reset(self) -> None:
        """Forget the last episode of every environment."""
        for policy in self.policies:
            policy.reset()

    def act(
        self, observations: Mapping[str, np.ndarray], ended: Bool[np.ndarray, "n"] | None = None
    ) -> Float32[np.ndarray, "n 10"]:
        """Return an action for each environment.

        Environments that `ended` marks are not looked at and abstain: pass ``terminated | truncated`` of the step
        before, whose next action an environment that resets itself ignores.

        Raises:
            ConfigError: the observations are of another number of environments.
        """
        check_count(self.policies, len(observations["last_outcome"]))
        waiting = [k for k in range(len(self)) if ended is None or not ended[k]]
        rows = {k: row(observations, k) for k in waiting}
        for k, observation in rows.items():
            if outcome_from_index(int(observation["last_outcome"])) is None:
                self.policies[k].reset()
        percepts = perceive_together(
            [self.policies[k].perception for k in waiting],
            [frame_from_observation(rows[k]) for k in waiting],
            self.parts,
        )
        actions = np.tile(ABSTAIN, (len(self), 1))
        for k, percept in zip(waiting, percepts, strict=True):
            actions[k] = self.policies[k].decide(rows[k], percept)
        return actions


def row(observations: Mapping[str, np.ndarray], index: int) -> dict[str, Any]:
    """Return the observation of one environment."""
    return {key: values[index] for key, values in observations.items()}


def check_count(for_each: Sequence[Any], num_envs: int) -> None:
    """Raise `ConfigError` unless there is one thing for each environment."""
    if len(for_each) != num_envs:
        raise ConfigError(f"there must be one perception for each of the {num_envs} environments, got {len(for_each)}")
