"""Crops of templates as the network takes them: image, mask, pose, and where each cell lies on the part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor
from torch.nn import functional as F

from simpick.estimators.raypose.crops.aimed_templates import AimedTemplates
from simpick.estimators.raypose.crops.virtual_recrops import sample_virtual_recrops
from simpick.estimators.raypose.network.config import RayPoseConfig
from simpick.estimators.raypose.network.pose_maps import ViewPoses
from simpick.estimators.raypose.network.tokens import TemplateInputs
from simpick.geometry import invert, transform, transform_points
from simpick.rendering import TemplateSet
from simpick.tensor_record import TensorRecord


@dataclass(frozen=True, eq=False)
class TemplateImages(TensorRecord):
    """All views of a part as tensors, on the device where crops are sampled."""

    rgb: UInt8[Tensor, "views 3 size size"]
    masks: Bool[Tensor, "views size size"]
    depth_m: Float[Tensor, "views size size"]
    focal_px: float

    @staticmethod
    def of(templates: TemplateSet) -> TemplateImages:
        """Return the images of a template set, on the CPU, in the same memory."""
        rgb = torch.from_numpy(templates.rgb).permute(0, 3, 1, 2)
        masks, depth_m = torch.from_numpy(templates.masks), torch.from_numpy(templates.depth_m)
        return TemplateImages(rgb, masks, depth_m, templates.camera.fx)


@dataclass(frozen=True, eq=False)
class TemplateCrops(TensorRecord):
    """Views of one part as the network takes them."""

    rgb: Float[Tensor, "*batch 3 size size"]
    masks: Float[Tensor, "*batch size size"]
    points_m: Float[Tensor, "*batch cells 3"]
    """Mean position in the part's frame of what each cell shows; 0 where it shows nothing. Cells are those of
    `RayPoseConfig.geometry_cells`."""
    coverage: Float[Tensor, "*batch cells"]
    half_tangent: Float[np.ndarray, "*batch"]
    Ts_crop_part: Float[np.ndarray, "*batch 4 4"]

    def __len__(self) -> int:
        return len(self.half_tangent)


def move_points(
    points: Float[Tensor, "views cells 3"],
    coverage: Float[Tensor, "views cells"],
    Ts_new_old: Float[np.ndarray, "views 4 4"],
) -> Float[Tensor, "views cells 3"]:
    """Return the cells' points in new part frames, in the unit of the transforms; 0 where a cell shows nothing."""
    moved = transform_points(Ts_new_old, points.double().numpy())
    return torch.tensor(moved, dtype=torch.float32) * (coverage > 0)[..., None]


def sample_templates(images: TemplateImages, aimed: AimedTemplates) -> Float[Tensor, "n 4 size size"]:
    """Return colour and mask as the cameras see them, on the images' device."""
    views = torch.from_numpy(aimed.views).to(images.rgb.device)
    channels = torch.cat([images.rgb[views].float() / 255, images.masks[views][:, None].float()], dim=1)
    return sample_virtual_recrops(channels, np.full(len(views), images.focal_px), aimed.recrops)


def crop_templates(images: TemplateImages, aimed: AimedTemplates, config: RayPoseConfig) -> TemplateCrops:
    """Return what the cameras see, on the images' device."""
    views = torch.from_numpy(aimed.views).to(images.rgb.device)
    focal_px = np.full(len(views), images.focal_px)
    mask = images.masks[views][:, None].float()
    points_m = _points_in_part(images.depth_m[views], images.focal_px, aimed) * mask
    sampled = sample_templates(images, aimed)
    geometry = sample_virtual_recrops(torch.cat([mask, points_m], dim=1), focal_px, aimed.recrops.halved())
    cells = F.adaptive_avg_pool2d(geometry, config.geometry_cells).flatten(2).mT  # (n, cells, 4)
    coverage = cells[..., 0]
    mean = cells[..., 1:] / coverage.clamp_min(1e-6)[..., None] * (coverage > 1e-3)[..., None]
    return TemplateCrops(sampled[:, :3], sampled[:, 3], mean, coverage, aimed.recrops.half_tangent, aimed.Ts_crop_part)


def collate(sets: Sequence[TemplateCrops], diameters_m: Sequence[float]) -> TemplateInputs:
    """Return sets of equally many crops as one batch for the network."""
    crops = TemplateCrops.stack(sets)
    device = crops.rgb.device
    diameter_m = torch.tensor(np.asarray(diameters_m), dtype=torch.float32, device=device)
    half_tangent = torch.tensor(crops.half_tangent, dtype=torch.float32, device=device)
    poses = ViewPoses.of(torch.tensor(crops.Ts_crop_part, dtype=torch.float32, device=device), half_tangent)
    points = crops.points_m / diameter_m[:, None, None, None]
    return TemplateInputs(crops.rgb, crops.masks, half_tangent, poses, points, crops.coverage, diameter_m)


def _points_in_part(
    depth_m: Float[Tensor, "n size size"], focal_px: float, aimed: AimedTemplates
) -> Float[Tensor, "n 3 size size"]:
    """Return the surface point of each pixel in the part's frame, in metres; meaningless outside the part."""
    size, device = depth_m.shape[-1], depth_m.device
    axis = (torch.arange(size, device=device) + 0.5 - size / 2) / focal_px
    y, x = torch.meshgrid(axis, axis, indexing="ij")
    points = torch.stack([x, y, torch.ones_like(x)]) * depth_m[:, None]
    T_part_source = invert(aimed.Ts_crop_part) @ transform(aimed.recrops.Rs_crop_source)
    T = torch.tensor(T_part_source, dtype=torch.float32, device=device)
    return torch.einsum("nij,njyx->niyx", T[:, :3, :3], points) + T[:, :3, 3, None, None]
