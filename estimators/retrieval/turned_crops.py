"""Crops of all templates in all rotations about the optical axis, made as the query's crops are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F

from simpick.estimators.retrieval.descriptors import CROP_PX, luminance
from simpick.geometry import aim_virtual_cameras, rotated_boxes, so3_exp, transform
from simpick.rendering import TemplateSet

PADDING = 1.1
"""Side of a crop over the longer side of the silhouette's box; templates and queries alike."""
_VIEWS_AT_ONCE = 4


@dataclass(frozen=True, eq=False)
class TurnedCrops:
    """The virtual cameras of all crops: one per view and turn."""

    Ts_crop_part: Float[np.ndarray, "n 4 4"]
    focal_px: Float[np.ndarray, "n"]
    homographies: Float[np.ndarray, "views turns 3 3"]
    """From crop pixels to the view's."""


def aim_turned_crops(templates: TemplateSet, turns: int) -> TurnedCrops:
    """Return a virtual camera for each view and turn, aimed at the middle of the turned silhouette's box."""
    angles = 2 * np.pi * np.arange(turns) / turns
    boxes = rotated_boxes(templates.masks, np.tile(angles, (len(templates), 1))).reshape(-1, 4)
    cameras = aim_virtual_cameras(templates.camera, boxes, CROP_PX, padding=PADDING)
    Rs_turned_view = np.tile(so3_exp(angles[:, None] * np.array([0.0, 0.0, 1.0])), (len(templates), 1, 1))
    Rs_crop_view = cameras.Rs_crop_camera @ Rs_turned_view
    Ts_crop_part = transform(Rs_crop_view) @ np.repeat(templates.Ts_camera_part, turns, axis=0)
    crop_from_view = cameras.Ks @ Rs_crop_view @ np.linalg.inv(templates.camera.K)
    homographies = np.linalg.inv(crop_from_view).reshape(len(templates), turns, 3, 3)
    return TurnedCrops(Ts_crop_part, cameras.focal_px, homographies)


def render_turned_crops(templates: TemplateSet, crops: TurnedCrops) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield brightness and masks (n, size, size) of the crops, a few views at a time, in order."""
    size, turns = templates.camera.width, crops.homographies.shape[1]
    images = torch.stack(
        [luminance(torch.tensor(templates.rgb)), torch.tensor(templates.masks, dtype=torch.float32)], dim=1
    )
    # Where crops are smaller than views, sampling would skip pixels and alias; so views are blurred.
    blurred = F.interpolate(F.avg_pool2d(images, 2), size=(size, size), mode="bilinear")
    zoom = crops.focal_px.reshape(len(templates), turns).mean(axis=1) / templates.camera.fx
    images = torch.where(torch.tensor(zoom < 0.75)[:, None, None, None], blurred, images)
    y, x = torch.meshgrid(torch.arange(CROP_PX) + 0.5, torch.arange(CROP_PX) + 0.5, indexing="ij")
    pixels = torch.stack([x, y, torch.ones_like(x)], dim=-1).reshape(-1, 3)
    homographies = torch.tensor(crops.homographies, dtype=torch.float32)
    for start in range(0, len(templates), _VIEWS_AT_ONCE):
        H, view = homographies[start : start + _VIEWS_AT_ONCE], images[start : start + _VIEWS_AT_ONCE]
        source = torch.einsum("vtij,pj->vtpi", H, pixels)
        source = (
            source[..., :2] / source[..., 2:] * (2 / size) - 1
        )  # (views, turns, pixels, 2), the image being [-1, 1]
        grid = source.reshape(len(H), turns * CROP_PX, CROP_PX, 2)
        sampled = F.grid_sample(view, grid, align_corners=False).reshape(len(H), 2, turns, CROP_PX, CROP_PX)
        gray, mask = (channel.flatten(0, 1) for channel in sampled.unbind(dim=1))
        yield gray, mask > 0.5
