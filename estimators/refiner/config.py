"""`RefinerConfig`: how poses are aligned, and what that costs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Interval, MinLen

from simpick.config import Config, Fraction, NonNegativeFloat, PositiveFloat, PositiveInt
from simpick.errors import ConfigError


@dataclass(frozen=True)
class AlignmentLevel(Config):
    """One stage from coarse to fine."""

    size_px: Annotated[int, Interval(ge=16, le=512)]
    """Width and height of the crop that is rendered and compared."""
    blur_px: Annotated[float, Ge(0.3)]
    """Standard deviation of the Gaussian that all maps are blurred with: a wider one pulls from farther away."""
    iterations: PositiveInt
    """Renderings of each hypothesis, at most."""
    keep: PositiveInt
    """So many of the best distinct hypotheses go on to this level."""
    stride: PositiveInt = 2
    """Residuals stand at every so many pixels along both axes: blurred maps hold no finer detail."""

    def _check_rules(self) -> None:
        if self.blur_px > self.size_px / 4:
            raise ConfigError(f"blur_px must be at most a quarter of size_px = {self.size_px}, got {self.blur_px}")
        if self.size_px % self.stride:
            raise ConfigError(f"stride must divide size_px = {self.size_px}, got {self.stride}")


@dataclass(frozen=True)
class RefinerConfig(Config):
    """How hypotheses are refined, chosen and merged."""

    levels: Annotated[tuple[AlignmentLevel, ...], MinLen(1)] = (
        AlignmentLevel(48, 2.5, 5, 6),
        AlignmentLevel(64, 1.5, 5, 4),
        AlignmentLevel(96, 1.2, 5, 2),
    )
    """From coarse to fine."""
    padding: Annotated[float, Interval(ge=1, le=4)] = 1.4
    """Side of the crop over the longer side of the mask's box."""
    silhouette_scale: PositiveFloat = 0.3
    """Misfit of the blurred silhouettes, whose step is 1, at which the robust kernel lets go."""
    shading_scale: PositiveFloat = 0.1
    """Misfit of the brightness, as a share of the part's mean brightness, at which the robust kernel lets go."""
    shading_weight: NonNegativeFloat = 1.0
    """Weight of brightness against silhouettes."""
    occluder_weight: Fraction = 0.05
    """Weight of silhouette pixels that fall on another detection, which may hide the part, against free ones."""
    merge_deg: Annotated[float, Interval(ge=0, le=180)] = 4.0
    """Refined poses closer than this, and than `merge_diameters`, are one."""
    merge_diameters: NonNegativeFloat = 0.05
    """See `merge_deg`; in diameters of the part."""
    renderers: PositiveInt = 16
    """OpenGL contexts kept, one a part; parts used longest ago are closed first."""
