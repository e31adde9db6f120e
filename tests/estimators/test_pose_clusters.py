"""Clusters of hypotheses over symmetries."""

from __future__ import annotations

import numpy as np
import pytest

from simpick.errors import ConfigError
from simpick.estimators.pose_clusters import cluster_hypotheses
from simpick.geometry import SymmetryGroup, random_rotation, so3_exp, transform
from simpick.records import PoseHypothesis

Z = np.array([0.0, 0.0, 1.0])


def turned(degrees: float, score: float, x_m: float = 0.0) -> PoseHypothesis:
    return PoseHypothesis(transform(so3_exp(np.radians(degrees) * Z), np.array([x_m, 0.0, 1.0])), score)


def bests(hypotheses, symmetries):
    clusters = cluster_hypotheses(hypotheses, symmetries, 0.1, rotation_deg=5.0, translation_diameters=0.05)
    return [(cluster.score, len(cluster.members)) for cluster in clusters]


def test_near_poses_join_the_best_one():
    hypotheses = [turned(0, 0.3), turned(4, 0.9), turned(30, 0.5), turned(2, 0.4, x_m=0.02)]
    assert bests(hypotheses, SymmetryGroup()) == [(0.9, 2), (0.5, 1), (0.4, 1)]


def test_poses_that_look_the_same_are_one():
    hypotheses = [turned(0, 0.9), turned(91, 0.8), turned(45, 0.7)]
    assert bests(hypotheses, SymmetryGroup.cyclic(4)) == [(0.9, 2), (0.7, 1)]
    assert bests(hypotheses, SymmetryGroup.revolution()) == [(0.9, 3)]


def test_every_hypothesis_is_in_one_cluster_and_bests_are_apart():
    rng = np.random.default_rng(0)
    hypotheses = [PoseHypothesis(transform(R), float(s)) for R, s in zip(random_rotation(rng, (60,)), rng.random(60))]  # noqa: B905
    clusters = cluster_hypotheses(hypotheses, SymmetryGroup(), 0.1, rotation_deg=40.0, translation_diameters=0.0)
    assert sorted(id(h) for c in clusters for h in c.members) == sorted(map(id, hypotheses))
    Rs = np.array([c.best.T_camera_part[:3, :3] for c in clusters])
    apart = SymmetryGroup().rotation_distance(Rs[:, None], Rs[None]) + 10 * np.eye(len(Rs))
    assert np.degrees(apart.min()) > 40.0


def test_none_make_none_and_nonsense_is_refused():
    assert bests([], SymmetryGroup()) == []
    with pytest.raises(ConfigError, match=r"positive diameter.*diameter_m=0"):
        cluster_hypotheses([], SymmetryGroup(), 0, rotation_deg=1.0, translation_diameters=0.1)
