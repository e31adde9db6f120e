"""`RenderQuality`: what a colour image costs, and the qualities in use."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Interval

from simpick.config import Config


@dataclass(frozen=True)
class RenderQuality(Config):
    """What a colour image costs. Depth and ids are not touched by it."""

    shadow_map_px: Annotated[int, Interval(ge=0, le=16384)] = 1024
    """Side of the shadow map; 0 renders without shadows."""
    samples: Annotated[int, Interval(ge=0, le=16)] = 2
    """Anti-aliasing samples a pixel; 0 or 1 means none. Drivers may round up."""


SCENE_QUALITY = RenderQuality()
"""With shadows, at a cost that a software renderer can bear."""
PART_QUALITY = RenderQuality(shadow_map_px=0, samples=4)
"""Of parts alone: no shadows; smooth edges, which gradients at 64 px need."""
