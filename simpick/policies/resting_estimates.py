"""Estimates of one image, corrected by what the cell knows: parts rest on the bin's floor or on each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from simpick.assets.part import Part
from simpick.geometry import invert
from simpick.grasping.resting import raised_onto_floor, resting_poses
from simpick.records import PoseEstimate

_DOUBT_M = 0.02
"""An estimate that was moved by this much is 1 / e times as probable."""


def resting_estimates(
    estimates: Sequence[PoseEstimate], parts: Sequence[Part], T_world_camera: Float[np.ndarray, "4 4"]
) -> list[PoseEstimate]:
    """Return the estimates with poses in which the parts rest, and scores lower the further they were moved.

    `parts` are those that may be in the bin. Hypotheses are raised onto the floor where they reach below it.
    """
    part_of = {part.name: part for part in parts}
    T_camera_world, eye_m = invert(T_world_camera), T_world_camera[:3, 3]
    Ts = [T_world_camera @ estimate.T_camera_part for estimate in estimates]
    resting = resting_poses([part_of[estimate.part] for estimate in estimates], Ts, eye_m)
    answers = []
    for estimate, T_before, T_after in zip(estimates, Ts, resting, strict=True):
        moved_m = float(np.linalg.norm(T_after[:3, 3] - T_before[:3, 3]))
        hypotheses = tuple(
            replace(
                hypothesis,
                T_camera_part=T_camera_world
                @ raised_onto_floor(part_of[estimate.part], T_world_camera @ hypothesis.T_camera_part, eye_m),
            )
            for hypothesis in estimate.hypotheses
        )
        answers.append(
            replace(
                estimate,
                T_camera_part=T_camera_world @ T_after,
                score=estimate.score * float(np.exp(-moved_m / _DOUBT_M)),
                hypotheses=hypotheses,
            )
        )
    return answers
