"""What is drawn at random for a training batch: queries, wrong masks, turns, boxes and templates; no images yet.

Plans are small and cost most of a batch's CPU time, so loader processes make them; `sample_batch` then samples images
on the device of the training.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from simpick.estimators.raypose.crops.aimed_templates import AimedTemplates, aim_at_templates
from simpick.estimators.raypose.crops.template_choice import align_turns, draw_around, draw_over_sphere, view_angles
from simpick.estimators.raypose.crops.virtual_recrops import VirtualRecrops, aim_virtual_recrops
from simpick.estimators.raypose.network.config import RayPoseConfig
from simpick.geometry import rotated_boxes, so3_exp, transform
from simpick.training.data.augmentation import AugmentationConfig, jitter_boxes, perturb_mask
from simpick.training.data.shard import Shard

CENTRE_ERROR = 0.4
"""Standard deviation of the rotation error of the pose that fine templates are drawn around, per spread."""
NOMINAL_DISTANCE_M = 0.9
"""Distance at which `RayPoseConfig.spread_m` becomes a shift and a scale."""


@dataclass(frozen=True, eq=False)
class PartPlan:
    """Queries of one shard and their templates."""

    rows: Int[np.ndarray, "n"]
    """Of the shard's queries."""
    masks: Bool[np.ndarray, "n size size"]
    """As a detector might find them."""
    recrops: VirtualRecrops
    """Of the queries."""
    gains: Float[np.ndarray, "n"]
    """Factors on the brightness."""
    truths: Float[np.ndarray, "n 4 4"]
    """T_crop_part; of equivalent poses the one closest to the templates."""
    templates: AimedTemplates
    """All sets, one after the other."""
    sets: Int[np.ndarray, "n"]
    """Index of the set of each query: coarse queries share one."""
    view_angles_rad: Float[np.ndarray, "n templates"]
    """Smallest rotation between each query's pose and each template's, over the part's symmetries."""


def plan_batch(
    shards: Sequence[Shard],
    queries: Sequence[Int[np.ndarray, "_"]],
    config: RayPoseConfig,
    rng: np.random.Generator,
    augmentation: AugmentationConfig,
) -> list[PartPlan]:
    """Return the plan of a batch of the given queries of each shard; `rng` is the only source of randomness."""
    return [_plan(shard, rows, config, rng, augmentation) for shard, rows in zip(shards, queries, strict=True)]


def _plan(
    shard: Shard,
    rows: Int[np.ndarray, "n"],
    config: RayPoseConfig,
    rng: np.random.Generator,
    augmentation: AugmentationConfig,
) -> PartPlan:
    masks = np.stack([perturb_mask(shard.labels[row], augmentation, rng) for row in rows])
    shared = None if config.is_fine else _aim_over_sphere(shard, config, rng)
    if shared is None:
        angles = rng.uniform(-np.pi, np.pi, len(rows)) * augmentation.turn
    else:
        angles = np.array([_turn_towards(shared, T, rng) for T in shard.Ts_crop_part[rows]])
    boxes = jitter_boxes(rotated_boxes(masks, angles[:, None])[:, 0], augmentation, rng)
    recrops = aim_virtual_recrops(
        shard.crop_px, shard.focal_px[rows], angles, boxes, config.crop_px, padding=config.padding
    )
    gains = 1 + augmentation.brightness * rng.uniform(-1, 1, len(rows))
    truths = transform(recrops.Rs_crop_source) @ shard.Ts_crop_part[rows]
    # Of equivalent poses, those closest to each other.
    if shared is None:
        templates = _aim_around(shard, truths, config, rng)
        templates = templates.nearest_to(np.repeat(truths, config.templates, axis=0), shard.symmetries)
        sets = np.arange(len(rows))
        return PartPlan(rows, masks, recrops, gains, truths, templates, sets, _view_angles(shard, truths, templates))
    truths = np.stack([_nearest_to_a_template(shard, T, shared) for T in truths])
    sets = np.zeros(len(rows), int)
    return PartPlan(rows, masks, recrops, gains, truths, shared, sets, _view_angles(shard, truths, shared))


def _view_angles(
    shard: Shard, Ts_crop_part: Float[np.ndarray, "n 4 4"], templates: AimedTemplates
) -> Float[np.ndarray, "n templates"]:
    Rs, Rs_template = Ts_crop_part[:, None, :3, :3], templates.Ts_crop_part[None, :, :3, :3]
    return shard.symmetries.rotation_distance(Rs, Rs_template).astype(np.float32)


def _aim_over_sphere(shard: Shard, config: RayPoseConfig, rng: np.random.Generator) -> AimedTemplates:
    """Return upright coarse templates; of equivalent poses, as at run time, those closest to the first template's."""
    views = draw_over_sphere(
        shard.templates.Ts_camera_part[:, :3, :3], config.templates, rng, fixed=config.template_views == "fixed"
    )
    aimed = aim_at_templates(shard.templates, views, np.zeros(len(views)), config)
    return aimed.nearest_to(aimed.Ts_crop_part[0], shard.symmetries)


def _turn_towards(templates: AimedTemplates, T_crop_part: Float[np.ndarray, "4 4"], rng: np.random.Generator) -> float:
    """Return the rotation that aligns a query with the most similar template, with an error of at most 15 degrees.

    At run time, queries are compared in twelve rotations.
    """
    Rs, R = templates.Ts_crop_part[:, :3, :3], T_crop_part[:3, :3]
    nearest = np.argmin(view_angles(Rs, R))
    return align_turns(R[None], Rs[nearest])[0] + rng.uniform(-1, 1) * np.pi / 12


def _nearest_to_a_template(
    shard: Shard, T_crop_part: Float[np.ndarray, "4 4"], templates: AimedTemplates
) -> Float[np.ndarray, "4 4"]:
    """Return the equivalent pose with the smallest rotation to one of the templates."""
    Rs = templates.Ts_crop_part[:, :3, :3]
    distances = shard.symmetries.rotation_distance(np.broadcast_to(T_crop_part[:3, :3], Rs.shape), Rs)
    return shard.symmetries.closest_equivalent(T_crop_part, templates.Ts_crop_part[int(np.argmin(distances))])


def _aim_around(
    shard: Shard, Ts_crop_part: Float[np.ndarray, "n 4 4"], config: RayPoseConfig, rng: np.random.Generator
) -> AimedTemplates:
    """Return fine templates around each pose with a random rotation error, with random shifts and scales."""
    spread = np.radians(config.spread_deg)
    drawn = [
        draw_around(
            shard.templates.Ts_camera_part[:, :3, :3],
            _random_error(spread, rng) @ T[:3, :3],
            config.templates,
            spread,
            rng,
        )
        for T in Ts_crop_part
    ]
    views, angles = (np.concatenate(values) for values in zip(*drawn, strict=True))
    relative = config.spread_m / NOMINAL_DISTANCE_M
    shift = rng.uniform(-relative, relative, (len(views), 2))
    zoom = 1 + rng.uniform(-relative, relative, len(views))
    return aim_at_templates(shard.templates, views, angles, config, shift=shift, zoom=zoom)


def _random_error(spread_rad: float, rng: np.random.Generator) -> Float[np.ndarray, "3 3"]:
    angle = np.clip(rng.normal(0, CENTRE_ERROR * spread_rad), -spread_rad, spread_rad)
    axis = rng.normal(size=3)
    return so3_exp(angle * axis / np.linalg.norm(axis))
