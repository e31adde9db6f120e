"""Maps of a rendering: silhouette, inverse depth, surface normals and albedo."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from simpick.tensor_record import TensorRecord

_SMOOTH = 0.25
"""Slopes on both sides of a pixel that differ by less than this fraction of their sum belong to a smooth surface."""


@dataclass(frozen=True, eq=False)
class RenderedMaps(TensorRecord):
    """Maps of n hypotheses in their current poses."""

    silhouette: Float[Tensor, "n size size"]
    """1 where the part covers the pixel's centre, else 0."""
    nearness: Float[Tensor, "n size size"]
    """Depth of the part's origin over that of the surface: 1 at the origin's depth; 0 beside the part."""
    normals: Float[Tensor, "n 3 size size"]
    """Unit normals in the crop's frame that point into the part, away from the camera; 0 beside the part."""
    albedo: Float[Tensor, "n size size"]
    """Luminance of the surface's own colour over its mean; 1 beside the part, and everywhere on parts of one colour."""


def rendered_maps(
    depth_m: Float[Tensor, "n size size"],
    origin_depth_m: Float[Tensor, "n"],
    focal_px: Float[Tensor, "n"],
    albedo: Float[Tensor, "n size size"] | None = None,
) -> RenderedMaps:
    """Return the maps of depth images through square virtual cameras with the principal point in the middle.

    `albedo` is None for parts of one colour.

    Inverse depth q of a plane N X = 1 is linear in the pixel: with x, y counted from the principal point,
    ``N = (f dq/dx, f dq/dy, q - x dq/dx - y dq/dy)``. So normals of flat faces are exact.
    """
    silhouette = (depth_m > 0).float()
    nearness = torch.where(depth_m > 0, origin_depth_m[:, None, None] / depth_m.clamp_min(1e-6), 0.0)
    qx, qy = _one_sided(nearness, -1), _one_sided(nearness, -2)
    x, y = pixel_offsets(depth_m.shape[-1])
    f = focal_px[:, None, None]
    normals = torch.stack([f * qx, f * qy, nearness - x * qx - y * qy], dim=1)
    normals = normals / normals.square().sum(dim=1, keepdim=True).sqrt().clamp_min(1e-9)
    return RenderedMaps(silhouette, nearness, normals, torch.ones_like(silhouette) if albedo is None else albedo)


def pixel_offsets(size: int) -> tuple[Float[Tensor, "size"], Float[Tensor, "size 1"]]:
    """Return the pixel centres' x (a row) and y (a column) from the middle of a square image, in pixels."""
    offsets = torch.arange(size) + 0.5 - size / 2
    return offsets, offsets[:, None]


def _one_sided(nearness: Float[Tensor, "n size size"], axis: int) -> Float[Tensor, "n size size"]:
    """Return slopes that do not cross depth edges: that of the smoother side, or the mean where both agree."""
    size = nearness.shape[axis]
    step = nearness.narrow(axis, 1, size - 1) - nearness.narrow(axis, 0, size - 1)
    inside = (nearness.narrow(axis, 1, size - 1) > 0) & (nearness.narrow(axis, 0, size - 1) > 0)
    # A huge slope marks a missing neighbour, so that the other side is chosen.
    step = torch.where(inside, step, torch.full_like(step, 1e3))
    end = torch.full_like(nearness.narrow(axis, 0, 1), 1e3)
    before, after = torch.cat([end, step], dim=axis), torch.cat([step, end], dim=axis)
    smoother = torch.where(before.abs() <= after.abs(), before, after)
    agree = (before - after).abs() <= _SMOOTH * (before.abs() + after.abs())
    slope = torch.where(agree, (before + after) / 2, smoother)
    return torch.where((nearness > 0) & (slope.abs() < 1e2), slope, 0.0)
