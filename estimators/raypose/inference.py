"""From conditioning to poses: sample every template's maps, decode them, and bring the views' answers together."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from simpick.estimators.raypose.model import Conditioning, RayPose
from simpick.estimators.raypose.pose_maps import CHANNELS, ViewPoses, decode_pose_maps
from simpick.estimators.raypose.sampler import sample
from simpick.estimators.raypose.schedule import Schedule
from simpick.geometry.torch_rotations import project_to_so3


def sample_views(
    model: RayPose, conditioning: Conditioning, schedule: Schedule, steps: int, generator: torch.Generator
) -> ViewPoses:
    """Return every template's hypothesis, leading dimensions (batch, views); noise comes from `generator`."""
    config, reference = model.config, conditioning.reference
    shape = (*reference.reach_m.shape, config.map_cells, config.map_cells, CHANNELS)
    # The same noise for every query, so that an answer does not depend on its place in the batch.
    noise = torch.randn(shape[1:], generator=generator).to(reference.reach_m.device).expand(shape)
    maps = sample(lambda noisy, log_snr: model.denoise(noisy, log_snr, conditioning), noise, schedule, steps)
    return decode_pose_maps(maps.float(), reference, config.padding)


def combine_views(views: ViewPoses, keep: float = 0.75) -> ViewPoses:
    """Return one pose for each query: the mean over the share `keep` of views nearest to the mean of all."""
    count = max(1, round(keep * views.reach_m.shape[1]))
    R_mean = project_to_so3(views.R.mean(dim=1))
    agreement = torch.einsum("bkij,bij->bk", views.R, R_mean)
    kept = agreement.topk(count, dim=1).indices

    def mean(x: Float[Tensor, "batch views *rest"]) -> Float[Tensor, "batch *rest"]:
        index = kept.view(*kept.shape, *([1] * (x.ndim - 2))).expand(*kept.shape, *x.shape[2:])
        return torch.gather(x, 1, index).mean(dim=1)

    return ViewPoses(project_to_so3(mean(views.R)), mean(views.centre), mean(views.reach_m.log()).exp())


def disagreement_rad(views: ViewPoses, pose: ViewPoses) -> Float[Tensor, "batch"]:
    """Return the mean angle between the views' rotations and the pose."""
    cosine = (torch.einsum("bkij,bij->bk", views.R, pose.R) - 1) / 2
    return cosine.clamp(-1, 1).acos().mean(dim=1)
