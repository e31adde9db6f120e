"""Training batches: queries of shards, the templates drawn for each, and the true poses."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn import functional as F

from simpick.estimators.raypose.crops.template_choice import align_turns, draw_around, draw_over_sphere, view_angles
from simpick.estimators.raypose.crops.template_crops import TemplateCrops, collate, crop_templates
from simpick.estimators.raypose.crops.virtual_recrops import VirtualRecrops, aim_virtual_recrops, sample_virtual_recrops
from simpick.estimators.raypose.network.config import RayPoseConfig
from simpick.estimators.raypose.network.pose_maps import ViewPoses
from simpick.estimators.raypose.network.tokens import QueryInputs, TemplateInputs
from simpick.geometry import invert, rotated_boxes, so3_exp, transform
from simpick.tensor_record import TensorRecord
from simpick.training.data.augmentation import AugmentationConfig, jitter_boxes, perturb_mask
from simpick.training.data.shard import Shard

CENTRE_ERROR = 0.4
"""Standard deviation of the rotation error of the pose that fine templates are drawn around, per spread."""
NOMINAL_DISTANCE_M = 0.9
"""Distance at which `RayPoseConfig.spread_m` becomes a shift and a scale."""


@dataclass(frozen=True, eq=False)
class TrainingBatch(TensorRecord):
    """Inputs and targets of one step."""

    query: QueryInputs
    templates: TemplateInputs
    """Sets of templates; coarse queries of one part share a set, which is encoded once."""
    sets: Int[Tensor, "batch"]
    """Index of the set of each query."""
    truth: ViewPoses
    """Poses of the queries, shape (batch, 1); of equivalent poses the one closest to the templates."""
    points: Float[Tensor, "batch cells 3"]
    """Mean position of the surface that each query cell shows, in the part frame, in diameters."""
    coverage: Float[Tensor, "batch cells"]
    """Share of each query cell that shows the part. Cells are those of `RayPoseConfig.geometry_cells`."""
    Ts_crop_part: Float[np.ndarray, "batch 4 4"]

    def __len__(self) -> int:
        return len(self.sets)


def make_batch(
    shards: Sequence[Shard],
    queries: Sequence[Int[np.ndarray, "_"]],
    config: RayPoseConfig,
    rng: np.random.Generator,
    *,
    augmentation: AugmentationConfig | None = None,
) -> TrainingBatch:
    """Return the given queries of each shard as one batch; `rng` is the only source of randomness."""
    augmentation = augmentation or AugmentationConfig()
    batches = [_part_batch(shard, rows, config, rng, augmentation) for shard, rows in zip(shards, queries, strict=True)]
    first = np.cumsum([0, *(len(batch.templates.diameter_m) for batch in batches)]).tolist()
    sets = torch.cat([batch.sets + k for batch, k in zip(batches, first, strict=False)])
    return dataclasses.replace(TrainingBatch.cat(batches), sets=sets)


def _part_batch(
    shard: Shard,
    rows: Int[np.ndarray, "n"],
    config: RayPoseConfig,
    rng: np.random.Generator,
    augmentation: AugmentationConfig,
) -> TrainingBatch:
    """Return queries of one shard, which all show the same part."""
    masks = np.stack([perturb_mask(shard.masks[row], augmentation, rng) for row in rows])
    shared = None if config.is_fine else _draw_over_sphere(shard, config, rng)
    if shared is None:
        angles = rng.uniform(-np.pi, np.pi, len(rows)) * augmentation.turn
    else:
        angles = np.array([_turn_towards(shared, T, rng) for T in shard.Ts_crop_part[rows]])
    boxes = jitter_boxes(rotated_boxes(masks, angles[:, None])[:, 0], augmentation, rng)
    focal_px = shard.focal_px[rows]
    recrops = aim_virtual_recrops(shard.crop_px, focal_px, angles, boxes, config.crop_px, padding=config.padding)
    Ts = transform(recrops.Rs_crop_source) @ shard.Ts_crop_part[rows]
    sampled, points_m, coverage = _sample(shard, rows, masks, recrops, config)
    gain = torch.tensor(1 + augmentation.brightness * rng.uniform(-1, 1, len(rows)), dtype=torch.float32)
    rgb = (sampled[:, :3] * gain[:, None, None, None]).clamp(0, 1)
    # Of equivalent poses, those closest to each other.
    if shared is None:
        truths = Ts
        templates = [_draw_around(shard, T, config, rng).nearest_to(T, shard.symmetries) for T in Ts]
    else:
        truths = np.stack([_nearest_to_a_template(shard, T, shared) for T in Ts])
        templates = [shared]
    half_tangent = torch.tensor(recrops.half_tangent, dtype=torch.float32)
    return TrainingBatch(
        QueryInputs(rgb, sampled[:, 3], half_tangent),
        collate(templates, [shard.diameter_m] * len(templates)),
        torch.arange(len(rows)) if shared is None else torch.zeros(len(rows), dtype=torch.long),
        ViewPoses.of(torch.tensor(truths, dtype=torch.float32)[:, None], half_tangent[:, None]),
        _in_part(points_m, truths) / shard.diameter_m,
        coverage,
        truths,
    )


def _sample(
    shard: Shard,
    rows: Int[np.ndarray, "n"],
    masks: Bool[np.ndarray, "n size size"],
    recrops: VirtualRecrops,
    config: RayPoseConfig,
) -> tuple[Float[Tensor, "n 4 crop crop"], Float[Tensor, "n cells 3"], Float[Tensor, "n cells"]]:
    """Return colour and mask of the crops, and each cell's mean surface point in the crop's frame (m) and coverage."""
    size, focal = shard.crop_px, shard.focal_px[rows]
    rgb = torch.from_numpy(shard.rgb[rows]).permute(0, 3, 1, 2).float() / 255
    mask = torch.from_numpy(masks)[:, None].float()
    # The pixels that a grown mask adds do not show the part.
    true_mask = torch.from_numpy(masks & shard.masks[rows])[:, None].float()
    depth_m = shard.relief_m[rows].astype(np.float32) + shard.Ts_crop_part[rows, 2, 3][:, None, None]
    depth = torch.from_numpy(depth_m.astype(np.float32))
    axis = torch.arange(size) + 0.5 - size / 2
    y, x = torch.meshgrid(axis, axis, indexing="ij")
    rays = torch.stack([x, y], dim=0) / torch.tensor(focal, dtype=torch.float32)[:, None, None, None]
    points = torch.cat([rays, torch.ones_like(rays[:, :1])], dim=1) * depth[:, None]  # (n, 3, size, size)
    sampled = sample_virtual_recrops(torch.cat([rgb, mask], dim=1), focal, recrops)
    geometry = sample_virtual_recrops(torch.cat([true_mask, points * true_mask], dim=1), focal, recrops.halved())
    cells = F.adaptive_avg_pool2d(geometry, config.geometry_cells).flatten(2).mT  # (n, cells, 4)
    mean = cells[..., 1:] / cells[..., :1].clamp_min(1e-6)
    R = torch.tensor(recrops.Rs_crop_source, dtype=torch.float32)
    return sampled, torch.einsum("nij,ncj->nci", R, mean), cells[..., 0]


def _in_part(
    points_m: Float[Tensor, "n cells 3"], Ts_crop_part: Float[np.ndarray, "n 4 4"]
) -> Float[Tensor, "n cells 3"]:
    T = torch.tensor(invert(Ts_crop_part), dtype=torch.float32)
    return torch.einsum("nij,ncj->nci", T[:, :3, :3], points_m) + T[:, None, :3, 3]


def _draw_over_sphere(shard: Shard, config: RayPoseConfig, rng: np.random.Generator) -> TemplateCrops:
    """Return upright coarse templates; of equivalent poses, as at run time, those closest to the first template's."""
    views = draw_over_sphere(
        shard.templates.Ts_camera_part[:, :3, :3], config.templates, rng, fixed=config.template_views == "fixed"
    )
    crops = crop_templates(shard.templates, views, np.zeros(len(views)), config)
    return crops.nearest_to(crops.Ts_crop_part[0], shard.symmetries)


