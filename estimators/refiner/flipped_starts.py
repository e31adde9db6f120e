"""Additional starts for a single hypothesis: most wrong poses are flips of a nearly symmetric part."""

from __future__ import annotations

import numpy as np

from simpick.assets.part import Part
from simpick.estimators.pose_clusters import cluster_hypotheses
from simpick.geometry import transform
from simpick.records import PoseHypothesis

_SAME_DEG, _SAME_DIAMETERS = 15.0, 0.2
"""A flip this near to another start, over the part's symmetries, would converge to the same pose."""


def with_flips(lone: PoseHypothesis, part: Part) -> tuple[PoseHypothesis, ...]:
    """Return the hypothesis, then its half turns about the axes of the part's bounding box, without duplicates.

    The box's centre stays fixed. Flips have a score of 0.
    """
    centre = part.mesh.vertices.min(axis=0) / 2 + part.mesh.vertices.max(axis=0) / 2
    flips = []
    for axis in np.eye(3):
        R = 2 * np.outer(axis, axis) - np.eye(3)
        flips.append(PoseHypothesis(lone.T_camera_part @ transform(R, centre - R @ centre), 0.0))
    clusters = cluster_hypotheses(
        [PoseHypothesis(lone.T_camera_part, 1.0), *flips],
        part.symmetries,
        part.diameter_m,
        rotation_deg=_SAME_DEG,
        translation_diameters=_SAME_DIAMETERS,
    )
    return (lone, *(cluster.best for cluster in clusters[1:]))
