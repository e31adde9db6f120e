"""From frames to observations of `BinPickEnv` and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from simpick.envs.spaces import FAR_M, outcome_index
from simpick.geometry import Pinhole
from simpick.records import CameraFrame, PickOutcome
from simpick.scene.config import MAX_PARTS


def observation_from_frame(
    frame: CameraFrame, instance_parts: Sequence[int], remaining: int, last_outcome: PickOutcome | None
) -> dict[str, Any]:
    """Return a new observation; no array is shared with the frame.

    `instance_parts` holds for each instance the index of its part. The frame needs depth and instances.
    """
    assert frame.depth_m is not None and frame.instances is not None
    padded = np.full(MAX_PARTS, -1, np.int16)
    padded[: len(instance_parts)] = instance_parts
    return {
        "rgb": frame.rgb.copy(),
        "depth": np.where(frame.depth_m <= FAR_M, frame.depth_m, np.float32(0.0)).astype(np.float32, copy=False),
        "segmentation": (frame.instances + 1).astype(np.uint8),
        "instance_parts": padded,
        "camera_matrix": frame.camera.K,
        "T_world_camera": frame.T_world_camera.copy(),
        "remaining": np.int64(remaining),
        "last_outcome": np.int64(outcome_index(last_outcome)),
    }


def frame_from_observation(observation: Mapping[str, Any]) -> CameraFrame:
    """Return the camera frame that an observation carries."""
    rgb, K = observation["rgb"], observation["camera_matrix"]
    return CameraFrame(
        rgb=rgb,
        camera=Pinhole.from_K(rgb.shape[1], rgb.shape[0], K),
        T_world_camera=observation["T_world_camera"],
        depth_m=observation["depth"],
        instances=np.subtract(observation["segmentation"], 1, dtype=np.int32),
    )