def _turn_towards(templates: TemplateCrops, T_crop_part: Float[np.ndarray, "4 4"], rng: np.random.Generator) -> float:
    """Return the rotation that aligns a query with the most similar template, with an error of at most 15 degrees.

    At run time, queries are compared in twelve rotations.
    """
    Rs, R = templates.Ts_crop_part[:, :3, :3], T_crop_part[:3, :3]
    nearest = np.argmin(view_angles(Rs, R))
    return align_turns(R[None], Rs[nearest])[0] + rng.uniform(-1, 1) * np.pi / 12


def _nearest_to_a_template(
    shard: Shard, T_crop_part: Float[np.ndarray, "4 4"], templates: TemplateCrops
) -> Float[np.ndarray, "4 4"]:
    """Return the equivalent pose with the smallest rotation to one of the templates."""
    Rs = templates.Ts_crop_part[:, :3, :3]
    distances = shard.symmetries.rotation_distance(np.broadcast_to(T_crop_part[:3, :3], Rs.shape), Rs)
    return shard.symmetries.closest_equivalent(T_crop_part, templates.Ts_crop_part[int(np.argmin(distances))])


def _draw_around(
    shard: Shard, T_crop_part: Float[np.ndarray, "4 4"], config: RayPoseConfig, rng: np.random.Generator
) -> TemplateCrops:
    """Return fine templates around the pose with a random rotation error, with random shifts and scales."""
    Rs, count = shard.templates.Ts_camera_part[:, :3, :3], config.templates
    spread = np.radians(config.spread_deg)
    error = np.clip(rng.normal(0, CENTRE_ERROR * spread), -spread, spread)
    axis = rng.normal(size=3)
    R_centre = so3_exp(error * axis / np.linalg.norm(axis)) @ T_crop_part[:3, :3]
    views, angles = draw_around(Rs, R_centre, count, spread, rng)
    relative = config.spread_m / NOMINAL_DISTANCE_M
    shift = rng.uniform(-relative, relative, (count, 2))
    zoom = 1 + rng.uniform(-relative, relative, count)
    return crop_templates(shard.templates, views, angles, config, shift=shift, zoom=zoom)
