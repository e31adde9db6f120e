"""A small residual network on hand-made channels: the image encoder that is trained with the rest.

The paper uses a frozen DINOv2 instead, see `dino_encoder`.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from simpick.estimators.raypose.network.config import encoder_widths, norm_groups
from simpick.estimators.raypose.network.encoders.feature_maps import FeatureMaps
from simpick.rendering.luminance import LUMINANCE

CHANNELS = 9
"""Of `orientation_channels`."""
_BRIGHTEST = 4.0
"""Of the surroundings, in standard deviations of the part's brightness."""


def orientation_channels(
    rgb: Float[Tensor, "batch 3 size size"], masks: Float[Tensor, "batch size size"]
) -> Float[Tensor, "batch 9 size size"]:
    """Return the mask (fifth), and with and without surroundings brightness, gradient direction (2) and magnitude.

    Brightness is normalised over the mask. The first four channels are black outside of it, as around a template; the
    last four show everything, because the mask can be wrong. Directions are doubled angles, which do not distinguish
    dark-to-light edges from light-to-dark ones, since that depends on the lights.
    """
    mask = masks[:, None]
    gray = torch.einsum("bcyx,c->byx", rgb, rgb.new_tensor(LUMINANCE))[:, None]
    area = mask.sum(dim=(2, 3), keepdim=True).clamp_min(1.0)
    mean = (gray * mask).sum(dim=(2, 3), keepdim=True) / area
    variance = ((gray - mean).square() * mask).sum(dim=(2, 3), keepdim=True) / area
    gray = (gray - mean) / (variance + 1e-3).sqrt()
    everything = gray.clamp(-_BRIGHTEST, _BRIGHTEST)
    return torch.cat([*_with_gradients(gray * mask), mask, *_with_gradients(everything)], dim=1)


def _with_gradients(gray: Float[Tensor, "batch 1 size size"]) -> tuple[Tensor, Tensor, Tensor]:
    padded = F.pad(gray, (1, 1, 1, 1), mode="replicate")
    gx = (padded[..., 1:-1, 2:] - padded[..., 1:-1, :-2]) / 2
    gy = (padded[..., 2:, 1:-1] - padded[..., :-2, 1:-1]) / 2
    magnitude = (gx.square() + gy.square() + 1e-6).sqrt()
    double = torch.cat([(gx.square() - gy.square()) / magnitude, 2 * gx * gy / magnitude], dim=1)
    return gray, double, magnitude


class ResidualBlock(nn.Module):
    """Two 3 x 3 convolutions and a shortcut, with group normalisation, which does not depend on the batch."""

    def __init__(self, inputs: int, outputs: int, stride: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False)
        self.norm1 = nn.GroupNorm(norm_groups(outputs), outputs)
        self.conv2 = nn.Conv2d(outputs, outputs, 3, 1, 1, bias=False)
        self.norm2 = nn.GroupNorm(norm_groups(outputs), outputs)
        same = stride == 1 and inputs == outputs
        self.shortcut = nn.Identity() if same else nn.Conv2d(inputs, outputs, 1, stride, bias=False)

    def forward(self, x: Float[Tensor, "batch inputs h w"]) -> Float[Tensor, "batch outputs h2 w2"]:
        """Return the block's output."""
        y = F.relu(self.norm1(self.conv1(x)))
        return F.relu(self.norm2(self.conv2(y)) + self.shortcut(x))


class ConvolutionalEncoder(nn.Module):
    """Convolutions with stride 8 on `orientation_channels`; trained with the rest of the network."""

    def __init__(self, width: int) -> None:
        super().__init__()
        stem, self.fine_width, _ = encoder_widths(width)
        self.stem = nn.Conv2d(CHANNELS, stem, 5, 2, 2)
        self.blocks = nn.Sequential(
            ResidualBlock(stem, self.fine_width, 2),
            ResidualBlock(self.fine_width, width, 2),
            ResidualBlock(width, width, 1),
        )

    def forward(self, rgb: Float[Tensor, "batch 3 size size"], masks: Float[Tensor, "batch size size"]) -> FeatureMaps:
        """Return one feature vector per 8 x 8 pixels and one per 4 x 4; RGB in [0, 1]."""
        x = orientation_channels(rgb, masks)  # (batch, 9, size, size)
        fine = self.blocks[0](F.relu(self.stem(x)))  # (batch, fine width, size / 4, size / 4)
        return FeatureMaps(self.blocks[1:](fine), fine)  # coarse: (batch, width, size / 8, size / 8)
