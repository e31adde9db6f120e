"""Actions of `BinPickEnv`: a TCP pose and an opening as ten numbers in [-1, 1], and back."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Float32

from simpick.assets.grippers import JAW_STROKE_M
from simpick.errors import ConfigError
from simpick.geometry import rotation_from_6d, rotation_to_6d, transform
from simpick.scene.workspace import Box

ABSTAIN: Float32[np.ndarray, "10"] = np.zeros(10, np.float32)
"""No pick. All zeros are no rotation, so that no real pick is lost; the arm stays at home, and the pick counts."""


def finite_values(action: object, count: int) -> Float[np.ndarray, "count"]:
    """Return an action's numbers, each cut off at -1 and 1.

    Raises:
        ConfigError: the action is not `count` finite numbers.
    """
    try:
        values = np.asarray(action, float)
    except (TypeError, ValueError):  # Strings, ragged lists, objects.
        values = np.full(0, np.nan)
    if values.shape != (count,) or not all(map(math.isfinite, values.tolist())):
        shown = action.tolist() if isinstance(action, np.ndarray) else action
        raise ConfigError(f"an action must be {count} finite numbers in [-1, 1], got {shown!r}")
    return np.minimum(np.maximum(values, -1.0), 1.0)


def encode_action(
    T_world_tcp: Float[np.ndarray, "4 4"], opening_m: float, workspace: Box, max_opening_m: float = JAW_STROKE_M
) -> Float32[np.ndarray, "10"]:
    """Return the action that commands this TCP pose and this opening of the gripper.

    Elements 0-2 are the position, mapped from the box `workspace`; 3-8 the first two columns of the rotation (6D
    representation, Zhou et al. 2019); 9 the opening, mapped from [0, max_opening_m], -1 for a gripper without one.

    Raises:
        ConfigError: the position lies outside the workspace.
    """
    position = (T_world_tcp[:3, 3] - workspace.centre_m) / (workspace.size_m / 2)
    if np.abs(position).max() > 1.0 + 1e-9:
        raise ConfigError(
            f"TCP position must lie in the workspace {workspace.lower_m} to {workspace.upper_m} m, "
            f"got {T_world_tcp[:3, 3].round(4).tolist()} m"
        )
    opening = 2.0 * opening_m / max_opening_m - 1.0 if max_opening_m else -1.0
    rotation = rotation_to_6d(T_world_tcp[:3, :3])
    return np.clip(np.concatenate([position, rotation, [opening]]), -1.0, 1.0).astype(np.float32)


def decode_action(
    action: np.ndarray | Sequence[float], workspace: Box, max_opening_m: float = JAW_STROKE_M
) -> tuple[Float[np.ndarray, "4 4"], float] | None:
    """Return (T_world_tcp, opening_m) of an action, or None for `ABSTAIN`.

    Any other six numbers for the rotation are orthonormalised by Gram-Schmidt; where they are parallel, the nearest
    rotation about the first axis is taken, so that every action of the space can be executed.
    Values beyond 1 are cut off.

    Raises:
        ConfigError: the action is not ten finite numbers.
    """
    values = finite_values(action, 10)
    columns = values[3:9]
    if not np.any(columns):
        return None
    if np.linalg.norm(np.cross(columns[:3], columns[3:])) < 1e-6:
        first = columns[:3] if np.linalg.norm(columns[:3]) > 1e-6 else columns[3:]
        columns = np.concatenate([first, np.eye(3)[np.argmin(np.abs(first))]])
    position = workspace.centre_m + values[:3] * workspace.size_m / 2
    opening_m = float((values[9] + 1.0) / 2.0 * max_opening_m)
    return transform(rotation_from_6d(columns), position), opening_m
