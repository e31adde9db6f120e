"""Selection among pose hypotheses: clusters in SE(3) over a part's symmetries, and the best per group."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from simpick.errors import ConfigError
from simpick.geometry import SymmetryGroup
from simpick.records import PoseHypothesis


@dataclass(frozen=True, eq=False)
class HypothesisCluster:
    """Hypotheses of practically the same pose."""

    best: PoseHypothesis
    """The one with the highest score."""
    members: tuple[PoseHypothesis, ...]
    """All, best first."""

    @property
    def score(self) -> float:
        """Return the best member's score."""
        return self.best.score


def cluster_hypotheses(
    hypotheses: Sequence[PoseHypothesis],
    symmetries: SymmetryGroup,
    diameter_m: float,
    *,
    rotation_deg: float,
    translation_diameters: float,
) -> list[HypothesisCluster]:
    """Return clusters, best first: each hypothesis joins the first better one within both limits.

    The limits are of the angle over the symmetries and of the distance between origins. So no member is farther from
    its cluster's best, and the bests of two clusters are farther apart.

    Raises:
        ConfigError: the diameter is not positive, or a limit is negative.
    """
    if not (diameter_m > 0 and rotation_deg >= 0 and translation_diameters >= 0):
        raise ConfigError(
            "clusters need a positive diameter and limits of zero or more, got "
            f"diameter_m={diameter_m}, rotation_deg={rotation_deg}, translation_diameters={translation_diameters}"
        )
    ordered = sorted(hypotheses, key=lambda hypothesis: -hypothesis.score)
    Ts = np.array([hypothesis.T_camera_part for hypothesis in ordered]).reshape(-1, 4, 4)
    leaders: list[int] = []
    members: list[list[int]] = []
    for k, T in enumerate(Ts):
        near = _near(T, Ts[leaders], symmetries, rotation_deg, translation_diameters * diameter_m)
        home = next((cluster for cluster, is_near in enumerate(near) if is_near), None)
        if home is None:
            leaders.append(k)
            members.append([k])
        else:
            members[home].append(k)
    return [HypothesisCluster(ordered[m[0]], tuple(ordered[k] for k in m)) for m in members]


def best_per_group(groups: Int[np.ndarray, "n"], costs: Float[np.ndarray, "n"], count: int) -> Int[np.ndarray, "k"]:
    """Return the rows of the `count` lowest costs of each group, ordered by group and cost."""
    order = np.lexsort((costs, groups))
    ordered = groups[order]
    return order[np.arange(len(order)) - np.searchsorted(ordered, ordered) < count]


def _near(
    T: Float[np.ndarray, "4 4"],
    Ts_leader: Float[np.ndarray, "n 4 4"],
    symmetries: SymmetryGroup,
    rotation_deg: float,
    translation_m: float,
) -> list[bool]:
    """Return for each leader whether a pose is near it."""
    Ts = np.broadcast_to(T, Ts_leader.shape)
    # A symmetry about an axis beside the origin moves the origin too.
    equivalent = symmetries.closest_equivalent(Ts, Ts_leader)
    angle_deg = np.degrees(symmetries.rotation_distance(Ts[:, :3, :3], Ts_leader[:, :3, :3]))
    distance_m = np.linalg.norm(equivalent[:, :3, 3] - Ts_leader[:, :3, 3], axis=-1)
    # Margins above rounding errors, so that equal poses are near even with limits of zero.
    return ((angle_deg <= rotation_deg + 1e-5) & (distance_m <= translation_m + 1e-9)).tolist()
