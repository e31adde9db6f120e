"""Training batches: the images of a plan, sampled on any device, and what is true of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from jaxtyping import Float, Float16, Int, UInt8
from torch import Tensor
from torch.nn import functional as F

from simpick.estimators.raypose.crops.template_crops import TemplateImages, collate, crop_templates
from simpick.estimators.raypose.crops.virtual_recrops import sample_virtual_recrops
from simpick.estimators.raypose.network.config import RayPoseConfig
from simpick.estimators.raypose.network.pose_maps import ViewPoses
from simpick.estimators.raypose.network.tokens import QueryInputs, TemplateInputs
from simpick.geometry import invert
from simpick.tensor_record import TensorRecord
from simpick.training.data.augmentation import AugmentationConfig
from simpick.training.data.batch_plan import PartPlan, plan_batch
from simpick.training.data.shard import OWN, Shard


@dataclass(frozen=True, eq=False)
class ShardImages(TensorRecord):
    """The images of a shard as tensors, on the device where batches are sampled."""

    rgb: UInt8[Tensor, "queries 3 size size"]
    labels: UInt8[Tensor, "queries size size"]
    relief_m: Float16[Tensor, "queries size size"]
    templates: TemplateImages
    shard: Shard

    @staticmethod
    def of(shard: Shard, device: torch.device | None = None) -> ShardImages:
        """Return a shard's images on a device, or on the CPU."""
        rgb = torch.tensor(shard.rgb).permute(0, 3, 1, 2)
        labels, relief_m = torch.tensor(shard.labels), torch.tensor(shard.relief_m)
        images = ShardImages(rgb, labels, relief_m, TemplateImages.of(shard.templates), shard)
        return images if device is None else images.to(device)


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
    view_angles_rad: Float[Tensor, "batch templates"]
    """Smallest rotation between each query's pose and that of each template, one set after the other, over the part's
    symmetries; infinite for templates of other parts."""
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
    plan = plan_batch(shards, queries, config, rng, augmentation or AugmentationConfig())
    return sample_batch([ShardImages.of(shard) for shard in shards], plan, config)


def sample_batch(images: Sequence[ShardImages], plan: Sequence[PartPlan], config: RayPoseConfig) -> TrainingBatch:
    """Return the batch of a plan, on the images' device; each part of the plan has its own shard."""
    angles = block_diagonal([part.view_angles_rad for part in plan], np.inf)
    first = np.cumsum([0, *(len(part.rows) for part in plan)])
    rows = [slice(start, stop) for start, stop in pairwise(first)]
    batches = [_part_batch(own, part, angles[row], config) for own, part, row in zip(images, plan, rows, strict=True)]
    first = np.cumsum([0, *(len(batch.templates.diameter_m) for batch in batches)]).tolist()
    sets = torch.cat([batch.sets + k for batch, k in zip(batches, first, strict=False)])
    return dataclasses.replace(TrainingBatch.cat(batches), sets=sets)


def block_diagonal(blocks: Sequence[Float[np.ndarray, "_ _"]], elsewhere: float) -> Float[np.ndarray, "rows columns"]:
    """Return a matrix with the blocks along its diagonal."""
    rows, columns = (np.cumsum([0, *(block.shape[axis] for block in blocks)]) for axis in (0, 1))
    out = np.full((rows[-1], columns[-1]), elsewhere)
    for k, block in enumerate(blocks):
        out[rows[k] : rows[k + 1], columns[k] : columns[k + 1]] = block
    return out


def _part_batch(
    images: ShardImages, plan: PartPlan, view_angles_rad: Float[np.ndarray, "n templates"], config: RayPoseConfig
) -> TrainingBatch:
    """Return queries of one shard, which all show the same part; angles are those to all templates of the batch."""
    device, shard = images.rgb.device, images.shard
    sampled, points_m, coverage = _sample(images, plan, config)
    gains = torch.tensor(plan.gains, dtype=torch.float32, device=device)
    rgb = (sampled[:, :3] * gains[:, None, None, None]).clamp(0, 1)
    half_tangent = torch.tensor(plan.recrops.half_tangent, dtype=torch.float32, device=device)
    truths = torch.tensor(plan.truths, dtype=torch.float32, device=device)
    crops = crop_templates(images.templates, plan.templates, config)
    count = int(plan.sets.max()) + 1
    size = len(plan.templates) // count
    templates = [crops.rows(slice(k * size, (k + 1) * size)) for k in range(count)]
    return TrainingBatch(
        QueryInputs(rgb, sampled[:, 3], half_tangent),
        collate(templates, [shard.diameter_m] * count),
        torch.from_numpy(plan.sets).to(device),
        ViewPoses.of(truths[:, None], half_tangent[:, None]),
        points_m / shard.diameter_m,
        coverage,
        torch.tensor(view_angles_rad, dtype=torch.float32, device=device),
        plan.truths,
    )


def _sample(
    images: ShardImages, plan: PartPlan, config: RayPoseConfig
) -> tuple[Float[Tensor, "n 4 crop crop"], Float[Tensor, "n cells 3"], Float[Tensor, "n cells"]]:
    """Return colour and mask of the crops, and each cell's mean surface point in the part's frame (m) and coverage."""
    device, shard, recrops = images.rgb.device, images.shard, plan.recrops
    rows, size, focal = torch.from_numpy(plan.rows).to(device), shard.crop_px, shard.focal_px[plan.rows]
    rgb = images.rgb[rows].float() / 255
    mask = torch.from_numpy(plan.masks).to(device)[:, None].float()
    # What the query shows, whatever its mask says.
    shown = (images.labels[rows] == OWN)[:, None].float()
    origin_m = torch.tensor(shard.Ts_crop_part[plan.rows, 2, 3], dtype=torch.float32, device=device)
    depth_m = images.relief_m[rows].float() + origin_m[:, None, None]
    axis = torch.arange(size, device=device) + 0.5 - size / 2
    y, x = torch.meshgrid(axis, axis, indexing="ij")
    focal_px = torch.tensor(focal, dtype=torch.float32, device=device)
    rays = torch.stack([x, y], dim=0) / focal_px[:, None, None, None]
    points = torch.cat([rays, torch.ones_like(rays[:, :1])], dim=1) * depth_m[:, None]  # (n, 3, size, size)
    sampled = sample_virtual_recrops(torch.cat([rgb, mask], dim=1), focal, recrops)
    geometry = sample_virtual_recrops(torch.cat([shown, points * shown], dim=1), focal, recrops.halved())
    cells = F.adaptive_avg_pool2d(geometry, config.geometry_cells).flatten(2).mT  # (n, cells, 4)
    mean = cells[..., 1:] / cells[..., :1].clamp_min(1e-6)
    # From the source's frame to the part's, by way of the crop's.
    R_crop_source = torch.tensor(recrops.Rs_crop_source, dtype=torch.float32, device=device)
    T = torch.tensor(invert(plan.truths), dtype=torch.float32, device=device)
    in_crop = torch.einsum("nij,ncj->nci", R_crop_source, mean)
    return sampled, torch.einsum("nij,ncj->nci", T[:, :3, :3], in_crop) + T[:, None, :3, 3], cells[..., 0]
