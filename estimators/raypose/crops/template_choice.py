"""Choice of views and in-plane rotations as templates: over the whole sphere (coarse) or around a pose (fine)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from simpick.geometry import farthest_points, so3_exp


def align_turns(
    Rs_view_part: Float[np.ndarray, "n 3 3"], R_crop_part: Float[np.ndarray, "*#n 3 3"]
) -> Float[np.ndarray, "n"]:
    """Return the clockwise turns about the optical axis that bring views closest to an orientation, in radians."""
    M = R_crop_part @ np.swapaxes(Rs_view_part, -1, -2)
    return np.arctan2(M[..., 1, 0] - M[..., 0, 1], M[..., 0, 0] + M[..., 1, 1])


def view_angles(
    Rs_view_part: Float[np.ndarray, "n 3 3"], R_crop_part: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "n"]:
    """Return the angles in radians between viewing directions, ignoring turns about the optical axis."""
    return np.arccos(np.clip(Rs_view_part[:, 2] @ R_crop_part[2], -1.0, 1.0))


def spread_over_sphere(Rs_view_part: Float[np.ndarray, "n 3 3"], count: int) -> Int[np.ndarray, "count"]:
    """Return the views of the fixed set of coarse templates, by farthest-point sampling."""
    return farthest_points(Rs_view_part[:, 2], count)


def draw_over_sphere(
    Rs_view_part: Float[np.ndarray, "n 3 3"], count: int, rng: np.random.Generator, *, fixed: bool = False
) -> Int[np.ndarray, "count"]:
    """Return the views for a coarse predictor's training: random ones, about evenly spread, or the fixed set."""
    if fixed:
        return spread_over_sphere(Rs_view_part, count)
    directions = spread_directions(count) @ so3_exp(np.pi * rng.uniform(-1, 1, 3)).T
    return np.argmax((directions + rng.normal(0, 0.15, directions.shape)) @ Rs_view_part[:, 2].T, axis=1)


def spread_directions(count: int) -> Float[np.ndarray, "count 3"]:
    """Return directions evenly spread over the sphere (a Fibonacci lattice)."""
    k = np.arange(count) + 0.5
    z = 1 - 2 * k / count
    azimuth = np.pi * (1 + 5**0.5) * k
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z], axis=-1)


def draw_around(
    Rs_view_part: Float[np.ndarray, "n 3 3"],
    R_crop_part: Float[np.ndarray, "3 3"],
    count: int,
    spread_rad: float,
    rng: np.random.Generator,
) -> tuple[Int[np.ndarray, "count"], Float[np.ndarray, "count"]]:
    """Return random views and turns within `spread_rad` of an orientation, for a fine predictor's training."""
    angles = view_angles(Rs_view_part, R_crop_part)
    near = np.flatnonzero(angles <= 0.8 * spread_rad)
    if len(near) < count:
        near = np.argsort(angles)[: max(count, len(near))]
    views = rng.choice(near, count, replace=False)
    # The turn gets what the viewing direction leaves of the spread.
    room = np.sqrt(np.maximum(spread_rad**2 - angles[views] ** 2, (0.2 * spread_rad) ** 2))
    return views, align_turns(Rs_view_part[views], R_crop_part) + rng.uniform(-1, 1, count) * 0.6 * room


def choose_around(
    Rs_view_part: Float[np.ndarray, "n 3 3"], R_crop_part: Float[np.ndarray, "3 3"], count: int, turns: int
) -> tuple[Int[np.ndarray, "count"], Int[np.ndarray, "count"]]:
    """Return the views nearest to an orientation and for each the nearest of `turns` equal turns."""
    views = np.argsort(view_angles(Rs_view_part, R_crop_part), kind="stable")[:count]
    angles = align_turns(Rs_view_part[views], R_crop_part)
    return views, np.round(angles * turns / (2 * np.pi)).astype(int) % turns
