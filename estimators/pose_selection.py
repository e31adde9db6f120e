"""Selection among hypotheses: poses that differ over a part's symmetries, and the best of each group."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from simpick.errors import ConfigError
from simpick.geometry import SymmetryGroup, rotation_angle


def distinct_poses(
    Ts_a_part: Float[np.ndarray, "n 4 4"],
    scores: Float[np.ndarray, "n"],
    symmetries: SymmetryGroup,
    diameter_m: float,
    *,
    rotation_deg: float,
    translation_diameters: float,
    count: int | None = None,
) -> Int[np.ndarray, "k"]:
    """Return the rows of distinct poses, best first: those not within both limits of a better one that is kept.

    The limits are of the angle over the symmetries and of the distance between origins. `count` limits how many.

    Raises:
        ConfigError: the diameter is not positive, or a limit is negative.
    """
    if not (diameter_m > 0 and rotation_deg >= 0 and translation_diameters >= 0):
        raise ConfigError(
            "distinct poses need a positive diameter and limits of zero or more, got "
            f"diameter_m={diameter_m}, rotation_deg={rotation_deg}, translation_diameters={translation_diameters}"
        )
    kept: list[int] = []
    left = np.argsort(-scores, kind="stable")
    while len(left) and (count is None or len(kept) < count):
        best, left = int(left[0]), left[1:]
        kept.append(best)
        near = _near(Ts_a_part[left], Ts_a_part[best], symmetries, rotation_deg, translation_diameters * diameter_m)
        left = left[~near]
    return np.array(kept, int)


def best_per_group(groups: Int[np.ndarray, "n"], costs: Float[np.ndarray, "n"], count: int) -> Int[np.ndarray, "k"]:
    """Return the rows of the `count` lowest costs of each group, ordered by group and cost."""
    order = np.lexsort((costs, groups))
    ordered = groups[order]
    return order[np.arange(len(order)) - np.searchsorted(ordered, ordered) < count]


def _near(
    Ts: Float[np.ndarray, "n 4 4"],
    T_kept: Float[np.ndarray, "4 4"],
    symmetries: SymmetryGroup,
    rotation_deg: float,
    translation_m: float,
) -> Bool[np.ndarray, "n"]:
    """Return which poses are near one that is kept."""
    # A symmetry about an axis beside the origin moves the origin too.
    equivalent = symmetries.closest_equivalent(Ts, T_kept)
    angle_deg = np.degrees(rotation_angle(np.swapaxes(equivalent[:, :3, :3], 1, 2) @ T_kept[:3, :3]))
    distance_m = np.linalg.norm(equivalent[:, :3, 3] - T_kept[:3, 3], axis=-1)
    # Margins above rounding errors, so that equal poses are near even with limits of zero.
    return (angle_deg <= rotation_deg + 1e-5) & (distance_m <= translation_m + 1e-9)
