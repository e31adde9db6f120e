"""The detector's network: an encoder, a feature pyramid, and one map per question that is asked of each cell."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from simpick.estimators.detector.affinities import OFFSETS
from simpick.estimators.detector.encoder import OUTPUT_CHANNELS, EfficientNetLite0

PYRAMID_CHANNELS = 64
FINE_CHANNELS = 32
OFFSET_SCALE = 16.0
"""Cells per unit of the predicted offsets to the centre."""


@dataclass(frozen=True, eq=False)
class CellMaps:
    """What the network says of each cell of 2 x 2 px; all but the offsets are logits."""

    foreground: Float[Tensor, "n h w"]
    centre: Float[Tensor, "n h w"]
    """Whether the middle of an instance's visible pixels lies here."""
    to_centre: Float[Tensor, "n 2 h w"]
    """(rows, columns) to that middle, in cells."""
    affinities: Float[Tensor, "n offsets h w"]
    """Whether the same instance covers the cell and its partner at `OFFSETS`."""


def _conv(inputs: int, outputs: int, kernel: int = 3) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, kernel, padding=kernel // 2, bias=False), nn.BatchNorm2d(outputs), nn.ReLU()
    )


class InstanceNetwork(nn.Module):
    """From images to `CellMaps`."""

    def __init__(self) -> None:
        super().__init__()
        self.encoder = EfficientNetLite0()
        channels = PYRAMID_CHANNELS
        self.lateral = nn.ModuleList(nn.Conv2d(c, channels, 1) for c in OUTPUT_CHANNELS[1:])
        # One for each of the strides 16, 8 and 4.
        self.smooth = nn.ModuleList(_conv(channels, channels) for _ in range(3))
        self.context = _conv(channels, channels)
        self.to_fine = nn.Conv2d(channels, 4 * FINE_CHANNELS, 1)
        self.fine_lateral = nn.Conv2d(OUTPUT_CHANNELS[0], FINE_CHANNELS, 1)
        self.fine = _conv(FINE_CHANNELS, FINE_CHANNELS)
        self.maps = nn.Conv2d(FINE_CHANNELS, 4, 1)
        with torch.no_grad():
            # Few cells are centres: without this the first steps learn nothing but that.
            self.maps.bias[1] = -5.0  # pyright: ignore[reportOptionalSubscript]
        # Whether far cells belong together needs context more than detail.
        self.affinities = nn.Conv2d(FINE_CHANNELS, len(OFFSETS), 1)

    def forward(self, rgb: Float[Tensor, "n 3 height width"]) -> CellMaps:
        """Return the maps of images with values in [0, 255]; height and width are multiples of 32."""
        finest, *features = self.encoder(rgb)
        x = self.lateral[3](features[3])
        for k in (2, 1, 0):
            x = F.interpolate(x, scale_factor=2.0, mode="nearest") + self.lateral[k](features[k])
            x = self.smooth[k](x)
        x = self.context(x)
        x = F.pixel_shuffle(self.to_fine(x), 2) + self.fine_lateral(finest)
        x = self.fine(F.relu(x))
        maps, affinities = self.maps(x), self.affinities(x)
        return CellMaps(maps[:, 0], maps[:, 1], OFFSET_SCALE * maps[:, 2:4], affinities)
