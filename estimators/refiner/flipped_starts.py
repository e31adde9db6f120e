"""Additional starts for a single hypothesis: most wrong poses are flips of a nearly symmetric part."""

from __future__ import annotations

import numpy as np

from simpick.assets.part import Part
from simpick.estimators.pose_selection import distinct_poses
from simpick.geometry import transform
from simpick.records import PoseHypothesis

_SAME_DEG, _SAME_DIAMETERS = 15.0, 0.2
"""A flip this near to another start, over the part's symmetries, would converge to the same pose."""


def with_flips(hypothesis: PoseHypothesis, part: Part) -> tuple[PoseHypothesis, ...]:
    """Return the hypothesis, then its half turns about the axes of the part's bounding box, without duplicates.

    The box's centre stays fixed. Flips have a score of 0.
    """
    centre = part.mesh.vertices.min(axis=0) / 2 + part.mesh.vertices.max(axis=0) / 2
    half_turns = [2 * np.outer(axis, axis) - np.eye(3) for axis in np.eye(3)]
    flips = [hypothesis.T_camera_part @ transform(R, centre - R @ centre) for R in half_turns]
    distinct = distinct_poses(
        np.stack([hypothesis.T_camera_part, *flips]),
        np.array([1.0, 0.0, 0.0, 0.0]),
        part.symmetries,
        part.diameter_m,
        rotation_deg=_SAME_DEG,
        translation_diameters=_SAME_DIAMETERS,
    )
    return (hypothesis, *(PoseHypothesis(flips[k - 1], 0.0) for k in distinct[1:].tolist()))
