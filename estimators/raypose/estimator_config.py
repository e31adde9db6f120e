"""`RayPoseEstimatorConfig`: how the network is used."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Interval

from simpick.config import Config, NonNegativeInt, PositiveInt


@dataclass(frozen=True)
class RayPoseEstimatorConfig(Config):
    """How the network is used."""

    turns: PositiveInt = 12
    """Coarse only: rotations of a detection about the optical axis that are compared with the upright templates."""
    tried: PositiveInt = 8
    """Coarse only: how many of these are followed, those whose matches agree best on a pose; if one hypothesis is asked
    for, only the better half of them after the first pass."""
    iterations: NonNegativeInt | None = None
    """How many times templates are chosen around the estimate and a new one is made. None stands for 1 for fine and 2
    for coarse, where they follow the first estimate from templates over the sphere."""
    steps: PositiveInt = 3
    """Denoising steps."""
    hypotheses: Annotated[int, Interval(ge=1, le=64)] = 1
    """Poses per detection, best first; a fine predictor begins at as many hypotheses of its start."""
    min_mask_px: PositiveInt = 16
    """Detections with fewer pixels get no estimate."""
    seed: int = 0
    """Of the noise that denoising begins with."""
    cluster_deg: float = 5.0
    """Hypotheses closer than this, and than `cluster_diameters`, are merged."""
    cluster_diameters: float = 0.1
    """See `cluster_deg`; in diameters of the part."""
