"""Crops of a part's rendered views, turned and framed as a detection's crop is, with the geometry they show."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn import functional as F

from simpick.estimators.raypose.crops.virtual_recrops import aim_virtual_recrops, sample_virtual_recrops
from simpick.estimators.raypose.network.config import RayPoseConfig
from simpick.estimators.raypose.network.pose_maps import ViewPoses
from simpick.estimators.raypose.network.tokens import TemplateInputs
from simpick.geometry import SymmetryGroup, invert, rotated_boxes, transform, transform_points
from simpick.rendering import TemplateSet
from simpick.tensor_record import TensorRecord


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

    def nearest_to(self, T_crop_part: Float[np.ndarray, "4 4"], symmetries: SymmetryGroup) -> TemplateCrops:
        """Return the same images with those of their equivalent poses that are rotated least against `T_crop_part`.

        Then the templates of a symmetric part agree: the same place on it has about the same position in all of them.
        """
        if symmetries.is_trivial:
            return self
        Ts = symmetries.closest_equivalent(self.Ts_crop_part, T_crop_part)
        points_m = move_points(self.points_m, self.coverage, invert(Ts) @ self.Ts_crop_part)
        return dataclasses.replace(self, points_m=points_m, Ts_crop_part=Ts)


def move_points(
    points: Float[Tensor, "views cells 3"],
    coverage: Float[Tensor, "views cells"],
    Ts_new_old: Float[np.ndarray, "views 4 4"],
) -> Float[Tensor, "views cells 3"]:
    """Return the cells' points in new part frames, in the unit of the transforms; 0 where a cell shows nothing."""
    moved = transform_points(Ts_new_old, points.double().numpy())
    return torch.tensor(moved, dtype=torch.float32) * (coverage > 0)[..., None]


def crop_templates(
    templates: TemplateSet,
    views: Int[np.ndarray, "n"],
    angles_rad: Float[np.ndarray, "n"],
    config: RayPoseConfig,
    *,
    shift: Float[np.ndarray, "n 2"] | None = None,
    zoom: Float[np.ndarray, "n"] | None = None,
) -> TemplateCrops:
    """Return the given views turned clockwise by the angles, each framed by its silhouette's box.

    `shift` moves each box by this share of its longer side and `zoom` enlarges it, as if the template's camera stood
    elsewhere.
    """
    source, focal = templates.camera.width, np.full(len(views), templates.camera.fx)
    boxes = rotated_boxes(templates.masks[views], angles_rad[:, None])[:, 0]
    centre, size = (boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2]
    if shift is not None:
        centre = centre + shift * size.max(axis=1, keepdims=True)
    if zoom is not None:
        size = size * zoom[:, None]
    boxes = np.concatenate([centre - size / 2, centre + size / 2], axis=1)
    recrops = aim_virtual_recrops(source, focal, angles_rad, boxes, config.crop_px, padding=config.padding)
    rgb = torch.from_numpy(templates.rgb[views]).permute(0, 3, 1, 2).float() / 255
    mask = torch.from_numpy(templates.masks[views])[:, None].float()
    points_m = _points_in_part(templates, views) * mask
    sampled = sample_virtual_recrops(torch.cat([rgb, mask], dim=1), focal, recrops)
    geometry = sample_virtual_recrops(torch.cat([mask, points_m], dim=1), focal, recrops.halved())
    cells = F.adaptive_avg_pool2d(geometry, config.geometry_cells).flatten(2).mT  # (n, cells, 4)
    coverage = cells[..., 0]
    mean = cells[..., 1:] / coverage.clamp_min(1e-6)[..., None] * (coverage > 1e-3)[..., None]
    Ts_crop_part = transform(recrops.Rs_crop_source) @ templates.Ts_camera_part[views]
    return TemplateCrops(sampled[:, :3], sampled[:, 3], mean, coverage, recrops.half_tangent, Ts_crop_part)


def collate(sets: Sequence[TemplateCrops], diameters_m: Sequence[float]) -> TemplateInputs:
    """Return sets of equally many crops as one batch for the network."""
    crops = TemplateCrops.stack(sets)
    diameter_m = torch.tensor(np.asarray(diameters_m), dtype=torch.float32)
    half_tangent = torch.tensor(crops.half_tangent, dtype=torch.float32)
    poses = ViewPoses.of(torch.tensor(crops.Ts_crop_part, dtype=torch.float32), half_tangent)
    points = crops.points_m / diameter_m[:, None, None, None]
    return TemplateInputs(crops.rgb, crops.masks, half_tangent, poses, points, crops.coverage, diameter_m)


def _points_in_part(templates: TemplateSet, views: Int[np.ndarray, "n"]) -> Float[Tensor, "n 3 size size"]:
    """Return the surface point of each pixel in the part's frame, in metres; meaningless outside the part."""
    rays = torch.tensor(templates.camera.rays(), dtype=torch.float32)  # (size, size, 3)
    depth_m = torch.from_numpy(templates.depth_m[views])
    T_part_camera = torch.tensor(invert(templates.Ts_camera_part[views]), dtype=torch.float32)
    points = torch.einsum("nij,yxj->niyx", T_part_camera[:, :3, :3], rays) * depth_m[:, None]
    return points + T_part_camera[:, :3, 3, None, None]
