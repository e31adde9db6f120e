"""The loss of one training step: noise on the true maps, the network's prediction, the terms of the loss."""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F

from simpick.estimators.raypose.diffusion.schedule import Schedule
from simpick.estimators.raypose.diffusion.x0_parameterization import add_noise
from simpick.estimators.raypose.network import losses
from simpick.estimators.raypose.network.cell_geometry import coarser_geometry
from simpick.estimators.raypose.network.initial_poses import InitialPoses
from simpick.estimators.raypose.network.matching import MIN_COVERAGE
from simpick.estimators.raypose.network.model import RayPose
from simpick.estimators.raypose.network.pose_maps import encode_pose_maps
from simpick.estimators.raypose.network.tokens import QueryTokens, TemplateTokens
from simpick.training.data.batches import TrainingBatch
from simpick.training.data.flow_targets import flow_terms


def loss_terms(
    model: RayPose, batch: TrainingBatch, schedule: Schedule, generator: torch.Generator
) -> dict[str, Float[Tensor, ""]]:
    """Return the terms of the loss by the names of `LossWeights`; noise comes from `generator`, on the CPU."""
    config = model.config
    query = model.encode_query(batch.query)
    encoded = model.encode_templates(batch.templates)
    templates = model.fuse(encoded).for_queries(batch.sets)
    conditioning = model.condition(query, templates)
    target = encode_pose_maps(batch.truth, conditioning.reference, config.map_cells, config.padding)
    steps = torch.randint(len(schedule), (len(batch),), generator=generator)
    log_snr = schedule.log_snrs[steps].to(target.device)
    noise = torch.randn(target.shape, generator=generator).to(target.device)
    predicted = model.denoise(add_noise(target, noise, log_snr), log_snr, conditioning).float()
    terms = losses.pose_map_losses(predicted, target, batch.truth, conditioning.reference, config.padding)
    if conditioning.initial is not None:
        terms |= _matching(model, batch, templates, conditioning.initial)
    return terms | _encoding(model, batch, query, encoded)


def matching_terms(model: RayPose, batch: TrainingBatch) -> dict[str, Float[Tensor, ""]]:
    """Return only the terms of matching and flow and of the poses solved from them, without fuser and decoder."""
    query = model.encode_query(batch.query)
    encoded = model.encode_templates(batch.templates)
    templates = encoded.for_queries(batch.sets)
    terms = _matching(model, batch, templates, model.initial_poses(query, templates))
    return terms | _encoding(model, batch, query, encoded)


def _encoding(
    model: RayPose, batch: TrainingBatch, query: QueryTokens, templates: TemplateTokens
) -> dict[str, Float[Tensor, ""]]:
    """Return the terms of embeddings and of visibility, which need no pose."""
    logits = model.view_embedding.logits(query.embedding, templates.embedding.flatten(0, 1))
    terms = {"view_embedding": losses.view_embedding(logits, batch.view_angles_rad)}
    if model.visibility is not None:
        terms["visibility"] = losses.visibility(query.visible, _at(batch.coverage, query.visible))
    return terms


def _matching(
    model: RayPose, batch: TrainingBatch, templates: TemplateTokens, initial: InitialPoses
) -> dict[str, Float[Tensor, ""]]:
    config, reference, matches = model.config, model.reference(templates), initial.matches
    query_points, coverage = batch.points, batch.coverage
    if config.flow:
        query_points, coverage = coarser_geometry(query_points, coverage)
    # Without multiview, each query is matched once with each of its templates.
    groups = len(matches.points)
    query_points, seen = (x.repeat_interleave(groups // len(batch), 0) for x in (query_points, coverage > 0.5))
    points = templates.points.reshape(groups, -1, 3)
    covered = templates.coverage.reshape(groups, -1) >= MIN_COVERAGE
    target = encode_pose_maps(batch.truth, reference, config.map_cells, config.padding)
    solved = initial.solved.map(lambda x: x.reshape(*target.shape[:2], *x.shape[2:]))
    maps = model.pose_maps(solved, templates).float()
    terms = {
        "matching": losses.matching(matches.log_probabilities.float(), query_points, seen, points, covered),
        "matched_points": losses.matched_points(matches.points.float(), query_points, seen),
        "first": losses.ray_reconstruction(maps[..., :3], target[..., :3])
        + losses.translation_reconstruction(maps[..., 3:], target[..., 3:])
        + losses.translation_xyz(maps[..., 3:], batch.truth, reference, config.padding),
    }
    return terms if initial.flow is None else terms | flow_terms(model, batch, initial.flow)


def _at(coverage: Float[Tensor, "batch cells"], visible: Float[Tensor, "batch fine_cells"]) -> Tensor:
    """Return the coverage on the grid that visibility is estimated on: that of the geometry, or a finer one."""
    if coverage.shape == visible.shape:
        return coverage
    side = math.isqrt(coverage.shape[-1])
    return F.interpolate(coverage.unflatten(-1, (1, side, side)), scale_factor=2).flatten(1)
