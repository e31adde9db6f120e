"""Maps of each detection: brightness, mask, and where the mask's edge can be trusted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from simpick.geometry import VirtualCameras, aim_virtual_cameras
from simpick.geometry.crops import warp
from simpick.records import CameraFrame
from simpick.rendering.luminance import LUMINANCE


@dataclass(frozen=True, eq=False)
class QueryMaps:
    """Maps of n detections in their own virtual cameras at one size."""

    brightness: Float[Tensor, "n size size"]
    """Luminance over its mean within the mask."""
    mask: Float[Tensor, "n size size"]
    """Share of each pixel that belongs to the detection."""
    trust: Float[Tensor, "n size size"]
    """Weight of differences of silhouettes: 1 on the detection and on the background, little on other detections, which
    may hide the part, and 0 beyond the image."""
    cameras: VirtualCameras

    def rows(self, index: Int[np.ndarray, "m"]) -> QueryMaps:
        """Return the maps of these detections."""
        return QueryMaps(self.brightness[index], self.mask[index], self.trust[index], self.cameras.rows(index))


def query_maps(
    frame: CameraFrame,
    masks: Sequence[Bool[np.ndarray, "height width"]],
    boxes_xyxy_px: Float[np.ndarray, "n 4"],
    others: Sequence[Bool[np.ndarray, "height width"]],
    size_px: int,
    *,
    padding: float,
    occluder_weight: float,
) -> QueryMaps:
    """Return the maps of detections whose masks have these boxes; `others` are the pixels of all other detections."""
    cameras = aim_virtual_cameras(frame.camera, boxes_xyxy_px, size_px, padding=padding)
    gray = np.rint(frame.rgb @ np.array(LUMINANCE)).astype(np.uint8)
    inside = np.full(gray.shape, 255, np.uint8)
    maps = []
    for mask, other, H in zip(masks, others, cameras.homographies(frame.camera), strict=True):
        labels = np.stack([gray, 255 * mask.astype(np.uint8), 255 * other.astype(np.uint8), inside], axis=-1)
        maps.append(warp(labels, H, size_px))
    stacked = torch.from_numpy(np.stack(maps)).float().permute(3, 0, 1, 2) / 255  # (4, n, size, size)
    brightness, mask, other, image = stacked
    mean = (brightness * mask).sum(dim=(1, 2)) / mask.sum(dim=(1, 2)).clamp_min(1e-6)
    trust = image * (1 - (1 - occluder_weight) * other)
    return QueryMaps(brightness / mean.clamp_min(0.02)[:, None, None], mask, trust, cameras)
