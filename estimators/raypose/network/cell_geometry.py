"""Geometry of the cells of a crop: how much of each is covered, by which pixels, and which surface points it shows."""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F

from simpick.estimators.raypose.network.pose_maps import cell_centres


def coverage_and_centroids(
    masks: Float[Tensor, "batch size size"], cells: int
) -> tuple[Float[Tensor, "batch cells"], Float[Tensor, "batch cells 2"]]:
    """Return the masked share of each cell, and the centroid of its masked pixels in half crop sides.

    Where no pixel is masked, the centroid is the cell's centre.
    """
    pixels = cell_centres(masks.shape[-1], device=masks.device).movedim(-1, 0)  # (2, size, size)
    channels = torch.cat([masks[:, None], masks[:, None] * pixels], dim=1)
    pooled = F.adaptive_avg_pool2d(channels, cells).flatten(2).mT  # (batch, cells, 3)
    coverage = pooled[..., 0]
    centroids = pooled[..., 1:] / coverage.clamp_min(1e-6)[..., None]
    centres = cell_centres(cells, device=masks.device).flatten(0, 1)
    return coverage, torch.where(coverage[..., None] > 1e-3, centroids, centres)


def coarser_geometry(
    points: Float[Tensor, "*batch cells 3"], coverage: Float[Tensor, "*batch cells"]
) -> tuple[Float[Tensor, "*batch quarter 3"], Float[Tensor, "*batch quarter"]]:
    """Return positions and coverage on a grid of half as many cells per side: means over what is covered."""
    side = math.isqrt(points.shape[-2])
    x = torch.cat([points * coverage[..., None], coverage[..., None]], dim=-1)
    x = x.unflatten(-2, (side // 2, 2, side // 2, 2)).mean(dim=(-4, -2)).flatten(-3, -2)
    covered = x[..., 3]
    return x[..., :3] / covered.clamp_min(1e-6)[..., None] * (covered > 1e-3)[..., None], covered


def cell_means(values: Float[Tensor, "batch cells"]) -> Float[Tensor, "batch quarter"]:
    """Return the means on a grid of half as many cells per side."""
    side = math.isqrt(values.shape[-1])
    return values.unflatten(-1, (side // 2, 2, side // 2, 2)).mean(dim=(-3, -1)).flatten(1)


def cells_per_token(cells: Float[Tensor, "*batch cells channels"], tokens: int) -> Float[Tensor, "*batch tokens patch"]:
    """Return the channels of each token's cells, one cell after the other; `tokens` is the side of their grid."""
    stride = math.isqrt(cells.shape[-2]) // tokens
    x = cells.unflatten(-2, (tokens, stride, tokens, stride)).movedim(-3, -4)  # (..., tokens, tokens, s, s, channels)
    return x.flatten(-3).flatten(-3, -2)
