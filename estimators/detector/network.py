"""The detector's network: an encoder, a feature pyramid, and one map per question that is asked of each cell."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from simpick.estimators.detector.affinities import OFFSETS
from simpick.estimators.detector.encoder import EfficientNetLite0
from simpick.estimators.detector.encoder_stages import OUTPUT_CHANNELS

PYRAMID_CHANNELS = 64
FINE_CHANNELS = 32
PYRAMID_BLOCKS = (1, 3, 3)
"""Residual blocks at strides 4, 8 and 16; at the coarser ones they cost little, and see far."""


@dataclass(frozen=True, eq=False)
class CellMaps:
    """What the network says of each cell of 2 x 2 px, as logits."""

    foreground: Float[Tensor, "n h w"]
    affinities: Float[Tensor, "n offsets h w"]
    """Whether the same instance covers the cell and its partner at `OFFSETS`."""


def _conv(inputs: int, outputs: int, kernel: int = 3) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, kernel, padding=kernel // 2, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU(inplace=True),
    )


class ResidualBlock(nn.Module):
    """Two convolutions added to their input (He et al. 2016); the identity before training."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = _conv(channels, channels)
        self.second = nn.Conv2d(channels, channels, 3, padding=1, bias=False)
        self.norm = nn.BatchNorm2d(channels)
        nn.init.zeros_(self.norm.weight)

    def forward(self, x: Float[Tensor, "n c h w"]) -> Float[Tensor, "n c h w"]:
        """Return the block's features."""
        return self.norm(self.second(self.first(x))).add_(x).relu_()


class InstanceNetwork(nn.Module):
    """From images to `CellMaps`."""

    def __init__(self) -> None:
        super().__init__()
        self.encoder = EfficientNetLite0()
        channels = PYRAMID_CHANNELS
        self.lateral = nn.ModuleList(nn.Conv2d(c, channels, 1) for c in OUTPUT_CHANNELS[1:])
        self.smooth = nn.ModuleList(
            nn.Sequential(_conv(channels, channels), *(ResidualBlock(channels) for _ in range(blocks)))
            for blocks in PYRAMID_BLOCKS
        )
        self.context = nn.Sequential(_conv(channels, channels), ResidualBlock(channels))
        self.to_fine = nn.Conv2d(channels, 4 * FINE_CHANNELS, 1)
        self.fine_lateral = nn.Conv2d(OUTPUT_CHANNELS[0], FINE_CHANNELS, 1)
        self.fine = nn.Sequential(_conv(FINE_CHANNELS, FINE_CHANNELS), ResidualBlock(FINE_CHANNELS))
        self.foreground = nn.Conv2d(FINE_CHANNELS, 1, 1)
        self.affinities = nn.Conv2d(FINE_CHANNELS, len(OFFSETS), 1)

    def forward(self, rgb: Float[Tensor, "n 3 height width"]) -> CellMaps:
        """Return the maps of images with values in [0, 255]; height and width are multiples of 32."""
        finest, *features = self.encoder(rgb)
        x = self.lateral[3](features[3])
        for k in (2, 1, 0):
            x = F.interpolate(x, scale_factor=2.0, mode="nearest").add_(self.lateral[k](features[k]))
            x = self.smooth[k](x)
        x = self.context(x)
        x = F.pixel_shuffle(self.to_fine(x), 2).add_(self.fine_lateral(finest))
        x = self.fine(x.relu_())
        return CellMaps(self.foreground(x)[:, 0], self.affinities(x))
