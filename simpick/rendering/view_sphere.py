"""Views of a part from all around: directions of an icosphere, poses, and turns about the optical axis."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import trimesh
from jaxtyping import Float

from simpick.errors import ConfigError
from simpick.geometry import invert, look_at, so3_exp, transform

VIEW_COUNTS = {12: 0, 42: 1, 162: 2, 642: 3, 2562: 4}
"""Numbers of vertices of an icosphere, and how often the icosahedron's faces are split for each."""


@lru_cache(maxsize=8)
def _icosphere(views: int) -> Float[np.ndarray, "views 3"]:
    vertices = np.array(trimesh.creation.icosphere(subdivisions=VIEW_COUNTS[views]).vertices)
    vertices /= np.linalg.norm(vertices, axis=-1, keepdims=True)
    # From top to bottom, and around at equal height; rounded, so that the order does not hang on the last bit.
    x, y, z = vertices.round(9).T
    return vertices[np.lexsort((np.arctan2(y, x).round(6), -z.round(6)))]


def view_directions(views: int) -> Float[np.ndarray, "views 3"]:
    """Return unit vectors from the part towards the cameras, from +z down.

    Raises:
        ConfigError: no icosphere has this number of vertices.
    """
    if views not in VIEW_COUNTS:
        raise ConfigError(f"views must be one of {', '.join(map(str, VIEW_COUNTS))}, got {views}")
    return _icosphere(views).copy()


def look_at_part(directions: Float[np.ndarray, "n 3"], distance_m: float) -> Float[np.ndarray, "n 4 4"]:
    """Return T_camera_part of cameras in these directions whose axes pass through the part's origin, +z up."""
    Ts_part_camera = np.stack([look_at(distance_m * direction, np.zeros(3)) for direction in directions])
    return invert(Ts_part_camera)


def turn_in_plane(
    Ts_camera_part: Float[np.ndarray, "*#batch 4 4"], angle_rad: Float[np.ndarray, "*#batch"]
) -> Float[np.ndarray, "*batch 4 4"]:
    """Return the poses with the image turned clockwise by the angle about the principal point."""
    about_axis = np.asarray(angle_rad, float)[..., None] * np.array([0.0, 0.0, 1.0])
    return transform(so3_exp(about_axis)) @ Ts_camera_part
