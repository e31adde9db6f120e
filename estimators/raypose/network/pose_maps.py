"""Pose maps: a pose relative to a reference view as a bundle of rays and a grid of offsets, and back (paper, sec. 3.2).

A *view* is a virtual-camera crop: rotation R of the part in the crop's frame, projection c of the part's origin in half
crop sides (-1 to 1 across the crop), and half extent h = t_z tan(half the crop's angle), the half side of the crop in
metres at the part's depth. Intrinsics and distance enter by h alone. Departure from the paper: the third channel of the
translation map is the logarithm of the relative depth scale (eq. 8), with focal lengths of crops for zoom ratios.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from simpick.geometry.torch_rotations import kabsch
from simpick.tensor_record import TensorRecord

CHANNELS = 6
"""Of a pose map: ray direction (3), offset from the part's projected origin in box sides (2), log of relative scale."""


@dataclass(frozen=True, eq=False)
class ViewPoses(TensorRecord):
    """Poses of parts in their crops; leading dimensions are free."""

    R: Float[Tensor, "*batch 3 3"]
    """R_crop_part."""
    centre: Float[Tensor, "*batch 2"]
    """Projection of the part's origin, in half crop sides from the crop's middle."""
    half_extent_at_depth_m: Float[Tensor, "*batch"]
    """Half the crop's side at the part's depth, in metres."""

    @staticmethod
    def of(T_crop_part: Float[Tensor, "*batch 4 4"], half_tangent: Float[Tensor, "*batch"]) -> ViewPoses:
        """Return the view of a pose; `half_tangent` is the tangent of half the crop's angle, size / (2 focal)."""
        t = T_crop_part[..., :3, 3]
        centre = t[..., :2] / t[..., 2:] / half_tangent[..., None]
        return ViewPoses(T_crop_part[..., :3, :3], centre, t[..., 2] * half_tangent)

    def pose(self, half_tangent: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 4 4"]:
        """Return T_crop_part: the inverse of `of`."""
        depth = self.half_extent_at_depth_m / half_tangent
        lateral = self.centre * self.half_extent_at_depth_m[..., None]
        t = torch.cat([lateral, depth[..., None]], dim=-1)
        top = torch.cat([self.R, t[..., None]], dim=-1)
        last = top.new_tensor([0.0, 0.0, 0.0, 1.0]).expand(*top.shape[:-2], 1, 4)
        return torch.cat([top, last], dim=-2)


def cell_centres(cells: int, *, device: torch.device | str | None = None) -> Float[Tensor, "cells cells 2"]:
    """Return x and y of the cells' centres in half crop sides, row by row from the top left."""
    axis = (torch.arange(cells, device=device, dtype=torch.float32) + 0.5) * (2 / cells) - 1
    y, x = torch.meshgrid(axis, axis, indexing="ij")
    return torch.stack([x, y], dim=-1)


def canonical_rays(cells: int, *, device: torch.device | str | None = None) -> Float[Tensor, "cells cells 3"]:
    """Return the rays d* of the identity: unit vectors through the cells of a grid with K = I (paper, eq. 1)."""
    grid = cell_centres(cells, device=device)
    rays = torch.cat([grid, torch.ones_like(grid[..., :1])], dim=-1)
    return rays / torch.linalg.vector_norm(rays, dim=-1, keepdim=True)


def encode_rotation(R: Float[Tensor, "*batch 3 3"], cells: int) -> Float[Tensor, "*batch cells cells 3"]:
    """Return the ray map of a rotation: d_i = R d*_i."""
    rays = canonical_rays(cells, device=R.device).to(R.dtype)
    return torch.einsum("...ij,yxj->...yxi", R, rays)


def decode_rotation(rays: Float[Tensor, "*batch cells cells 3"]) -> Float[Tensor, "*batch 3 3"]:
    """Return the rotation that maps the canonical rays closest to these (paper, eq. 2; SVD in float64)."""
    canonical = canonical_rays(rays.shape[-2], device=rays.device).to(rays.dtype).flatten(0, 1)
    flat = rays.flatten(-3, -2)
    return kabsch(canonical.expand(flat.shape), flat)


def encode_offsets(
    centre: Float[Tensor, "*batch 2"], cells: int, padding: float
) -> Float[Tensor, "*batch cells cells 2"]:
    """Return how far each cell's centre is from the part's projected origin, in sides of the box (paper, eq. 4)."""
    grid = cell_centres(cells, device=centre.device).to(centre.dtype)
    return (grid - centre[..., None, None, :]) * (padding / 2)


def decode_centre(offsets: Float[Tensor, "*batch cells cells 2"], padding: float) -> Float[Tensor, "*batch 2"]:
    """Return the projected origin: the mean of the cells' predictions (paper, eq. 5)."""
    grid = cell_centres(offsets.shape[-2], device=offsets.device).to(offsets.dtype)
    return (grid - offsets * (2 / padding)).mean(dim=(-3, -2))


def encode_pose_maps(
    query: ViewPoses, reference: ViewPoses, cells: int, padding: float
) -> Float[Tensor, "*batch cells cells 6"]:
    """Return the maps of the query's pose relative to a reference view.

    Rays of R_query R_reference^T, offsets from the query's own centre, and in every cell the logarithm of the query's
    half extent over the reference's.
    """
    rays = encode_rotation(query.R @ reference.R.mT, cells)
    offsets = encode_offsets(query.centre.expand(*rays.shape[:-3], 2), cells, padding)
    scale = (query.half_extent_at_depth_m / reference.half_extent_at_depth_m).log().expand(rays.shape[:-3])
    return torch.cat([rays, offsets, scale[..., None, None, None].expand(*rays.shape[:-1], 1)], dim=-1)


def decode_pose_maps(maps: Float[Tensor, "*batch cells cells 6"], reference: ViewPoses, padding: float) -> ViewPoses:
    """Return the view that `encode_pose_maps` was given, or the one closest to noisy maps (eq. 9). Differentiable."""
    R = decode_rotation(maps[..., :3]) @ reference.R
    centre = decode_centre(maps[..., 3:5], padding)
    half_extent_at_depth_m = reference.half_extent_at_depth_m * maps[..., 5].mean(dim=(-2, -1)).exp()
    return ViewPoses(R, centre, half_extent_at_depth_m)
