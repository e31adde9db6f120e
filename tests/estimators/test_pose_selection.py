"""Distinct poses over symmetries, and the best of each group."""

from __future__ import annotations

import numpy as np
import pytest

from simpick.errors import ConfigError
from simpick.estimators.pose_selection import best_per_group, distinct_poses
from simpick.geometry import SymmetryGroup, random_rotation, so3_exp, transform

Z = np.array([0.0, 0.0, 1.0])


def turned(degrees: float, x_m: float = 0.0) -> np.ndarray:
    return transform(so3_exp(np.radians(degrees) * Z), np.array([x_m, 0.0, 1.0]))


def distinct(poses: list[np.ndarray], scores: list[float], symmetries: SymmetryGroup) -> list[int]:
    Ts = np.array(poses).reshape(-1, 4, 4)
    return distinct_poses(
        Ts, np.array(scores, float), symmetries, 0.1, rotation_deg=5.0, translation_diameters=0.05
    ).tolist()


def test_poses_near_a_better_one_are_left_out():
    poses = [turned(0), turned(4), turned(30), turned(2, x_m=0.02)]
    assert distinct(poses, [0.3, 0.9, 0.5, 0.4], SymmetryGroup()) == [1, 2, 3]


def test_poses_that_look_the_same_are_one():
    poses, scores = [turned(0), turned(91), turned(45)], [0.9, 0.8, 0.7]
    assert distinct(poses, scores, SymmetryGroup.cyclic(4)) == [0, 2]
    assert distinct(poses, scores, SymmetryGroup.revolution()) == [0]


def test_kept_poses_are_apart_and_others_are_near_one_of_them():
    rng = np.random.default_rng(0)
    Ts, scores = transform(random_rotation(rng, (60,))), rng.random(60)
    kept = distinct_poses(Ts, scores, SymmetryGroup(), 0.1, rotation_deg=40.0, translation_diameters=0.0)
    assert (np.diff(scores[kept]) < 0).all()
    angles_deg = np.degrees(SymmetryGroup().rotation_distance(Ts[:, None, :3, :3], Ts[None, kept, :3, :3]))
    assert angles_deg.min(axis=1).max() <= 40.0
    assert (angles_deg[kept] + 360 * np.eye(len(kept))).min() > 40.0
    limits = {"rotation_deg": 40.0, "translation_diameters": 0.0}
    assert distinct_poses(Ts, scores, SymmetryGroup(), 0.1, **limits, count=3).tolist() == kept[:3].tolist()


def test_none_make_none_and_nonsense_is_refused():
    assert distinct([], [], SymmetryGroup()) == []
    with pytest.raises(ConfigError, match=r"positive diameter.*diameter_m=0"):
        distinct_poses(np.eye(4)[None], np.ones(1), SymmetryGroup(), 0, rotation_deg=1.0, translation_diameters=0.1)


def test_the_best_of_each_group_come_by_group_and_cost():
    groups, costs = np.array([1, 0, 1, 1, 0]), np.array([0.3, 0.9, 0.1, 0.2, 0.4])
    assert best_per_group(groups, costs, 2).tolist() == [4, 1, 2, 3]
    assert best_per_group(groups, costs, 9).tolist() == [4, 1, 2, 3, 0]
