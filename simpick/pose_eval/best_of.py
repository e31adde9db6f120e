"""Best of K: the pose errors of an estimator if the best of its hypotheses were always chosen."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from simpick.pose_eval.pose_images import PoseModel
from simpick.pose_eval.pose_sources import Answer
from simpick.records import PoseEstimate


def best_of(answer: Answer, k: int | None, model_of: Callable[[str], PoseModel]) -> list[PoseEstimate]:
    """Return the estimates with the best pose of their first `k` hypotheses, or of all if `k` is None.

    The best has the least rotation error over the part's symmetries; ties go to the first. Scores stay. Estimates
    without hypotheses, and those whose detection names no instance, are returned unchanged.
    """
    truths = {truth.instance: truth.T_camera_part for truth in answer.image.truths}
    chosen = []
    for estimate in answer.estimates:
        instance = None if estimate.detection is None else estimate.detection.instance
        if estimate.hypotheses and instance in truths:
            Ts = np.stack([hypothesis.T_camera_part for hypothesis in estimate.hypotheses[:k]])
            symmetries = model_of(estimate.part).evaluation.symmetries
            errors_rad = symmetries.rotation_distance(truths[instance][:3, :3], Ts[:, :3, :3])
            estimate = dataclasses.replace(estimate, T_camera_part=Ts[int(errors_rad.argmin())])
        chosen.append(estimate)
    return chosen
