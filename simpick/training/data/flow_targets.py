"""Targets of the flow: the position of each template cell in the query."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional as F

from simpick.estimators.raypose.network import losses
from simpick.estimators.raypose.network.flow import MIN_COVERAGE, Flow
from simpick.estimators.raypose.network.model import RayPose
from simpick.estimators.raypose.network.pose_solver import SolvedPoses, project
from simpick.training.data.batches import TrainingBatch

_SAME_PLACE = 0.06
"""Distance in diameters below which a query cell shows the same point; a farther point is hidden."""


def flow_terms(model: RayPose, batch: TrainingBatch, flow: Flow) -> dict[str, Float[Tensor, ""]]:
    """Return the terms of flow by the names of `LossWeights`.

    Without multiview, flow has one group per template, query by query.
    """
    assert model.flow is not None
    repeats = len(flow.points) // len(batch)
    half_tangent, points, coverage, R, centre, log_scale = (
        x.repeat_interleave(repeats, 0)
        for x in (
            batch.query.half_tangent,
            batch.points,
            batch.coverage,
            batch.truth.R[:, 0],
            batch.truth.centre[:, 0],
            (batch.templates.diameter_m[batch.sets] / batch.truth.half_extent_at_depth_m[:, 0]).log(),
        )
    )
    truth = SolvedPoses(R[:, None], centre[:, None], log_scale[:, None])
    projected = project(flow.points, half_tangent, truth)[0][:, 0]  # (groups, cells, 2)
    unit, offsets = model.flow.unit, model.flow.offsets
    wanted = projected - flow.expected
    reach = offsets.amax() + unit / 2
    shown = _shows(points, coverage, projected, flow.points) & flow.valid
    valid = shown & (wanted.abs().amax(dim=-1) < reach)
    pose = flow.pose
    return {
        "flow_matching": losses.flow_matching(flow.log_probabilities.float(), offsets, wanted, valid, unit),
        "flow_offset": losses.flow_offset(flow.offset, wanted, valid, unit),
        "flow_pose": losses.flow_pose(pose.R[:, 0], pose.centre[:, 0], pose.log_scale[:, 0], R, centre, log_scale),
    }


def _shows(
    points: Float[Tensor, "groups query_cells 3"],
    coverage: Float[Tensor, "groups query_cells"],
    projected: Float[Tensor, "groups cells 2"],
    wanted: Float[Tensor, "groups cells 3"],
) -> Bool[Tensor, "groups cells"]:
    """Return whether the query shows the wanted points where they project, and not something in front of them."""
    side = round(points.shape[1] ** 0.5)
    maps = torch.cat([points, coverage[..., None]], dim=-1).mT.unflatten(-1, (side, side))
    there = F.grid_sample(maps, projected[:, None], mode="nearest", align_corners=False)[
        :, :, 0
    ].mT  # (groups, cells, 4)
    near = (there[..., :3] - wanted).norm(dim=-1) < _SAME_PLACE
    return near & (there[..., 3] > MIN_COVERAGE)
