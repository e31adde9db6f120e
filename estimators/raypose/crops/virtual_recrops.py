"""Crops of crops: virtual cameras that are turned about their axes and aimed again, exactly and for many images.

Templates are turned and cropped this way, turned queries too, and training turns and shifts queries the same way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F

from simpick.geometry import Pinhole, aim_virtual_cameras, so3_exp
from simpick.tensor_record import TensorRecord

# A camera whose pixels are thousandths of a tangent, so that boxes of any source camera can be expressed in it.
_TANGENTS = Pinhole(4000, 4000, 1000.0, 1000.0, 2000.0, 2000.0)


@dataclass(frozen=True, eq=False)
class VirtualRecrops(TensorRecord):
    """Virtual cameras at the centres of source cameras."""

    size_px: int
    focal_px: Float[np.ndarray, "n"]
    Rs_crop_source: Float[np.ndarray, "n 3 3"]

    def __len__(self) -> int:
        return len(self.focal_px)

    @property
    def half_tangent(self) -> Float[np.ndarray, "n"]:
        """Return the tangents of half the crops' angles."""
        return self.size_px / 2 / self.focal_px

    def halved(self) -> VirtualRecrops:
        """Return the same views with half as many pixels per side: enough where only means over cells are needed."""
        return VirtualRecrops(self.size_px // 2, self.focal_px / 2, self.Rs_crop_source)


def aim_virtual_recrops(
    source_px: int,
    source_focal_px: Float[np.ndarray, "n"],
    angles_rad: Float[np.ndarray, "n"],
    boxes_xyxy_px: Float[np.ndarray, "n 4"],
    size_px: int,
    *,
    padding: float,
) -> VirtualRecrops:
    """Return virtual cameras on boxes in square source images that are first turned clockwise by the angles.

    Boxes are those of the turned images, in the source's pixels; principal points are in the middle.

    Raises:
        ConfigError: as `aim_virtual_cameras`.
    """
    tangents = (boxes_xyxy_px - source_px / 2) / source_focal_px[:, None]
    aimed = aim_virtual_cameras(_TANGENTS, 1000.0 * tangents + 2000.0, size_px, padding=padding)
    Rs_turned_source = so3_exp(angles_rad[:, None] * np.array([0.0, 0.0, 1.0]))
    return VirtualRecrops(size_px, aimed.focal_px, aimed.Rs_crop_camera @ Rs_turned_source)


def sample_virtual_recrops(
    images: Float[Tensor, "n channels source source"], source_focal_px: Float[np.ndarray, "n"], recrops: VirtualRecrops
) -> Float[Tensor, "n channels size size"]:
    """Return the images resampled for the crops' cameras, 0 beyond the source."""
    source, size = images.shape[-1], recrops.size_px
    # (n, 3, 3): from crop pixels to [-1, 1] across the source image.
    K_source = np.zeros((len(recrops), 3, 3))
    K_source[:, 0, 0] = K_source[:, 1, 1] = source_focal_px * (2 / source)
    K_source[:, 2, 2] = 1.0
    K_crop_inverse = np.zeros((len(recrops), 3, 3))
    K_crop_inverse[:, 0, 0] = K_crop_inverse[:, 1, 1] = 1 / recrops.focal_px
    K_crop_inverse[:, :2, 2] = -recrops.half_tangent[:, None]
    K_crop_inverse[:, 2, 2] = 1.0
    device = images.device
    H = torch.tensor(
        K_source @ np.swapaxes(recrops.Rs_crop_source, 1, 2) @ K_crop_inverse, dtype=torch.float32, device=device
    )
    axis = torch.arange(size, dtype=torch.float32, device=device) + 0.5
    y, x = torch.meshgrid(axis, axis, indexing="ij")
    pixels = torch.stack([x, y, torch.ones_like(x)], dim=-1)
    grid = torch.einsum("nij,yxj->nyxi", H, pixels)
    grid = grid[..., :2] / grid[..., 2:]
    return F.grid_sample(images, grid, align_corners=False)
