"""`RayPoseEstimatorConfig`: how the network is used."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Interval

from simpick.config import Config, NonNegativeInt, PositiveInt
from simpick.errors import ConfigError


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
    starts: NonNegativeInt = 5
    """Fine only: how many hypotheses of the estimator that it starts from are followed. Of all that is followed, the
    answer is what matches support best."""
    views: NonNegativeInt = 5
    """Fine only: how many views with the most similar embeddings are followed besides."""
    kept: PositiveInt = 5
    """Fine only: how many of these starts are measured by flow, those whose matches agree best on a pose; as many as
    hypotheses are asked for, or more."""
    decoder_steps: NonNegativeInt = 0
    """Denoising steps of the diffusion decoder after matches and flow; 0 leaves it out. Networks without matching need
    some."""
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

    @property
    def followed(self) -> int:
        """Return how many hypotheses of the start are followed: as many as are asked for, or more."""
        return max(self.starts, self.hypotheses) if self.starts else 0

    def _check_rules(self) -> None:
        if not self.starts and not self.views:
            raise ConfigError("a fine network needs starts or views to follow, got 0 of both")
