"""`LossWeights`: how much each term of the training loss counts."""

from __future__ import annotations

from dataclasses import dataclass

from simpick.config import Config, NonNegativeFloat


@dataclass(frozen=True)
class LossWeights(Config):
    """Weight of each term of the loss, by the name of its function; the paper does not give its weights."""

    ray_reconstruction: NonNegativeFloat = 1.0
    """Squared error of the ray maps (eq. 11)."""
    ray_cosine: NonNegativeFloat = 0.5
    """Cosine distance between predicted and true rays."""
    ray_consistency: NonNegativeFloat = 0.1
    """Angles between neighbouring rays (eq. 12)."""
    translation_reconstruction: NonNegativeFloat = 2.0
    """Squared error of the translation maps (eq. 14)."""
    translation_xyz: NonNegativeFloat = 0.5
    """L1 error of the decoded translation (eq. 15)."""
    matching: NonNegativeFloat = 0.3
    """Cross entropy of the matches between query and template cells."""
    matched_points: NonNegativeFloat = 3.0
    """Distance of the matched points from the true ones."""
    view_embedding: NonNegativeFloat = 0.3
    """Cross entropy of the views that the query's embedding chooses."""
    visibility: NonNegativeFloat = 1.0
    """Cross entropy of the cells that are estimated to show the part."""
    first: NonNegativeFloat = 1.0
    """Error of the pose solved from the matches."""
    flow_matching: NonNegativeFloat = 0.3
    """Cross entropy of the flow's matches."""
    flow_offset: NonNegativeFloat = 0.3
    """Error of the flow itself."""
    flow_pose: NonNegativeFloat = 2.0
    """Error of the pose solved from the flow."""
