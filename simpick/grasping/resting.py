"""Estimated poses, moved along their lines of sight until the parts rest in the bin.

One RGB image shows well in which direction a part lies and poorly how far away it is: the distance follows from the
part's size in the image, and a pixel more or less all around is a centimetre. But the bin's floor is known. No part
lies below it, and no part hangs in the air. Moving a pose along its line of sight hardly changes what it looks like.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from simpick.assets.part import Part
from simpick.geometry.transforms import transform_points
from simpick.grasping.height_grid import HeightGrid
from simpick.grasping.part_surface import surface_points

_LOWEST_SIGHT = 0.2
"""Lines of sight that are flatter than this (sine of the angle to the floor) say nothing about a part's height."""


def resting_poses(
    parts: Sequence[Part], Ts_world_part: Sequence[Float[np.ndarray, "4 4"]], eye_m: Float[np.ndarray, "3"]
) -> list[Float[np.ndarray, "4 4"]]:
    """Return the poses, corrected along the lines of sight from the camera at `eye_m`; the floor is at z = 0.

    A part that reaches below the floor is raised onto it. Then, the lowest first, a part with nothing below it is
    lowered onto the floor or onto the parts beneath it, those whose middle lies lower.
    """
    Ts = [raised_onto_floor(part, T, eye_m) for part, T in zip(parts, Ts_world_part, strict=True)]
    if not Ts:
        return []
    points = [transform_points(T, surface_points(part)) for part, T in zip(parts, Ts, strict=True)]
    grid = HeightGrid.around(points)
    tops = np.stack([grid.top(own) for own in points])
    middles = np.array([own[:, 2].mean() for own in points])
    for k in np.argsort([own[:, 2].min() for own in points], kind="stable").tolist():
        bottom = grid.bottom(points[k])
        support = np.maximum(tops[middles < middles[k]].max(axis=0, initial=0.0), 0.0)
        gap_m = float((bottom - support).min())
        if 0 < gap_m < np.inf:
            Ts[k] = _along_sight(Ts[k], eye_m, -gap_m)
            points[k] = transform_points(Ts[k], surface_points(parts[k]))
            tops[k], middles[k] = grid.top(points[k]), points[k][:, 2].mean()
    return Ts


def raised_onto_floor(
    part: Part, T_world_part: Float[np.ndarray, "4 4"], eye_m: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "4 4"]:
    """Return the pose moved towards the camera until no point of the part is below the floor, z = 0."""
    corners = transform_points(T_world_part, np.asarray(part.mesh.convex_hull.vertices, float))
    return _along_sight(T_world_part, eye_m, max(0.0, -float(corners[:, 2].min())))


def _along_sight(
    T_world_part: Float[np.ndarray, "4 4"], eye_m: Float[np.ndarray, "3"], rise_m: float
) -> Float[np.ndarray, "4 4"]:
    """Return the pose moved along the line from its origin to the camera, so that it rises by `rise_m`."""
    sight = eye_m - T_world_part[:3, 3]
    distance_m = float(np.linalg.norm(sight))
    if rise_m == 0 or sight[2] <= _LOWEST_SIGHT * distance_m:
        return T_world_part
    moved = T_world_part.copy()
    moved[:3, 3] += sight / sight[2] * rise_m
    return moved
