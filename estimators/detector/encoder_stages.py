"""The stages of EfficientNet-Lite0 (Tan and Le 2019); no torch is loaded to know them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Stage:
    """Inverted-residual blocks of one width; the first has the stride."""

    repeats: int
    kernel: int
    stride: int
    expansion: int
    channels: int


STEM_CHANNELS = 32
STAGES = (
    Stage(1, 3, 1, 1, 16),
    Stage(2, 3, 2, 6, 24),
    Stage(2, 5, 2, 6, 40),
    Stage(3, 3, 2, 6, 80),
    Stage(3, 5, 1, 6, 112),
    Stage(4, 5, 2, 6, 192),
)
OUTPUT_STAGES = (0, 1, 2, 4, 5)
"""Stages whose features are returned: the last ones of strides 2, 4, 8, 16 and 32."""
OUTPUT_CHANNELS = tuple(STAGES[k].channels for k in OUTPUT_STAGES)
STRIDE = 32
"""Height and width of an image must be multiples of this."""
