"""`DataConfig`: the settings of the training data."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

from annotated_types import Interval, MinLen

from simpick.config import Config, Fraction, NonNegativeInt, PositiveInt
from simpick.errors import ConfigError, UnknownNameError
from simpick.rendering import TemplateConfig
from simpick.rendering.camera_effects import CameraEffects
from simpick.scene.config import MAX_PARTS
from simpick.scene.randomization import RANDOMIZATIONS

Split = Literal["train", "validation"]
"""Two disjoint sets of parts."""

# Bounds of both ends of the fields that are ranges.
_Count = Annotated[int, Interval(ge=1, le=MAX_PARTS)]
_Share = Annotated[float, Interval(ge=0.05, le=1)]
_Others = Annotated[int, Interval(ge=1, le=20)]
_Scale = Annotated[float, Interval(ge=0.5, le=2)]
_Distance = Annotated[float, Interval(ge=0.3, le=5)]
_Diameter = Annotated[float, Interval(ge=8, le=1000)]


@dataclass(frozen=True)
class DataConfig(Config):
    """Ranges and sizes of the training data. With a split and an index they determine a shard."""

    seed: NonNegativeInt = 0
    """Seed of parts, bins and views."""
    queries: PositiveInt = 128
    """Most queries per shard; fewer where its cameras do not see as many."""
    cameras: PositiveInt = 16
    """Most views per bin; as many are rendered as the queries need."""
    queries_per_camera: PositiveInt = 16
    """Most queries from one view, so that a shard shows its part in several lights."""
    count: tuple[_Count, _Count] = (8, 40)
    """Fewest and most parts in a bin."""
    mixed_share: Fraction = 0.5
    """Share of bins in which other random parts lie between the shard's own."""
    target_share: tuple[_Share, _Share] = (0.4, 0.8)
    """Share of instances in a mixed bin that are of the shard's part, least and most."""
    others: tuple[_Others, _Others] = (1, 3)
    """Fewest and most other parts in a mixed bin."""
    bin_scale: tuple[_Scale, _Scale] = (0.65, 1.0)
    """Factors on length and width of the standard bin; in smaller bins parts pile up."""
    tilt_deg: Annotated[float, Interval(ge=0, le=80)] = 35.0
    """Largest angle between the optical axis and the vertical."""
    distance_m: tuple[_Distance, _Distance] = (0.6, 1.2)
    """Distance from the camera to the point that it looks at, least and most."""
    diameter_px: tuple[_Diameter, _Diameter] = (32.0, 180.0)
    """The part's diameter in the rendered image, least and most, drawn uniformly in its logarithm."""
    image_width_px: Annotated[int, Interval(ge=64, le=4096)] = 560
    """Largest width of a rendered image."""
    image_height_px: Annotated[int, Interval(ge=64, le=4096)] = 420
    """Largest height of a rendered image."""
    randomizations: Annotated[tuple[str, ...], MinLen(1)] = ("default", "strong", "photo")
    """Presets of lights, colours and textures; each view draws one of them."""
    effects_share: Fraction = 0.6
    """Share of views that get camera effects; the others are as MuJoCo renders them."""
    effects: CameraEffects = field(default_factory=CameraEffects)
    """How strong the camera effects are."""
    crop_px: Annotated[int, Interval(ge=16, le=1024)] = 192
    """Side of the stored crop of a query."""
    crop_padding: Annotated[float, Interval(ge=1, le=4)] = 2.0
    """Side of that crop over the longer side of the visible part's box; room for wrong masks."""
    min_visible_fraction: Fraction = 0.25
    """Instances of which a smaller share is visible are not queries."""
    min_visible_px: PositiveInt = 80
    """Instances with fewer visible pixels are not queries."""
    templates: TemplateConfig = field(default_factory=TemplateConfig)
    """Views of the part alone."""

    def _check_rules(self) -> None:
        for name in ("count", "target_share", "others", "bin_scale", "distance_m", "diameter_px"):
            low, high = getattr(self, name)
            if low > high:
                raise ConfigError(f"{name} must have the smaller value first, got {low} and {high}")
        for name in self.randomizations:
            if name not in RANDOMIZATIONS:
                raise UnknownNameError("randomization preset", name, RANDOMIZATIONS)
