"""Best of K: what an estimator's hypotheses are worth to whoever picks the right one among them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from simpick.pose_eval.pose_images import PoseImage, PoseModel
from simpick.records import PoseEstimate


def best_of(
    estimates: Sequence[PoseEstimate], image: PoseImage, k: int | None, model_of: Callable[[str], PoseModel]
) -> list[PoseEstimate]:
    """Return the estimates with that pose, of the first `k` hypotheses of each, that is turned least against the truth.

    With None for `k`, of all of them. Over the part's symmetries; of equals, the first. Scores stay. Estimates without
    hypotheses, or of which nobody knows which instance they are of, stay as they are.
    """
    truths = {truth.instance: truth.T_camera_part for truth in image.truths}
    chosen = []
    for estimate in estimates:
        instance = None if estimate.detection is None else estimate.detection.instance
        if estimate.hypotheses and instance in truths:
            Ts = np.stack([hypothesis.T_camera_part for hypothesis in estimate.hypotheses[:k]])
            symmetries = model_of(estimate.part).evaluation.symmetries
            turned = symmetries.rotation_distance(truths[instance][:3, :3], Ts[:, :3, :3])
            estimate = dataclasses.replace(estimate, T_camera_part=Ts[int(turned.argmin())])
        chosen.append(estimate)
    return chosen
