"""Coverage: in which share of a part's resting poses a gripper can pick it, alone in the middle of the bin."""

from __future__ import annotations

import numpy as np

from simpick.assets.grippers.sampling.resting import stable_poses
from simpick.assets.part import Part
from simpick.geometry.transforms import transform
from simpick.grasping.planner import GraspPlanner, PlannerConfig
from simpick.scene.config import BinConfig
from simpick.scene.workspace import BIN_CENTRE_M

_LEAST_SHARE = 0.005
_MOST_EQUAL_POSES = 24


def resting_coverage(part: Part, gripper: str, least: int = 2) -> float:
    """Return the probability that `part`, thrown onto the bin's empty floor, offers `least` feasible grasps.

    Poses and their probabilities are those of the convex hull thrown at random (Goldberg 1999).
    """
    planner = GraspPlanner(gripper, BinConfig(), PlannerConfig(grasps_per_target=least, tries_per_target=2000))
    Ts, shares = stable_poses(part)
    likely = shares > _LEAST_SHARE
    # A ball of many facets rests on each of them with a small share: a few stand for all.
    Ts, shares = (Ts[likely], shares[likely]) if likely.any() else (Ts[:_MOST_EQUAL_POSES], shares[:_MOST_EQUAL_POSES])
    T_world_floor = transform(translation=np.array(BIN_CENTRE_M))
    covered = sum(
        share for T, share in zip(Ts, shares, strict=True) if len(planner.plan([part], [T_world_floor @ T])) >= least
    )
    return float(covered / np.sum(shares))
