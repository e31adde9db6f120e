"""`RefinerConfig`: how poses are aligned, and what that costs."""

from __future__ import annotations

from dataclasses import dataclass

from simpick.errors import ConfigError


@dataclass(frozen=True)
class AlignmentLevel:
    """One stage from coarse to fine."""

    size_px: int
    """Width and height of the crop that is rendered and compared."""
    blur_px: float
    """Standard deviation of the Gaussian that all maps are blurred with: a wider one pulls from farther away."""
    iterations: int
    """Renderings of each hypothesis, at most."""
    keep: int
    """So many of the best distinct hypotheses go on to this level."""
    stride: int = 2
    """Residuals stand at every so many pixels along both axes: blurred maps hold no finer detail."""

    def __post_init__(self) -> None:
        if not 16 <= self.size_px <= 512:
            raise ConfigError(f"size_px of a level must be between 16 and 512, got {self.size_px}")
        if not 0.3 <= self.blur_px <= self.size_px / 4:
            raise ConfigError(f"blur_px must be between 0.3 and a quarter of the size, got {self.blur_px}")
        if self.iterations < 1 or self.keep < 1:
            raise ConfigError(f"iterations and keep must be 1 or more, got {self.iterations} and {self.keep}")
        if self.stride < 1 or self.size_px % self.stride:
            raise ConfigError(f"stride must divide size_px = {self.size_px}, got {self.stride}")


@dataclass(frozen=True)
class RefinerConfig:
    """How hypotheses are refined, chosen and merged."""

    levels: tuple[AlignmentLevel, ...] = (
        AlignmentLevel(48, 2.5, 5, 6),
        AlignmentLevel(64, 1.5, 5, 4),
        AlignmentLevel(96, 1.2, 5, 2),
    )
    """From coarse to fine."""
    padding: float = 1.4
    """Side of the crop over the longer side of the mask's box."""
    silhouette_scale: float = 0.3
    """Misfit of the blurred silhouettes, whose step is 1, at which the robust kernel lets go."""
    shading_scale: float = 0.1
    """Misfit of the brightness, as a share of the part's mean brightness, at which the robust kernel lets go."""
    shading_weight: float = 1.0
    """Weight of brightness against silhouettes."""
    occluder_weight: float = 0.05
    """Weight of silhouette pixels that fall on another detection, which may hide the part, against free ones."""
    merge_deg: float = 4.0
    """Refined poses closer than this, and than `merge_diameters`, are one."""
    merge_diameters: float = 0.05
    """See `merge_deg`; in diameters of the part."""
    renderers: int = 16
    """OpenGL contexts kept, one a part; parts used longest ago are closed first."""

    def __post_init__(self) -> None:
        if not self.levels:
            raise ConfigError("levels of the refiner must be one or more, got none")
        if not 1.0 <= self.padding <= 4.0:
            raise ConfigError(f"padding must be between 1 and 4, got {self.padding}")
        for name in ("silhouette_scale", "shading_scale"):
            if not getattr(self, name) > 0:
                raise ConfigError(f"{name} must be above 0, got {getattr(self, name)}")
        if not self.shading_weight >= 0:
            raise ConfigError(f"shading_weight must be zero or more, got {self.shading_weight}")
        if not 0 <= self.occluder_weight <= 1:
            raise ConfigError(f"occluder_weight must be between 0 and 1, got {self.occluder_weight}")
        if not 0 <= self.merge_deg <= 180 or not self.merge_diameters >= 0:
            raise ConfigError(
                f"merge_deg must be between 0 and 180 and merge_diameters zero or more, "
                f"got {self.merge_deg} and {self.merge_diameters}"
            )
        if self.renderers < 1:
            raise ConfigError(f"renderers must be 1 or more, got {self.renderers}")
