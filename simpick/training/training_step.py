"""One step's loss: noise on the true maps, the network's prediction, the paper's terms."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from simpick.estimators.raypose.diffusion.schedule import Schedule
from simpick.estimators.raypose.diffusion.x0_parameterization import add_noise
from simpick.estimators.raypose.network import losses
from simpick.estimators.raypose.network.matching import MIN_COVERAGE
from simpick.estimators.raypose.network.model import RayPose, halved_geometry
from simpick.estimators.raypose.network.pose_maps import encode_pose_maps
from simpick.estimators.raypose.network.tokens import InitialPoses, TemplateTokens
from simpick.training.data.batches import TrainingBatch
from simpick.training.data.flow_targets import flow_terms


def loss_terms(
    model: RayPose, batch: TrainingBatch, schedule: Schedule, generator: torch.Generator
) -> dict[str, Float[Tensor, ""]]:
    """Return the terms of the loss by the names of `LossWeights`; noise comes from `generator`, on the CPU."""
    config = model.config
    query = model.encode_query(batch.query)
    templates = model.fuse(model.encode_templates(batch.templates)).for_queries(batch.sets)
    conditioning = model.condition(query, templates)
    target = encode_pose_maps(batch.truth, conditioning.reference, config.map_cells, config.padding)
    steps = torch.randint(len(schedule), (len(batch),), generator=generator)
    log_snr = schedule.log_snrs[steps].to(target.device)
    noise = torch.randn(target.shape, generator=generator).to(target.device)
    predicted = model.denoise(add_noise(target, noise, log_snr), log_snr, conditioning).float()
    terms = losses.pose_map_losses(predicted, target, batch.truth, conditioning.reference, config.padding)
    if conditioning.matched is not None:
        terms |= _matching(model, batch, templates, conditioning.matched)
    return terms


def matching_terms(model: RayPose, batch: TrainingBatch) -> dict[str, Float[Tensor, ""]]:
    """Return only the terms of matching and flow and of the poses solved from them, without fuser and decoder."""
    query = model.encode_query(batch.query)
    templates = model.encode_templates(batch.templates).for_queries(batch.sets)
    return _matching(model, batch, templates, model.initial_poses(query, templates))


def _matching(
    model: RayPose, batch: TrainingBatch, templates: TemplateTokens, first: InitialPoses
) -> dict[str, Float[Tensor, ""]]:
    config, reference, matches = model.config, model.reference(templates), first.matches
    points, covered = templates.points, templates.coverage >= MIN_COVERAGE
    query_points, coverage = batch.points, batch.coverage
    if config.flow:
        query_points, coverage = halved_geometry(query_points, coverage)
    seen = coverage > 0.5
    if config.multiview:
        points, covered = points.flatten(1, 2), covered.flatten(1, 2)
    else:
        views = points.shape[1]
        points, covered = points.flatten(0, 1), covered.flatten(0, 1)
        query_points, seen = query_points.repeat_interleave(views, 0), seen.repeat_interleave(views, 0)
    target = encode_pose_maps(batch.truth, reference, config.map_cells, config.padding)
    maps = model.maps_of(first.solved, templates).reshape(target.shape).float()
    terms = {
        "matching": losses.matching(matches.log_probabilities.float(), query_points, seen, points, covered),
        "matched_points": losses.matched_points(matches.points.float(), query_points, seen),
        "first": losses.ray_reconstruction(maps[..., :3], target[..., :3])
        + losses.translation_reconstruction(maps[..., 3:], target[..., 3:])
        + losses.translation_xyz(maps[..., 3:], batch.truth, reference, config.padding),
    }
    return terms if first.flow is None else terms | flow_terms(model, batch, first.flow)
