"""The pose that the hypotheses of many views agree on."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from simpick.estimators.raypose.network.pose_maps import ViewPoses
from simpick.geometry.torch_rotations import project_to_so3

_DEVIATION_RAD = 0.17
"""Ten degrees. Hypotheses this far apart support each other with a weight of exp(-1/2)."""


def consensus_pose(views: ViewPoses) -> ViewPoses:
    """Return one pose per query: the mean of the views, weighted by agreement with the view that has most support."""
    cosine = (torch.einsum("baij,bcij->bac", views.R, views.R) - 1) / 2
    angle = cosine.clamp(-1, 1).acos()
    support = torch.exp(-angle.square() / (2 * _DEVIATION_RAD**2))  # (batch, views, views)
    best = support.sum(dim=-1).argmax(dim=-1)
    weight = support[torch.arange(len(best), device=best.device), best]  # (batch, views)
    weight = weight / weight.sum(dim=1, keepdim=True)
    R = project_to_so3(torch.einsum("bk,bkij->bij", weight, views.R))
    centre = torch.einsum("bk,bki->bi", weight, views.centre)
    return ViewPoses(R, centre, (weight * views.half_extent_at_depth_m.log()).sum(dim=1).exp())


def consensus_score(views: ViewPoses) -> Float[Tensor, "batch"]:
    """Return how well the views agree, in (0, 1]: 1 if all rotations are the same."""
    R = consensus_pose(views).R
    cosine = (torch.einsum("bkij,bij->bk", views.R, R) - 1) / 2
    return torch.exp(-cosine.clamp(-1, 1).acos().mean(dim=1) / (2 * _DEVIATION_RAD))
