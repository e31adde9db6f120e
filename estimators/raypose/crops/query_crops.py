"""Crops of detections as the network takes them, upright or in several turns about the optical axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from simpick.estimators.raypose.crops.virtual_recrops import aim_virtual_recrops, sample_virtual_recrops
from simpick.estimators.raypose.network.config import RayPoseConfig
from simpick.estimators.raypose.network.pose_maps import ViewPoses
from simpick.estimators.raypose.network.tokens import QueryInputs
from simpick.geometry import crop_images, rotated_boxes, transform
from simpick.records import CameraFrame
from simpick.tensor_record import TensorRecord

# Turned crops are cut from crops with this padding, as in training.
_PADDING = 1.6


@dataclass(frozen=True, eq=False)
class QueryCrops(TensorRecord):
    """A batch of crops with their virtual cameras."""

    inputs: QueryInputs
    Rs_crop_camera: Float[np.ndarray, "n 3 3"]

    def __len__(self) -> int:
        return len(self.Rs_crop_camera)

    def poses_in_crops(
        self, rows: Int[np.ndarray, "m"], Ts_camera_part: Float[np.ndarray, "m 4 4"]
    ) -> Float[np.ndarray, "m 4 4"]:
        """Return poses in the crops of these rows."""
        return transform(self.Rs_crop_camera[rows]) @ Ts_camera_part

    def poses_in_camera(self, rows: Int[np.ndarray, "m"], poses: ViewPoses) -> Float[np.ndarray, "m 4 4"]:
        """Return T_camera_part of views in the crops of these rows; views have one leading dimension."""
        half_tangent = self.inputs.half_tangent[rows].double()
        Rs_camera_crop = np.swapaxes(self.Rs_crop_camera[rows], 1, 2)
        return transform(Rs_camera_crop) @ poses.map(torch.Tensor.double).pose(half_tangent).numpy()


def crop_queries(
    frame: CameraFrame,
    masks: Sequence[Bool[np.ndarray, "height width"]],
    boxes_xyxy_px: Float[np.ndarray, "n 4"],
    network: RayPoseConfig,
    *,
    turns: int = 1,
) -> QueryCrops:
    """Return each detection's crops, one for each of `turns` equal turns, one detection after the other."""
    if turns == 1:
        crops = crop_images(
            frame.rgb, frame.camera, boxes_xyxy_px, network.crop_px, masks=masks, padding=network.padding
        )
        assert crops.masks is not None
        half_tangent = crops.cameras.size_px / 2 / crops.cameras.focal_px
        inputs = QueryInputs(_channels_first(crops.rgb), torch.from_numpy(crops.masks).float(), _single(half_tangent))
        return QueryCrops(inputs, crops.cameras.Rs_crop_camera)
    size = round(network.crop_px * _PADDING / network.padding)
    crops = crop_images(frame.rgb, frame.camera, boxes_xyxy_px, size, masks=masks, padding=_PADDING)
    assert crops.masks is not None
    angles = np.tile(2 * np.pi * np.arange(turns) / turns, (len(crops), 1))
    boxes = rotated_boxes(crops.masks, angles).reshape(-1, 4)
    focal_px = np.repeat(crops.cameras.focal_px, turns)
    recrops = aim_virtual_recrops(size, focal_px, angles.ravel(), boxes, network.crop_px, padding=network.padding)
    images = torch.cat([_channels_first(crops.rgb), torch.from_numpy(crops.masks)[:, None].float()], dim=1)
    sampled = sample_virtual_recrops(images.repeat_interleave(turns, 0), focal_px, recrops)
    inputs = QueryInputs(sampled[:, :3], sampled[:, 3], _single(recrops.half_tangent))
    Rs_crop_camera = recrops.Rs_crop_source @ np.repeat(crops.cameras.Rs_crop_camera, turns, axis=0)
    return QueryCrops(inputs, Rs_crop_camera)


def _channels_first(rgb: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(rgb).permute(0, 3, 1, 2).float() / 255


def _single(values: np.ndarray) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float32)
