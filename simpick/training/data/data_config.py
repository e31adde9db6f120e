"""`DataConfig`: what the training data is drawn from."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from simpick.errors import ConfigError, UnknownNameError
from simpick.rendering import TemplateConfig
from simpick.scene.config import MAX_PARTS
from simpick.scene.randomization import RANDOMIZATIONS

Split = Literal["train", "validation"]
"""Two worlds of parts that share none."""

# Ranges of the fields that are ranges themselves: the least and the greatest value, and the unit for the message.
_LIMITS = {
    "count": (1, MAX_PARTS, "parts"),
    "target_share": (0.05, 1.0, ""),
    "others": (1, 20, "parts"),
    "bin_scale": (0.5, 2.0, ""),
    "distance_m": (0.3, 5.0, "m"),
    "diameter_px": (8, 1000, "px"),
}


@dataclass(frozen=True)
class DataConfig:
    """Ranges and sizes of the training data. Together with a split and an index it determines a shard."""

    seed: int = 0
    """Another seed gives other parts, bins and views."""
    queries: int = 128
    """Queries of a shard at most; a shard has fewer where its cameras do not see that many."""
    cameras: int = 16
    """Views of a bin at most; as many are rendered as `queries` takes."""
    queries_per_camera: int = 16
    """Queries taken from one view at most, so that a shard shows its part in several lights."""
    count: tuple[int, int] = (8, 40)
    """Parts in the bin, fewest and most."""
    mixed_share: float = 0.5
    """Share of bins in which other random parts lie among the shard's own."""
    target_share: tuple[float, float] = (0.4, 0.8)
    """In a mixed bin, the share of instances that are of the shard's part."""
    others: tuple[int, int] = (1, 3)
    """How many other parts a mixed bin holds."""
    bin_scale: tuple[float, float] = (0.65, 1.0)
    """Factor on the length and width of the standard bin, each drawn by itself: in smaller bins parts heap up."""
    tilt_deg: float = 35.0
    """Greatest angle between the optical axis and the vertical."""
    distance_m: tuple[float, float] = (0.6, 1.2)
    """From the camera to the point that it looks at."""
    diameter_px: tuple[float, float] = (32.0, 180.0)
    """The part's diameter in the rendered image, at that distance, drawn uniformly in its logarithm."""
    image_width_px: int = 560
    """Greatest width of a rendered image."""
    image_height_px: int = 420
    """Greatest height of a rendered image."""
    randomizations: tuple[str, ...] = ("default", "strong")
    """Presets of `RANDOMIZATIONS`; each view is lit and coloured by one of them, drawn with equal chances."""
    crop_px: int = 160
    """Side of a query's crop."""
    crop_padding: float = 1.6
    """Side of the crop over the longer side of the visible part's box: room to aim, turn and scale it anew."""
    min_visible_fraction: float = 0.25
    """Instances of which less is visible are no queries."""
    min_visible_px: int = 80
    """Instances of which fewer pixels are visible are no queries."""
    templates: TemplateConfig = field(default_factory=TemplateConfig)
    """Views of the part alone."""

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise ConfigError(f"seed must not be negative, got {self.seed}")
        for name in ("queries", "cameras", "queries_per_camera", "min_visible_px"):
            if getattr(self, name) < 1:
                raise ConfigError(f"{name} must be 1 or more, got {getattr(self, name)}")
        for name, (least, greatest, unit) in _LIMITS.items():
            low, high = getattr(self, name)
            if not least <= low <= high <= greatest:
                raise ConfigError(
                    f"{name} must be two values between {least} and {greatest} {unit}".rstrip()
                    + f", the smaller first, got {low} and {high}"
                )
        for name in ("mixed_share", "min_visible_fraction"):
            if not 0 <= getattr(self, name) <= 1:
                raise ConfigError(f"{name} must be between 0 and 1, got {getattr(self, name)}")
        if not 0 <= self.tilt_deg <= 80:
            raise ConfigError(f"tilt_deg must be between 0 and 80 degrees, got {self.tilt_deg}")
        for name in ("image_width_px", "image_height_px"):
            if not 64 <= getattr(self, name) <= 4096:
                raise ConfigError(f"{name} must be between 64 and 4096, got {getattr(self, name)}")
        if not self.randomizations:
            raise ConfigError("randomizations must name at least one preset, got none")
        for name in self.randomizations:
            if name not in RANDOMIZATIONS:
                raise UnknownNameError("randomization preset", name, RANDOMIZATIONS)
        if not 16 <= self.crop_px <= 1024:
            raise ConfigError(f"crop_px must be between 16 and 1024, got {self.crop_px}")
        if not (math.isfinite(self.crop_padding) and 1.0 <= self.crop_padding <= 4.0):
            raise ConfigError(f"crop_padding must be between 1 and 4, got {self.crop_padding}")
