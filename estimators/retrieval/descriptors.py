"""Descriptors of crops: local histograms of edge directions, and the silhouette."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor
from torch.nn import functional as F

from simpick.rendering.luminance import LUMINANCE

CROP_PX = 64
"""Side of the crops that are described."""
BINS = 9
"""Edge directions of 20 degrees each; light-to-dark and dark-to-light edges count as one, since lights differ."""
CELL_PX = 8
SILHOUETTE_CELLS = 16
# Cells with less contrast than this fraction of the crop's mean count as flat.
_FLAT = 0.1


def luminance(rgb: UInt8[Tensor, "n height width 3"]) -> Float[Tensor, "n height width"]:
    """Return brightness in [0, 1]."""
    return rgb.float() @ rgb.new_tensor(LUMINANCE, dtype=torch.float32) / 255


def describe(gray: Float[Tensor, "n size size"], masks: Bool[Tensor, "n size size"]) -> Float[Tensor, "n dimensions"]:
    """Return descriptors whose dot product is the similarity of two crops, in [0, 1].

    One half is a histogram of edge directions in each of 8 x 8 cells, weighted by contrast and normalised per cell
    (after Dalal and Triggs, CVPR 2005). Only pixels whose neighbours all lie in the mask count, so the background has
    no influence. The other half is the mask at 16 x 16 cells. Each half has length 1 / sqrt(2).
    """
    edges = _edge_histograms(gray, masks.float())  # (n, bins, cells, cells)
    silhouette = F.adaptive_avg_pool2d(masks.float()[:, None], SILHOUETTE_CELLS)
    halves = [F.normalize(half.flatten(1), dim=1) for half in (edges, silhouette)]
    return torch.cat(halves, dim=1) / 2**0.5


def _edge_histograms(
    gray: Float[Tensor, "n size size"], masks: Float[Tensor, "n size size"]
) -> Float[Tensor, "n bins cells cells"]:
    x, mask = (gray * masks)[:, None], masks[:, None]
    gx = F.pad(x[..., 2:] - x[..., :-2], (1, 1, 0, 0))
    gy = F.pad(x[..., 2:, :] - x[..., :-2, :], (0, 0, 1, 1))
    inside = -F.max_pool2d(-mask, 3, 1, 1)
    votes = (gx * gx + gy * gy).sqrt() * inside
    direction = torch.atan2(gy, gx) * (BINS / torch.pi) % BINS
    # Each pixel votes for the two nearest directions in proportion.
    centres = torch.arange(BINS, device=gray.device, dtype=gray.dtype)[:, None, None]
    apart = (direction - centres).abs()
    shares = (1 - torch.minimum(apart, BINS - apart)).clamp_min(0)
    histograms = F.avg_pool2d(votes * shares, CELL_PX)  # (n, bins, cells, cells)
    contrast = histograms.square().sum(dim=1, keepdim=True)
    flat = _FLAT**2 * contrast.mean(dim=(2, 3), keepdim=True)
    return histograms / (contrast + flat + 1e-12).sqrt()
