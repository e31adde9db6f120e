"""`RefinerConfig`: levels and weights of the alignment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Interval, MinLen

from simpick.config import Config, Fraction, NonNegativeFloat, PositiveFloat, PositiveInt
from simpick.errors import ConfigError


@dataclass(frozen=True)
class AlignmentLevel(Config):
    """One level of the coarse-to-fine alignment."""

    size_px: Annotated[int, Interval(ge=16, le=512)]
    """Width and height of the crop that is rendered and compared."""
    blur_px: Annotated[float, Ge(0.3)]
    """Standard deviation of the Gaussian blur of all maps; more blur widens the basin of convergence."""
    iterations: PositiveInt
    """Maximum number of renderings per hypothesis."""
    keep: PositiveInt
    """Number of the best distinct hypotheses that enter this level."""
    stride: PositiveInt = 2
    """Distance of residuals along both axes, in pixels: blurred maps have no finer detail."""

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
    """Scale of the robust kernel for differences of blurred silhouettes, which are between 0 and 1."""
    shading_scale: PositiveFloat = 0.1
    """Scale of the robust kernel for differences of brightness, relative to the part's mean brightness."""
    shading_weight: NonNegativeFloat = 1.0
    """Weight of brightness relative to silhouettes."""
    occluder_weight: Fraction = 0.05
    """Weight of silhouette pixels on another detection, which may hide the part, relative to free ones."""
    merge_deg: Annotated[float, Interval(ge=0, le=180)] = 4.0
    """Refined poses closer than this, and than `merge_diameters`, are merged."""
    merge_diameters: NonNegativeFloat = 0.05
    """See `merge_deg`; in diameters of the part."""
    renderers: PositiveInt = 16
    """OpenGL contexts kept, one per part; the least recently used one is closed first."""
