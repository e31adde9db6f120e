"""`PoseObservation`: adds estimated poses to the observation, so that an agent can learn from them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from jaxtyping import Float

from simpick.assets.part import Part
from simpick.envs.bin_pick import BinPickEnv
from simpick.envs.observations import frame_from_observation
from simpick.envs.spaces import FAR_M, ObservationItem
from simpick.errors import ConfigError
from simpick.policies.perception import Percept, Perception
from simpick.scene.config import MAX_PARTS

MAX_SCORE = 1e6
"""Scores are cut off at plus and minus this, for a space needs bounds; no shipped estimator comes close."""

POSE_TABLE: tuple[ObservationItem, ...] = (
    ObservationItem(
        "estimated_poses",
        "T_world_part of each estimate, in the order of `estimated_parts`; zeros pad",
        "m",
        spaces.Box(-FAR_M, FAR_M, (MAX_PARTS, 4, 4), np.float64),
    ),
    ObservationItem(
        "estimated_parts",
        "for each estimate the index of its part in `BinPickEnv.part_names`; -1 pads",
        "",
        spaces.Box(-1, MAX_PARTS - 1, (MAX_PARTS,), np.int16),
    ),
    ObservationItem(
        "estimate_scores",
        "the estimator's score of each estimate, a higher score is more certain; zeros pad",
        "",
        spaces.Box(-MAX_SCORE, MAX_SCORE, (MAX_PARTS,), np.float32),
    ),
)
"""What the wrapper adds to an observation."""

NEEDED = ("rgb", "depth", "segmentation", "camera_matrix", "T_world_camera")
"""What perception needs of an observation."""


class PoseObservation(gymnasium.ObservationWrapper):
    """Runs perception on every observation of `simpick/BinPick-v0` and adds the poses that it estimates.

    Estimates are in perception's order, the detector's most certain first; at most `MAX_PARTS` are kept. The
    environment's own observations are unchanged; `POSE_TABLE` lists what is added.
    """

    def __init__(self, env: gymnasium.Env, perception: Perception) -> None:
        """Wrap `env` and onboard its parts, which may render templates.

        Raises:
            ConfigError: `env` is not a `BinPickEnv`, possibly wrapped, whose observation still has the camera's
                image, depth and instances.
        """
        super().__init__(env)
        if not isinstance(env.unwrapped, BinPickEnv):
            raise ConfigError(
                f"PoseObservation needs an environment simpick/BinPick-v0, got {type(env.unwrapped).__name__}"
            )
        check_can_be_perceived(env.observation_space, type(self).__name__)
        self.perception = perception
        self.parts = env.unwrapped.parts
        self.percept: Percept | None = None
        """What perception saw last, with timings: for recording; None before the first reset."""
        assert isinstance(env.observation_space, spaces.Dict)
        self.observation_space = with_poses(env.observation_space)
        perception.onboard(self.parts)

    def observation(self, observation: dict[str, Any]) -> dict[str, Any]:
        """Return the observation with the estimated poses added."""
        self.percept = self.perception.perceive(frame_from_observation(observation), self.parts)
        return {**observation, **pose_arrays(self.percept, observation["T_world_camera"], self.parts)}


def pose_arrays(
    percept: Percept, T_world_camera: Float[np.ndarray, "4 4"], parts: Sequence[Part]
) -> dict[str, np.ndarray]:
    """Return the entries of `POSE_TABLE` for what perception saw; `parts` in the environment's order."""
    index = {part.name: k for k, part in enumerate(parts)}
    poses, scores = np.zeros((MAX_PARTS, 4, 4)), np.zeros(MAX_PARTS, np.float32)
    names = np.full(MAX_PARTS, -1, np.int16)
    for k, estimate in enumerate(percept.estimates[:MAX_PARTS]):
        poses[k] = np.clip(T_world_camera @ estimate.T_camera_part, -FAR_M, FAR_M)
        names[k] = index[estimate.part]
        scores[k] = np.clip(estimate.score, -MAX_SCORE, MAX_SCORE)
    return {"estimated_poses": poses, "estimated_parts": names, "estimate_scores": scores}


def with_poses(space: spaces.Dict) -> spaces.Dict:
    """Return the space of an environment's observations with the entries of `POSE_TABLE` added."""
    return spaces.Dict({**space.spaces, **{item.key: item.space for item in POSE_TABLE}})


def check_can_be_perceived(space: spaces.Space, wrapper: str) -> None:
    """Raise `ConfigError` unless observations of this space still have all that perception needs."""
    observed = space.spaces if isinstance(space, spaces.Dict) else {}
    missing = [key for key in NEEDED if key not in observed]
    if missing:
        raise ConfigError(
            f"{wrapper} needs the observations {', '.join(NEEDED)}, but {', '.join(missing)} is missing;"
            " wrap with it before wrappers that drop them"
        )
