"""Many views' answers to one query, brought together."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from simpick.estimators.raypose.network.pose_maps import ViewPoses
from simpick.geometry.torch_rotations import project_to_so3

_AGREEING_RAD = 0.17
"""Two views of this angle between their answers count as agreeing to 60 %: ten degrees."""


def combine_views(views: ViewPoses) -> ViewPoses:
    """Return one pose for each query: the mean of the views that agree with the one that most agree with."""
    cosine = (torch.einsum("baij,bcij->bac", views.R, views.R) - 1) / 2
    angle = cosine.clamp(-1, 1).acos()
    agreement = torch.exp(-angle.square() / (2 * _AGREEING_RAD**2))  # (batch, views, views)
    centre_of = agreement.sum(dim=-1).argmax(dim=-1)
    weight = agreement[torch.arange(len(centre_of), device=centre_of.device), centre_of]  # (batch, views)
    weight = weight / weight.sum(dim=1, keepdim=True)
    R = project_to_so3(torch.einsum("bk,bkij->bij", weight, views.R))
    centre = torch.einsum("bk,bki->bi", weight, views.centre)
    return ViewPoses(R, centre, (weight * views.half_extent_at_depth_m.log()).sum(dim=1).exp())


def agreement(views: ViewPoses) -> Float[Tensor, "batch"]:
    """Return how far the views' answers agree, in (0, 1]: 1 if all are the same."""
    R = combine_views(views).R
    cosine = (torch.einsum("bkij,bij->bk", views.R, R) - 1) / 2
    return torch.exp(-cosine.clamp(-1, 1).acos().mean(dim=1) / (2 * _AGREEING_RAD))
