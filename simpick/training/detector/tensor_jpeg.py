"""JPEG compression of many images at once, on their device: the loss of baseline JPEG with halved chroma, no file."""

from __future__ import annotations

import math

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn import functional as F

from simpick.rendering.luminance import LUMINANCE

# Tables of the standard's annex K (ITU-T T.81), for a quality of 50.
_LUMA = (
    (16, 11, 10, 16, 24, 40, 51, 61),
    (12, 12, 14, 19, 26, 58, 60, 55),
    (14, 13, 16, 24, 40, 57, 69, 56),
    (14, 17, 22, 29, 51, 87, 80, 62),
    (18, 22, 37, 56, 68, 109, 103, 77),
    (24, 35, 55, 64, 81, 104, 113, 92),
    (49, 64, 78, 87, 103, 121, 120, 101),
    (72, 92, 95, 98, 112, 100, 103, 99),
)
_CHROMA = (
    (17, 18, 24, 47, 99, 99, 99, 99),
    (18, 21, 26, 66, 99, 99, 99, 99),
    (24, 26, 56, 99, 99, 99, 99, 99),
    (47, 66, 99, 99, 99, 99, 99, 99),
    *((99,) * 8,) * 4,
)
_MIDDLE = 128.0


def compress_jpegs(
    rgb: Float[Tensor, "batch 3 height width"], qualities: Int[Tensor, "batch"]
) -> Float[Tensor, "batch 3 height width"]:
    """Return images in grey levels as JPEG of these qualities, 1 to 100, shows them.

    Height and width are multiples of 16.
    """
    red, green, blue = rgb.unbind(1)
    weights = LUMINANCE
    luma = weights[0] * red + weights[1] * green + weights[2] * blue
    # Differences to blue and red, scaled so that each spans half of the range to either side.
    chroma = torch.stack([(blue - luma) / (2 - 2 * weights[2]), (red - luma) / (2 - 2 * weights[0])], 1)
    luma = _quantized(luma[:, None] - _MIDDLE, _LUMA, qualities)[:, 0] + _MIDDLE
    chroma = _quantized(F.avg_pool2d(chroma, 2), _CHROMA, qualities)
    chroma = F.interpolate(chroma, scale_factor=2, mode="bilinear", align_corners=False)
    blue = luma + (2 - 2 * weights[2]) * chroma[:, 0]
    red = luma + (2 - 2 * weights[0]) * chroma[:, 1]
    green = (luma - weights[0] * red - weights[2] * blue) / weights[1]
    return torch.stack([red, green, blue], 1).round().clamp(0, 255)


def _quantized(
    planes: Float[Tensor, "batch n height width"], table: tuple[tuple[int, ...], ...], qualities: Int[Tensor, "batch"]
) -> Float[Tensor, "batch n height width"]:
    """Return planes around 0 whose blocks' frequencies are rounded to multiples of the table's steps."""
    percent = torch.where(qualities < 50, 5000 // qualities, 200 - 2 * qualities)[:, None, None]
    steps = (torch.tensor(table, device=planes.device) * percent + 50) // 100
    steps = steps.clamp(1, 255)[:, None, None, None]
    cosines = _cosines(planes.device)
    # batch, plane, row and column of the block, row and column in the block
    blocks = planes.unflatten(3, (-1, 8)).unflatten(2, (-1, 8)).transpose(3, 4)
    frequencies = cosines @ blocks @ cosines.T
    blocks = cosines.T @ ((frequencies / steps).round() * steps) @ cosines
    return blocks.transpose(3, 4).flatten(4, 5).flatten(2, 3).round().clamp(-_MIDDLE, _MIDDLE - 1)


def _cosines(device: torch.device) -> Float[Tensor, "8 8"]:
    """Return the orthonormal cosine transform of 8 values, a row per frequency."""
    k = torch.arange(8, device=device, dtype=torch.float32)
    rows = torch.cos((2 * k + 1) * k[:, None] * (math.pi / 16)) / 2
    rows[0] /= math.sqrt(2)
    return rows
