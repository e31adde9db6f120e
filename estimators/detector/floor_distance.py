"""How far the bin's floor is: a calibrated camera knows what a crop cannot show.

Where the camera's pose is known, the floor is the plane z = 0 of the world (see `simpick.geometry`).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from simpick.records import CameraFrame

_LEAST_FALL = 0.1
"""Sine of the smallest angle between floor and line of sight at which the distance is of use."""


def floor_distances(
    frame: CameraFrame, sights: Float[np.ndarray, "instances 3"]
) -> Float[np.ndarray, "instances"] | None:
    """Return the distance in metres to the floor along lines of sight, unit vectors in the camera's frame.

    None if the frame does not say where the floor is: the camera's pose is unknown (the identity), the camera is not
    above z = 0, or a line of sight does not meet the floor.
    """
    T = frame.T_world_camera
    fall = -sights @ T[2, :3]
    if np.array_equal(T, np.eye(4)) or T[2, 3] <= 0 or (fall < _LEAST_FALL).any():
        return None
    return T[2, 3] / fall
